"""Shapes and meshes of links in a robot file, for 3D views. No calculation uses them."""

from __future__ import annotations

import os
from dataclasses import dataclass
from importlib import import_module
from typing import Any

import numpy as np

from vdfmu.arm.robot.parameters import Array
from vdfmu.base.arrays import Floats

SHAPES = {"mesh": 3, "box": 3, "ellipsoid": 3, "cylinder": 2, "capsule": 2, "sphere": 1}
"""Shape to the number of its sizes: scale of a mesh, sides, half-axes, radius and length along z, radius."""


@dataclass(frozen=True, eq=False, kw_only=True)
class Visual:
    """A shape that is fixed to a link."""

    joint: int
    """Number of the joint that moves it, from 1; 0 for a shape at rest."""
    shape: str
    """A key of `SHAPES`."""
    size: Array
    """Sizes (k,) [m], or scale of a mesh."""
    rotation: Array
    """Its axes as columns, (3, 3), in the link frame {B_i}."""
    offset: Array
    """Its origin in {B_i}, (3,) [m], which is the centre of shapes other than meshes."""
    color: Array
    """Red, green, blue and opacity, (4,), 0 to 1."""
    file: str = ""
    """File of a mesh: a path relative to the folder of the robot file, or the name in an imported file."""

    def to_dict(self) -> dict[str, Any]:
        """Return the table for a robot file."""
        return {
            "joint": self.joint,
            "shape": self.shape,
            **({"file": self.file} if self.file else {}),
            **{name: getattr(self, name).tolist() for name in ("size", "rotation", "offset", "color")},
        }


def read_mesh(path: str | os.PathLike[str], scale: Floats) -> tuple[Floats, Any]:
    """Return the corners (k, 3) and the triangles (m, 3) of a mesh. ImportError without trimesh; any for bad files."""
    mesh = import_module("trimesh").load(path, force="mesh")
    return np.asarray(mesh.vertices, float) * scale, np.asarray(mesh.faces)
