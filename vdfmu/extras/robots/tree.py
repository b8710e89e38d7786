"""Content of a robot's file: links and joints in the file's frames, and bodies with mass and inertia."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from math import pi
from typing import Any, NamedTuple

import numpy as np

from vdfmu.arm.robot.parameters import section
from vdfmu.arm.robot.physical import check_inertia
from vdfmu.arm.robot.visual import Visual
from vdfmu.base.arrays import Floats
from vdfmu.base.toml_tables import Problems

MOVING = {"revolute": "revolute", "continuous": "revolute", "prismatic": "prismatic"}
"""Kinds of joints that an arm can have, and their type in its robot file."""
_MOST_NAMES = 12
"""Largest number of names in a list."""


class Placement(NamedTuple):
    """A frame in another frame: its axes as columns, (3, 3), and its origin (3,) [m]."""

    R: Floats
    p: Floats

    def __matmul__(self, inner: Placement) -> Placement:
        """Return the placement in the outer frame of `inner`, a frame in this frame."""
        return Placement(self.R @ inner.R, self.p + self.R @ inner.p)


HERE = Placement(np.eye(3), np.zeros(3))
"""The placement of a frame in itself."""


@dataclass(frozen=True, eq=False)
class RigidLink:
    """A rigid link: centroid (3,) [m] and inertia (3, 3) [kg.m2] about it, in its frame."""

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
    """Type as in URDF: in `MOVING`, "fixed", or unsupported."""
    parent: str
    child: str
    placement: Placement
    """Pose of the child link's frame in the parent's frame, at q = 0."""
    axis: Floats
    """Unit vector (3,) in the child's frame."""
    numbers: Mapping[str, float] = field(default_factory=dict[str, float])
    """Values in the file: lower, upper, effort, velocity, damping, friction, armature, SI units, link-side."""
    follows: str = ""
    """The joint that it mimics; empty for none."""


Numbers = dict[str, tuple[Any, str]]
"""Path in a robot file, such as ``joints.drive.ell``, to the number or array and its source."""


