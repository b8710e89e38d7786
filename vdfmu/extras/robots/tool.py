"""Place of an imported arm's tool: given by the user or a frame of the file, or else at the end of the last link."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import product
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from vdfmu.arm.robot.visual import Visual, read_mesh
from vdfmu.base.arrays import Floats
from vdfmu.base.errors import UsageError
from vdfmu.extras.robots.tree import Placement, roll_pitch_yaw

_END = 0.9
"""Where the end of a link begins, as a fraction of its largest distance from the joint."""
_ONE_SIDED = 0.1
"""Smallest distance of this end's centre from the joint, as a fraction of that distance; below it there is no end."""
_CORNERS = np.array([*product((-1.0, 1.0), repeat=3)])


class Tool(NamedTuple):
    """Placement of {O} in the frame of the last body, and the rule behind it as the end of a sentence."""

    placement: Placement
    rule: str
    chosen: bool = True
    """Whether its place comes from the user, the file or the shape of a link, not from a default."""


def read_placement(numbers: npt.ArrayLike) -> Placement:
    """Return the placement x, y, z [m], and roll, pitch, yaw [rad] if given; UsageError for other numbers."""
    try:
        values = np.array(numbers, dtype=float)
    except (TypeError, ValueError):
        values = np.zeros(0)
    if values.shape not in ((3,), (6,)) or not np.isfinite(values).all():
        raise UsageError(
            f"tool: expected 3 numbers in m, or 6 with roll, pitch and yaw in rad, got {numbers!r:.60}. The command "
            "line needs quotes: --tool '0 0 0.1'."
        )
    return Placement(roll_pitch_yaw(values[3:] if values.size == 6 else np.zeros(3)), values[:3])


def tool_at_end(tip: str, origin: Placement, shapes: Sequence[Visual]) -> Tool:
    """Return the tool at the far end of the last link with these shapes, or else at the `origin` of the link `tip`.

    The end is the part that is farthest from the joint, and the point lies on the line from the joint through the
    middle of that part. A link has no end if it has no shapes, has a mesh that cannot be read, or extends to all sides
    of its joint. Shapes and `origin` are in the frame of the joint.
    """
    try:
        points = np.concatenate([_points(shape) for shape in shapes] or [np.zeros((1, 3))])
    except Exception:  # from a mesh without an installed reader, or from a reader, which may raise anything
        points = np.zeros((1, 3))
    away = np.linalg.norm(points, axis=1)
    end = points[away >= _END * away.max()]
    middle = (end.min(axis=0) + end.max(axis=0)) / 2.0
    distance = float(np.linalg.norm(middle))
    if distance <= _ONE_SIDED * away.max():
        rule = f"at the origin of {tip}, because the file has neither a tip frame nor a readable shape that has an end"
        return Tool(origin, rule, False)
    p = np.round(middle / distance * float((points @ middle).max() / distance), 6)
    where = meters(origin.R.T @ (p - origin.p))
    rule = f"at {where} in the frame of {tip}, where its shape ends, because the file has no tip frame"
    return Tool(Placement(origin.R, p), rule)


def meters(p: Floats) -> str:
    """Return a point in m as a text, to the tenth of a millimetre."""
    return " ".join(f"{x:.4g}" for x in np.round(p, 4) + 0.0) + " m"


def _points(shape: Visual) -> Floats:
    """Return the corners of a mesh, or of the box about another shape, (k, 3) [m], in the frame of the joint."""
    size = shape.size
    match shape.shape:
        case "mesh":
            points, _ = read_mesh(shape.file, size)
        case "box":
            points = _CORNERS * size / 2.0
        case "cylinder" | "capsule":
            points = _CORNERS * [size[0], size[0], size[1] / 2.0 + size[0] * (shape.shape == "capsule")]
        case _:
            points = _CORNERS * size  # radius of a sphere, half-axes of an ellipsoid
    return points @ shape.rotation.T + shape.offset
