"""Shapes and meshes of links in a robot file, for 3D views. No calculation uses them."""

from __future__ import annotations

import os
from dataclasses import dataclass
from importlib import import_module
from typing import Any

import numpy as np

from vdfmu.arm.robot.parameters import Array, read_only
from vdfmu.arm.robot.physical import check_rotation
from vdfmu.base.arrays import Floats
from vdfmu.base.toml_tables import Problems, Table, value_text

SHAPES = {"mesh": 3, "box": 3, "ellipsoid": 3, "cylinder": 2, "capsule": 2, "sphere": 1}
"""Shape to the numbers of its size: scale of a mesh, sides, half-axes, radius and length along z, radius."""
_KEYS = ("joint", "shape", "file", "size", "rotation", "offset", "color")


@dataclass(frozen=True, eq=False, kw_only=True)
class Visual:
    """A shape that is fixed to a link."""

    joint: int
    """Number of the joint that moves it, from 1; 0 for a shape at rest."""
    shape: str
    """A key of `SHAPES`."""
    size: Array
    """(k,) [m], or scale of a mesh."""
    rotation: Array
    """(3, 3): its axes as columns, in the link frame {B_i}."""
    offset: Array
    """(3,) [m]: its origin in {B_i}, of shapes other than meshes the centre."""
    color: Array
    """(4,): red, green, blue and opacity, 0 to 1."""
    file: str = ""
    """File of a mesh: a path from the folder of the robot file, or the name in an imported file."""

    def to_dict(self) -> dict[str, Any]:
        """Return the table of a robot file."""
        return {
            "joint": self.joint,
            "shape": self.shape,
            **({"file": self.file} if self.file else {}),
            **{name: getattr(self, name).tolist() for name in ("size", "rotation", "offset", "color")},
        }


def read_mesh(path: str | os.PathLike[str], scale: Floats) -> tuple[Floats, Any]:
    """Return the corners (k, 3) and the triangles (m, 3) of a mesh. ImportError without trimesh, any for a bad file."""
    mesh = import_module("trimesh").load(path, force="mesh")
    return np.asarray(mesh.vertices, float) * scale, np.asarray(mesh.faces)


def read_visuals(problems: Problems, data: object, n: int) -> tuple[Visual, ...]:
    """Read the tables [[visuals]] of a robot of `n` joints."""
    if not isinstance(data, list):
        problems.add("visuals", "tables", value_text(data), "Write [[visuals]] in double brackets.")
        return ()
    return tuple(_visual(problems, entry, f"visuals[{i}]", n) for i, entry in enumerate(data, 1))


def _visual(problems: Problems, data: object, path: str, n: int) -> Visual:
    table = Table(problems, data, path, _KEYS)
    joint = table.value("joint", f"a joint from 0 to {n}")
    if joint is not None and (isinstance(joint, bool) or not isinstance(joint, int) or not 0 <= joint <= n):
        problems.add(f"{path}.joint", f"a joint from 0 to {n}", value_text(joint), "0 is for shapes at rest.")
    shape = table.text("shape", choices=tuple(SHAPES))

    def numbers(key: str, size: tuple[int, ...], unit: str, default: Any, **bounds: Any) -> Floats:
        return read_only(table.numbers(key, size, unit, default, **bounds))

    rotation = numbers("rotation", (3, 3), "", np.eye(3).tolist())
    check_rotation(problems, f"{path}.rotation", rotation)
    mesh, size = shape == "mesh", (SHAPES.get(shape, 0),)
    return Visual(
        joint=joint if isinstance(joint, int) else 0, shape=shape, rotation=rotation,
        size=numbers("size", size, "", [1.0] * 3) if mesh else numbers("size", size, "m", None, at_least=0.0),
        offset=numbers("offset", (3,), "m", [0.0] * 3),
        color=numbers("color", (4,), "", [0.7, 0.7, 0.7, 1.0], at_least=0.0, at_most=1.0),
        file=table.text("file") if mesh else table.text("file", ""),
    )  # fmt: skip
