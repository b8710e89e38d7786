"""Place of the tool of an imported arm: given by the user, by a frame of the file, or where the last link ends."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from itertools import product
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from vdfmu.arm.imports.tree import HERE, Placement, roll_pitch_yaw
from vdfmu.arm.robot.visual import Visual, read_mesh
from vdfmu.base.arrays import Floats
from vdfmu.base.errors import UsageError

_END = 0.9
"""Share of the largest distance from the joint at which the end of a link begins."""
_ONE_SIDED = 0.1
"""Smallest distance of the middle of its ends from the joint, as a share of that distance: else it ends on all sides."""
_ANGLES = np.linspace(0.0, 2.0 * np.pi, 17)[:-1]
_RIM = np.stack([np.cos(_ANGLES), np.sin(_ANGLES), np.zeros(16)], axis=1)
_GRID = np.array([each for each in product((-1.0, 0.0, 1.0), repeat=3) if any(each)])
_BALL = _GRID / np.linalg.norm(_GRID, axis=1)[:, None]
_CORNERS = np.array([*product((-0.5, 0.5), repeat=3)])
_Z = np.array([0.0, 0.0, 1.0])


class Tool(NamedTuple):
    """Placement of {O} in the frame of the last body, and the rule that gave it, as the end of a sentence."""

    placement: Placement
    rule: str
    chosen: bool = True
    """Whether somebody chose it, the user or the author of the file, or the shape of the link shows it."""


def read_placement(numbers: npt.ArrayLike) -> Placement:
    """Return the placement x, y, z [m], and roll, pitch, yaw [rad] if given; UsageError for other numbers."""
    try:
        values = np.array(numbers, dtype=float)
    except (TypeError, ValueError):
        values = np.zeros(0)
    if values.shape not in ((3,), (6,)) or not np.isfinite(values).all():
        raise UsageError(
            f"tool: expected 3 numbers in m, or 6 with roll, pitch and yaw in rad, got {numbers!r:.60}. The command line "
            "needs quotes: --tool '0 0 0.1'."
        )
    return Placement(roll_pitch_yaw(values[3:] if values.size == 6 else np.zeros(3)), values[:3])


def end_of(shapes: Sequence[Visual]) -> Floats | None:
    """Return the far end of a link with these shapes, (3,) [m], in the frame of its joint, in which they are placed.

    The end is the part that is farthest from the joint, and the point lies on the line from the joint through the middle
    of that part. None without shapes, with a mesh that cannot be read, and for a link that ends on all sides of its
    joint alike.
    """
    parts = [_points(shape) for shape in shapes]
    points = np.concatenate([part for part in parts if part is not None] or [np.zeros((1, 3))])
    away = np.linalg.norm(points, axis=1)
    end = points[away >= _END * away.max()]
    middle = (end.min(axis=0) + end.max(axis=0)) / 2.0
    distance = float(np.linalg.norm(middle))
    if any(part is None for part in parts) or distance <= _ONE_SIDED * away.max():
        return None
    direction = middle / distance
    return np.round(direction * float((points @ direction).max()), 6)


def tool_at_end(tip: str, origin: Placement, looks: Iterable[Sequence[Visual]]) -> Tool:
    """Return the tool at the end of the first of `looks` that has one, else at the `origin` of the link `tip`."""
    ends = (end_of(shapes) for shapes in looks)
    end = next((each for each in ends if each is not None), None)
    if end is None:
        rule = f"at the origin of {tip}, because the file has neither a tip frame nor a readable shape that has an end"
        return Tool(origin, rule, False)
    seen = meters(origin.R.T @ (end - origin.p))
    return Tool(
        Placement(origin.R, end),
        f"at {seen} in the frame of {tip}, where its shape ends, because the file has no tip frame",
    )


def meters(p: Floats) -> str:
    """Return a point in m as a text, to the tenth of a millimetre."""
    return " ".join(f"{x:.4g}" for x in np.round(p, 4) + 0.0) + " m"


def _points(shape: Visual) -> Floats | None:
    """Return points of the hull of a shape, (k, 3) [m], in the frame in which it is placed; None if unreadable."""
    size = shape.size
    match shape.shape:
        case "box":
            points = _CORNERS * size
        case "sphere":
            points = _BALL * size[0]
        case "ellipsoid":
            points = _BALL * size
        case "cylinder" | "capsule":
            round_ = _RIM if shape.shape == "cylinder" else _BALL
            points = np.concatenate([round_ * size[0] + end * size[1] / 2.0 * _Z for end in (-1.0, 1.0)])
        case _:
            try:
                points = read_mesh(shape.file, shape.size)[0]
            except Exception:  # no reader installed, or one of a foreign format, which may raise anything
                return None
    return points @ shape.rotation.T + shape.offset if len(points) else None
