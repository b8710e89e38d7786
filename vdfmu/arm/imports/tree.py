"""Content of a robot's file before an arm is chosen from it: links on joints, in the file's own frames."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np

from vdfmu.arm.robot.visual import Visual
from vdfmu.base.arrays import Floats
from vdfmu.base.toml_tables import Problems

MOVING = {"revolute": "revolute", "continuous": "revolute", "prismatic": "prismatic"}
"""Kinds of joints that an arm can have, to their type in its robot file."""
_MOST_NAMES = 12
"""Most names that a text lists."""


class Placement(NamedTuple):
    """A frame in another frame: its axes as columns, (3, 3), and its origin (3,) [m]."""

    R: Floats
    p: Floats

    def __matmul__(self, inner: Placement) -> Placement:
        """Return the placement of `inner`, a frame in this frame, in the outer frame."""
        return Placement(self.R @ inner.R, self.p + self.R @ inner.p)


@dataclass(frozen=True, eq=False)
class RigidLink:
    """A rigid link: centroid (3,) [m] and inertia (3, 3) [kg.m2] about it, both in the link's frame.

    `collisions` are for links without inertia.
    """

    name: str
    mass: float = 0.0
    centroid: Floats = field(default_factory=lambda: np.zeros(3))
    inertia: Floats = field(default_factory=lambda: np.zeros((3, 3)))
    visuals: tuple[Visual, ...] = ()
    collisions: tuple[Visual, ...] = ()

    @property
    def solid(self) -> tuple[Visual, ...]:
        """Shapes for the link's mass: the simpler collisions, or visuals if these are meshes."""
        meshes = [shape for shape in self.collisions if shape.shape == "mesh"]
        return self.visuals if meshes or not self.collisions else self.collisions


@dataclass(frozen=True, eq=False)
class Joint:
    """A joint."""

    name: str
    kind: str
    """URDF's word: in `MOVING`, "fixed", or unsupported."""
    parent: str
    child: str
    placement: Placement
    """Pose of the child link's frame in the parent's frame, at q = 0."""
    axis: Floats
    """Unit vector (3,) in the child's frame."""
    given: Mapping[str, float] = field(default_factory=dict[str, float])
    """Values in the file: lower, upper, effort, velocity, damping, friction, armature, SI units, link-side."""
    follows: str = ""
    """The joint that it mimics; empty for none."""


Numbers = dict[str, tuple[Any, str]]
"""Path in a robot file, such as ``joints.drive.ell``, to the number or array there and its source."""


@dataclass(frozen=True, eq=False)
class Body:
    """The body that one joint moves, in the frame {B_i} of a robot file. Missing mass and inertia are 0."""

    joint: Joint
    links: tuple[str, ...]
    """Names of the joined links with mass, or of all links without mass."""
    placement: Placement
    """Pose of {B_i} in {B_(i-1)} at q = 0."""
    mass: float
    centroid: Floats
    inertia: Floats
    shapes: tuple[Visual, ...] = ()
    """Shapes of its links, for a body without inertia."""


@dataclass(frozen=True, eq=False)
class Tree:
    """Links by name and joints, in the order of the file; gravity (3,) [m/s2] in the root's frame, upward.

    Gravity is `standard` if the file lacks it. `notes` are for the user. `loops` close chains in addition to joints:
    name, and the joined links.
    """

    name: str
    problems: Problems
    links: Mapping[str, RigidLink]
    joints: tuple[Joint, ...]
    gravity: Floats
    standard: bool
    notes: list[str]
    loops: tuple[tuple[str, str, str], ...] = ()

    def above(self, link: str) -> Joint | None:
        """Return the joint that carries a link, None for a root."""
        return self._above.get(link)

    def below(self, link: str) -> list[Joint]:
        """Return the joints that a link carries."""
        return self._below.get(link, [])

    @cached_property
    def _above(self) -> dict[str, Joint]:
        return {joint.child: joint for joint in self.joints}

    @cached_property
    def _below(self) -> dict[str, list[Joint]]:
        below: dict[str, list[Joint]] = {}
        for joint in self.joints:
            below.setdefault(joint.parent, []).append(joint)
        return below

    @cached_property
    def coupled(self) -> frozenset[str]:
        """Joints that others follow."""
        return frozenset(joint.follows for joint in self.joints)


def aligned(axis: Floats) -> Floats:
    """Rotation (3, 3) whose third column is `axis`, (3,) of length 1, by the shortest turn from z."""
    x, y, z = axis
    if z < -1 + 1e-12:  # any axis across z will do for half a turn
        return np.diag([1.0, -1.0, -1.0])
    turn = np.array([[0.0, 0.0, x], [0.0, 0.0, y], [-x, -y, 0.0]])
    return np.eye(3) + turn + turn @ turn / (1.0 + z)


def few(names: Sequence[str]) -> str:
    """Return names as a text, the first ones of many."""
    more = f" and {len(names) - _MOST_NAMES} more" if len(names) > _MOST_NAMES else ""
    return ", ".join(names[:_MOST_NAMES]) + more
