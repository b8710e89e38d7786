"""What a 3D view of an arm is made of, in the frames of its links; nothing here needs a window."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from types import SimpleNamespace
from typing import Any, NamedTuple

import numpy as np

from vdfmu.arrays import Floats
from vdfmu.equations.kinematics import joint_placements
from vdfmu.model import Robot

Colour = tuple[int, int, int]
LIGHT, DARK, NEUTRAL = (222, 228, 235), (88, 100, 115), (163, 174, 186)
POSITIVE, NEGATIVE = (226, 87, 13), (22, 103, 199)


class Part(NamedTuple):
    """A shape that is fixed to a body."""

    body: int
    """0 is {I}, i is {B_i}, counted from 1."""
    shape: str
    """One of `vdfmu.model.visual.SHAPES`, with its `size`."""
    size: Sequence[float]
    offset: Floats
    """Its centre in the frame of the body, (3,) [m]."""
    rotation: Floats
    """Its axes as columns, (3, 3)."""
    colour: Colour = LIGHT
    joint: int | None = None
    """Joint whose values colour it, from 0."""


class Chain:
    """The frames of an arm, of what :func:`vdfmu.report.content.arm_of` says of it."""

    def __init__(self, arm: Mapping[str, Any]) -> None:
        self.types: list[str] = list(arm["types"])
        self.n = len(self.types)
        self.offset: Floats = np.array(arm["offset"], dtype=float)
        self.rotation: Floats = np.array(arm["rotation"], dtype=float)
        self.tool_offset: Floats = np.array(arm["tool_offset"], dtype=float)
        self.tool_rotation: Floats = np.array(arm["tool_rotation"], dtype=float)
        self.ell: Floats = np.array(arm["ell"], dtype=float)
        gravity: Floats = np.array(arm["gravity"], dtype=float)
        length = float(np.linalg.norm(gravity))
        self.up: Floats = gravity / length if length else np.array([0.0, 0.0, 1.0])
        """Unit vector against the pull of gravity: its parameter is written upward."""
        self.weightless = length == 0.0
        self._equations = SimpleNamespace(
            n=self.n, joint_types=self.types, offset=self.offset, rotation=self.rotation
        )

    def placements(self, q: Floats) -> list[tuple[Floats, Floats]]:
        """Rotation and origin of every {B_i} in {B_(i-1)}, Eq. (34)-(36)."""
        return joint_placements(self._equations, q)

    def points(self, q: Floats) -> Floats:
        """Origins of {I}, of every {B_i} and of {O} in {I}: (n + 2, 3) [m]."""
        p: Floats = np.zeros(3)
        R: Floats = np.eye(3)
        found: list[Floats] = [p]
        for R_AB, p_AB in self.placements(q):
            p, R = p + R @ p_AB, R @ R_AB
            found.append(p)
        return np.array([*found, p + R @ self.tool_offset], dtype=np.float64)

    @property
    def reach(self) -> float:
        """Length of the stretched arm at q = 0 [m], at least 5 cm."""
        return max(0.05, float(np.linalg.norm([*self.offset, self.tool_offset], axis=1).sum()))


def turn_to(direction: Floats) -> Floats:
    """Return a rotation that takes z to a direction, the identity for z itself: (3, 3)."""
    z = direction / np.linalg.norm(direction)
    x = np.eye(3)[int(abs(z[0]) > 0.9)]
    x = x - (x @ z) * z
    x /= np.linalg.norm(x)
    return np.array([x, np.cross(z, x), z], dtype=np.float64).T


def _radius(chain: Chain, place: float) -> float:
    """Radius of a housing [m], as on the page of a run: ``vdfmu/report/web/arm.js``."""
    return 0.06 * chain.reach * (1.0 - 0.42 * place / max(1, chain.n - 1))


def housings(chain: Chain, travel: float) -> Iterator[Part]:
    """Yield housings along the axes of the joints; `travel` [m] is the length of the rails of prismatic ones."""
    for i, kind in enumerate(chain.types):
        r, body = _radius(chain, i), i + 1
        if kind == "prismatic":
            R, middle = chain.rotation[i], chain.offset[i] + chain.rotation[i][:, 2] * travel / 2.0
            yield Part(i, "box", (1.5 * r, 1.5 * r, travel + 2.0 * r), middle, R)
            yield Part(body, "box", (2.1 * r, 2.1 * r, 1.6 * r), np.zeros(3), np.eye(3), NEUTRAL, i)
            continue
        yield Part(body, "cylinder", (r, 2.2 * r), np.zeros(3), np.eye(3), NEUTRAL, i)
        for side in (-1.16, 1.16):
            cap = np.array([0.0, 0.0, side * r])
            yield Part(body, "cylinder", (0.82 * r, 0.16 * r), cap, np.eye(3), DARK)


def tubes(chain: Chain) -> Iterator[Part]:
    """Yield tubes from joint to joint."""
    for body, to in enumerate([*chain.offset, chain.tool_offset]):
        length = float(np.linalg.norm(to))
        if length > 1e-9:
            r = 0.68 * _radius(chain, min(max(body - 1, 0) + 0.5, chain.n - 1))
            yield Part(body, "capsule", (r, length), to / 2.0, turn_to(to))


def own_shapes(shapes: Sequence[Mapping[str, Any]]) -> Iterator[Part]:
    """Yield the tables ``[[visuals]]`` of a robot file but meshes."""
    for shape in shapes:
        if shape["shape"] != "mesh":
            red, green, blue = (round(255.0 * part) for part in shape["color"][:3])
            offset, rotation = np.array(shape["offset"]), np.array(shape["rotation"])
            yield Part(shape["joint"], shape["shape"], shape["size"], offset, rotation, (red, green, blue))


def half_axes(mass: float, moments: Floats) -> Floats:
    """Half-axes of the uniform solid ellipsoid of a mass and principal moments of inertia: (3,) [m].

    Those of such an ellipsoid are ``I_x = m (b^2 + c^2) / 5`` and so on (Meriam and Kraige, Engineering Mechanics:
    Dynamics, Table D/4), so ``a^2 = 5 (I_y + I_z - I_x) / (2 m)``. A body that is flat or thin has axes of 0.

    Parameters
    ----------
    mass : float [kg]
    moments : (3,) [kg.m2], about the centre of mass
    """
    squares = 2.5 * (moments.sum() - 2.0 * moments) / mass
    return np.sqrt(np.maximum(squares, 0.0))


def inertia_parts(robot: Robot) -> tuple[list[Part], list[str]]:
    """Ellipsoids of inertia of the links and the payload, and what is said of those that have none.

    An axis of less than a hundredth of the longest is drawn as that much.
    """
    of_link = zip(robot.mass, robot.centroid, robot.inertia, strict=True)
    bodies = [(f"link {i}", i, *numbers) for i, numbers in enumerate(of_link, 1)]
    if robot.payload:
        p, R = robot.tool_offset, robot.tool_rotation
        centroid, inertia = p + R @ robot.payload_centroid, R @ robot.payload_inertia @ R.T
        bodies.append(("payload", robot.n, robot.payload_mass, centroid, inertia))
    parts: list[Part] = []
    notes: list[str] = []
    for name, body, mass, centroid, inertia in bodies:
        if not float(mass) > 0.0:
            notes.append(f"{name} has no mass")
            continue
        moments, axes = np.linalg.eigh((inertia + inertia.T) / 2.0)
        if moments[0] < 0.0 or 2.0 * moments[2] > moments.sum() * (1.0 + 1e-9):
            notes.append(
                f"{name}: no body has principal moments {', '.join(f'{each:.3g}' for each in moments)}"
            )
        size = half_axes(float(mass), moments)
        if not size.max() > 0.0:
            notes.append(f"{name} is a point mass")
            continue
        axes[:, 2] *= np.sign(np.linalg.det(axes))
        parts.append(Part(body, "ellipsoid", np.maximum(size, 0.01 * size.max()).tolist(), centroid, axes))
    return parts, notes


def centres(robot: Robot) -> list[tuple[int, Floats]]:
    """Body and centre of mass in its frame [m] of each link that has a mass."""
    masses = zip(robot.mass, robot.centroid, strict=True)
    return [(i, centroid) for i, (mass, centroid) in enumerate(masses, 1) if float(mass) > 0.0]


def blend(share: float) -> Colour:
    """Colour of a value as a share of its largest, -1 to 1."""
    end = NEGATIVE if share < 0.0 else POSITIVE
    part = min(1.0, abs(share)) if np.isfinite(share) else 0.0
    r, g, b = (round(a + part * (z - a)) for a, z in zip(NEUTRAL, end, strict=True))
    return r, g, b