@dataclass(frozen=True, eq=False)
class Body:
    """The body moved by one joint, in the frame {B_i} of a robot file. Missing mass and inertia are 0."""

    joint: Joint
    links: tuple[str, ...]
    """Names of the merged links with mass, or of all links if none has mass."""
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

    Gravity is `standard` if the file does not state it. `notes` are for the user. `loops` are additional constraints
    that close chains: the name and the connected links.
    """

    name: str
    problems: Problems
    links: Mapping[str, RigidLink]
    joints: tuple[Joint, ...]
    gravity: Floats
    standard: bool
    notes: list[str]
    loops: tuple[tuple[str, str, str], ...] = ()

    @cached_property
    def above(self) -> dict[str, Joint]:
        """Link to the joint that carries it, without the roots."""
        return {joint.child: joint for joint in self.joints}

    @cached_property
    def below(self) -> dict[str, list[Joint]]:
        """Link to the joints that it carries."""
        below: dict[str, list[Joint]] = defaultdict(list)
        for joint in self.joints:
            below[joint.parent].append(joint)
        return below

    @cached_property
    def coupled(self) -> frozenset[str]:
        """Joints that other joints mimic."""
        return frozenset(joint.follows for joint in self.joints)


def aligned(axis: Floats) -> Floats:
    """Rotation (3, 3) whose third column is `axis`, (3,) of length 1, by the shortest turn from z."""
    x, y, z = axis
    if z < -1 + 1e-12:  # for half a turn any axis perpendicular to z is suitable
        return np.diag([1.0, -1.0, -1.0])
    turn = np.array([[0.0, 0.0, x], [0.0, 0.0, y], [-x, -y, 0.0]])
    return np.eye(3) + turn + turn @ turn / (1.0 + z)


def roll_pitch_yaw(angles: Floats) -> Floats:
    """Rotation (3, 3) from roll, pitch and yaw (3,) [rad] about the fixed axes x, y and z, in this order as in URDF."""
    (sr, sp, sy), (cr, cp, cy) = np.sin(angles), np.cos(angles)
    return np.array(
        [
            [cy * cp, cy * sp * sr - sy * cr, cy * sp * cr + sy * sr],
            [sy * cp, sy * sp * sr + cy * cr, sy * sp * cr - cy * sr],
            [-sp, cp * sr, cp * cr],
        ]
    )


def few(names: Sequence[str]) -> str:
    """Return names as a text; if there are many, only the first ones."""
    more = f" and {len(names) - _MOST_NAMES} more" if len(names) > _MOST_NAMES else ""
    return ", ".join(names[:_MOST_NAMES]) + more


class Mass(NamedTuple):
    """Mass [kg], its centre (3,) [m], and the inertia about that (3, 3) [kg.m2], in one frame."""

    mass: float
    centroid: Floats
    inertia: Floats


def joined(parts: Sequence[Mass]) -> Mass:
    """Combine masses into one."""
    if len(parts) == 1:
        return parts[0]  # without rounding
    mass = sum(part.mass for part in parts)
    center = sum((part.mass * part.centroid for part in parts), np.zeros(3)) / (mass or 1.0)
    inertia = np.zeros((3, 3))
    for part in parts:
        d = part.centroid - center
        inertia += part.inertia + part.mass * (d @ d * np.eye(3) - np.outer(d, d))
    return Mass(mass, center, inertia)


def of_shapes(shapes: Iterable[Visual]) -> Mass | None:
    """Return mass and inertia of solid shapes at 1 kg/m3, with volumes added; None without shapes or with a mesh."""
    parts: list[Mass] = []
    for shape in shapes:
        size: Any = shape.size
        match shape.shape:
            case "box":
                volume, moments = size.prod(), (size @ size - size**2) / 12.0
            case "sphere":
                volume, moments = 4.0 / 3.0 * pi * size[0] ** 3, np.full(3, 0.4 * size[0] ** 2)
            case "cylinder":
                across = (3.0 * size[0] ** 2 + size[1] ** 2) / 12.0
                volume, moments = pi * size[0] ** 2 * size[1], np.array([across, across, size[0] ** 2 / 2.0])
            case _:
                return None
        R = shape.rotation
        parts.append(Mass(abs(float(volume)), shape.offset, abs(float(volume)) * R @ np.diag(moments) @ R.T))
    whole = joined(parts)
    return whole if whole.mass else None


def with_inertia(
    bodies: Sequence[Body], chosen: Sequence[Numbers], density: float | None, file: str, tree: Tree
) -> tuple[Body, ...]:
    """Return bodies with the numbers of ``link`` in a file of drives, or with their shapes' inertia.

    Shapes are used if a body has no mass or inertia and their density [kg/m3] or the body's mass is known. Bodies, and
    their entries `chosen` from the file of drives, are in the order from base to tip; numbers from shapes are added to
    `chosen`. `file` is the robot's, for sources. Notes and problems are added to `tree`.
    """
    problems = tree.problems
    wholes: list[Body] = []
    for body, numbers in zip(bodies, chosen, strict=True):
        rows = section("link")
        names = ", ".join(body.links)
        values = {row.name: numbers[row.path][0] for row in rows if row.path in numbers}
        mass = values.get("mass", body.mass)
        shape = of_shapes(body.shapes)
        if not (body.mass and body.inertia.any()) and shape and (density or "mass" in values):
            mass = mass or (density or 0.0) * shape.mass
            solid = {"mass": mass, "centroid": shape.centroid, "inertia": shape.inertia * (mass / shape.mass)}
            solid_of = f"shapes of {names} in {file}, {mass / shape.mass:.6g} kg/m3"
            tree.notes.append(f"joint {body.joint.name}: {mass:.4g} kg, with the inertia of the {solid_of}.")
            kept = ("mass", "centroid") if body.mass else ()
            for row in (row for row in rows if row.name not in values and row.name not in kept):
                values[row.name] = solid[row.name]
                numbers[row.path] = solid[row.name], f"Assumed: {solid_of}"
        whole = replace(body, **values)
        wholes.append(whole)
        ways = (
            f"Give them by --drives: [{body.joint.name}] link = {{ mass, centroid, inertia }}; for a body of boxes, "
            f"cylinders and spheres the mass alone, or --density, is enough"
        )
        if not whole.mass:
            problems.add(
                f"joint {body.joint.name}",
                "a link with mass, which it moves",
                f"no <inertial> with a mass in {names}",
                f'{ways}. Or make the joint type="fixed".',
            )
        elif not whole.inertia.any():
            got = "principal moments 0, 0, 0 kg.m2"
            problems.add(f"link {names}", "positive definite, in kg.m2", got, f"{ways}.")
        else:
            check_inertia(problems, f"link {names}", whole.inertia)
    return tuple(wholes)
