"""Ellipsoids of inertia against closed forms, and meshes."""

import sys
from types import SimpleNamespace

import numpy as np
import pytest

import vdfmu
from vdfmu.arm.robot import robot_names
from vdfmu.extras.robots.robot_shapes import half_axes, inertia_parts, mesh_parts


def of(mass, inertia):
    """Return a robot of one link, as far as masses go."""
    return SimpleNamespace(mass=[mass], centroid=[np.zeros(3)], inertia=[np.array(inertia)], payload=False)


@pytest.mark.parametrize("name", robot_names())
def test_ellipsoids_have_the_inertia_of_their_links(name):
    robot = vdfmu.load_robot(name)
    parts, notes = inertia_parts(robot)
    solid = [i for i in range(robot.n) if half_axes(1.0, np.linalg.eigvalsh(robot.inertia[i])).min() > 0.0]
    assert {part.body for part in parts} >= {i + 1 for i in solid}
    assert all("no body" not in note for note in notes)
    for part in parts[: robot.n]:
        i, (a, b, c) = part.body - 1, part.size
        np.testing.assert_array_equal(part.offset, robot.centroid[i])
        assert np.linalg.det(part.rotation) == pytest.approx(1.0)
        moments = robot.mass[i] / 5.0 * np.array([b**2 + c**2, a**2 + c**2, a**2 + b**2])
        inertia = part.rotation @ np.diag(moments) @ part.rotation.T
        # an axis below a hundredth of the longest is drawn longer: up to 1e-4 of the largest moment
        np.testing.assert_allclose(inertia, robot.inertia[i], atol=1.01e-4 * np.abs(robot.inertia[i]).max())


@pytest.mark.parametrize(("mass", "inertia", "note"), [
    (0.0, np.eye(3), "link 1 has no mass"),
    (1.0, np.zeros((3, 3)), "link 1 is a point mass"),
    (1.0, np.diag([-1.0, 1.0, 1.0]), "no body has principal moments -1, 1, 1"),
    (1.0, np.diag([1.0, 1.0, 3.0]), "no body has principal moments 1, 1, 3"),
])  # fmt: skip
def test_what_no_ellipsoid_has_is_said(mass, inertia, note):
    parts, notes = inertia_parts(of(mass, inertia))
    assert len(notes) == 1
    assert note in notes[0]
    assert all(np.isfinite(part.size).all() and min(part.size) > 0.0 for part in parts)


MESH = {"shape": "mesh", "size": [1, 1, 1], "color": [1, 0, 0, 1], "offset": [0, 0, 0], "rotation": np.eye(3)}


class Mesh:
    """A mesh of a robot."""

    def __init__(self, joint, file):
        vars(self).update(MESH | {"size": np.full(3, 0.5), "joint": joint, "file": file})


class OfMeshes:
    """A robot of two meshes."""

    visuals = (Mesh(1, "mesh_1.stl"), Mesh(2, "mesh_2.obj"))


def test_meshes_are_shown_if_all_can_be_and_those_that_cannot_are_named(tmp_path, monkeypatch):
    parts, notes = mesh_parts(OfMeshes, tmp_path)
    assert [note.partition(" cannot")[0] for note in notes] == ["mesh mesh_1.stl", "mesh mesh_2.obj"]
    (tmp_path / "mesh_2.obj").write_text("v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n")
    assert len(mesh_parts(OfMeshes, tmp_path)[1]) == 1
    corners = ("vertex 0 0 0", "vertex 0 0 2", "vertex 0 2 0")
    (tmp_path / "mesh_1.stl").write_text("\n".join(["solid a", "facet normal 1 0 0", "outer loop", *corners, "endloop",
                                                    "endfacet", "endsolid a"]))  # fmt: skip
    parts, notes = mesh_parts(OfMeshes, tmp_path)
    assert notes == []
    assert [(part["body"], part["colour"]) for part in parts] == [(1, "#ff0000"), (2, "#ff0000")]
    triangles, corners = (parts[0]["mesh"][name] for name in ("triangles", "corners"))
    corners = corners.reshape(-1, 3)
    np.testing.assert_array_equal(np.sort(corners[triangles].sum(axis=1)), [0.0, 1.0, 1.0])  # half as large
    monkeypatch.setitem(sys.modules, "trimesh", None)
    parts, notes = mesh_parts(OfMeshes, tmp_path)
    assert parts == []
    assert "'pip install vdfmu[view]'" in notes[0]
