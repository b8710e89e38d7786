"""How an arm is drawn: shapes in its links' frames."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from types import SimpleNamespace
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from vdfmu.arm.equations.kinematics import poses
from vdfmu.base.arrays import Floats
from vdfmu.base.measure import JOINT_TYPES

PAYLOAD = "#b07a2a"
"""Colour of a payload."""
_FRAMES = ("offset", "rotation", "tool_offset", "tool_rotation")


class DrawnShape(NamedTuple):
    """A shape that is fixed to a body."""

    body: int
    """Number of the body: 0 is {I}, i is {B_i}, counted from 1."""
    shape: str
    """A key of `vdfmu.arm.robot.visual.SHAPES`, for `size`."""
    size: Sequence[float]
    offset: Floats
    """Centre in the frame of the body, (3,) [m]."""
    rotation: Floats
    """Axes as columns, (3, 3)."""
    colour: str = "light"
    """Colour as ``#rrggbb``; "light" and "dark" follow the theme; "joint" shows the value of joint `body`."""

    def plain(self) -> dict[str, Any]:
        """Return the shape for JSON."""
        facts = self._asdict()
        return facts | {key: np.asarray(facts[key]).tolist() for key in ("size", "offset", "rotation")}


class Chain:
    """The frames of an arm, from the facts of :func:`vdfmu.study.run.scene.arm_of`."""

    def __init__(self, arm: Mapping[str, Any]) -> None:
        self.types: list[str] = list(arm["types"])
        self.n = len(self.types)
        self.offset, self.rotation, self.tool_offset, self.tool_rotation, self.ell, gravity = (
            np.array(arm[name], dtype=np.float64) for name in (*_FRAMES, "ell", "gravity")
        )
        self.shapes: Sequence[Mapping[str, Any]] = arm["shapes"]
        self.payload: Mapping[str, Any] | None = arm.get("payload")
        length = float(np.linalg.norm(gravity))
        self.up: Floats = gravity / length if length else np.array([0.0, 0.0, 1.0])
        """Unit vector against gravity, which a robot file states upward."""
        self.weightless = length == 0.0
        self.reach = max(0.05, float(np.linalg.norm([*self.offset, self.tool_offset], axis=1).sum()))
        """Length of the stretched arm at q = 0 [m], at least 5 cm."""
        self._robot = SimpleNamespace(joint_types=self.types, **vars(self))

    def points(self, q: Floats) -> Floats:
        """Origins of {I}, of every {B_i} and of {O} in {I}: (n + 2, 3) [m]."""
        return np.array([p for p, _ in poses(self._robot, q)], dtype=np.float64)

    def parts(self, travel: ArrayLike, reach: float) -> Iterator[DrawnShape]:
        """Yield housings along the axes of the joints, and the robot's own shapes or tubes from joint to joint.

        Rails of prismatic joints are as long as `travel`, (n,) or one for all [m]; radii are fractions of `reach` [m].
        """

        def radius(place: float) -> float:
            return 0.06 * reach * (1.0 - 0.42 * place / max(1, self.n - 1))

        here, rails = (np.zeros(3), np.eye(3)), np.broadcast_to(np.asarray(travel, dtype=float), self.n)
        for i, kind in enumerate(self.types):
            r, body, R = radius(i), i + 1, self.rotation[i]
            if JOINT_TYPES[kind].slides:
                middle = self.offset[i] + R[:, 2] * rails[i] / 2.0
                yield DrawnShape(i, "box", (1.5 * r, 1.5 * r, float(rails[i]) + 2.0 * r), middle, R)
                yield DrawnShape(body, "box", (2.1 * r, 2.1 * r, 1.6 * r), *here, "joint")
                continue
            yield DrawnShape(body, "cylinder", (r, 2.2 * r), *here, "joint")
            for side in (-1.16, 1.16):
                cap = np.array([0.0, 0.0, side * r])
                yield DrawnShape(body, "cylinder", (0.82 * r, 0.16 * r), cap, np.eye(3), "dark")
        yield from own_shapes(self.shapes)
        for body, to in enumerate([] if self.shapes else [*self.offset, self.tool_offset]):
            length = float(np.linalg.norm(to))
            if length > 1e-9:
                r = 0.68 * radius(min(max(body - 1, 0) + 0.5, self.n - 1))
                yield DrawnShape(body, "capsule", (r, length), to / 2.0, turn_to(to))
        if self.payload:
            offset, R = self.tool_offset, self.tool_rotation
            centre, axes = (np.array(self.payload[key]) for key in ("offset", "rotation"))
            yield DrawnShape(self.n, "box", self.payload["size"], offset + R @ centre, R @ axes, PAYLOAD)

    def mount(self, travel: Floats) -> Floats:
        """Return the side of {I} on which the base is mounted, as a unit vector (3,); joints reach at most +-`travel`.

        It is behind the first joint if this is away from {I}; else below, above or beside it: the first of these to
        which the first link never points.
        """
        if np.linalg.norm(self.offset[0]) > 1e-9:
            return -self.offset[0] / float(np.linalg.norm(self.offset[0]))
        chain, axis = [*self.offset[1:], self.tool_offset], self.rotation[0][:, 2]
        link = next((np.array(each) for each in chain if np.linalg.norm(each) > 1e-9), np.zeros(3))
        angles = np.linspace(-1.0, 1.0, 37) * (0.0 if JOINT_TYPES[self.types[0]].slides else min(travel[0], np.pi))
        c, s, zero = np.cos(angles), np.sin(angles), np.zeros_like(angles)
        local = np.array([c * link[0] - s * link[1], s * link[0] + c * link[1], zero + link[2]])
        swept = self.rotation[0] @ local / (np.linalg.norm(link) or 1.0)
        stretched = self.points(np.zeros(self.n))[-1] @ self.up
        sides = (-self.up, self.up, -axis, axis) if stretched >= -1e-9 else (self.up, -self.up, -axis, axis)
        clear = [side for side in sides if (side @ swept).max() < 0.1]
        return np.array(clear[0] if clear else sides[0], dtype=np.float64)


def drawing_of(arm: Mapping[str, Any], travel: Floats) -> dict[str, Any]:
    """Return the page's drawing of an arm whose joints reach at most +-`travel`, (n,) [rad or m], ready for JSON."""
    chain = Chain(arm)
    rails = [each for each, kind in zip(travel, chain.types, strict=True) if JOINT_TYPES[kind].slides]
    reach = chain.reach + float(max(rails, default=0.0))
    parts = [part.plain() for part in chain.parts(travel, reach)]
    numbers = {name: arm[name] for name in ("types", *_FRAMES)}
    return numbers | {"up": chain.up.tolist(), "reach": reach, "parts": parts, "mount": chain.mount(travel).tolist()}


def own_shapes(shapes: Sequence[Mapping[str, Any]]) -> Iterator[DrawnShape]:
    """Yield the tables ``[[visuals]]`` of a robot file except meshes."""
    for shape in shapes:
        if shape["shape"] != "mesh":
            offset, rotation = np.array(shape["offset"]), np.array(shape["rotation"])
            yield DrawnShape(shape["joint"], shape["shape"], shape["size"], offset, rotation, hex_of(shape["color"]))


def hex_of(color: Sequence[float] | Floats) -> str:
    """Return a colour, red, green and blue from 0 to 1, as ``#rrggbb``."""
    return "#" + bytes(round(255.0 * part) for part in color[:3]).hex()


def turn_to(direction: Floats) -> Floats:
    """Return a rotation (3, 3) from z to a direction, which is the identity for z itself."""
    z = direction / np.linalg.norm(direction)
    x = np.eye(3)[int(abs(z[0]) > 0.9)]
    x = x - (x @ z) * z
    x /= np.linalg.norm(x)
    return np.array([x, np.cross(z, x), z], dtype=np.float64).T
