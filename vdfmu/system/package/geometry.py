"""Paths of the connections in the diagram of a system: horizontal and vertical lines in lanes between the boxes."""

from __future__ import annotations

from collections.abc import Mapping

from vdfmu.system.package.description import SystemDescription

_LANE = 5.0
"""Distance of two lanes [mm]."""
_MARGIN = 12.0
"""Distance of the outermost lane from a box, and of the canvas from what is on it [mm]."""

Bends = list[tuple[float, float]]


def route(
    description: SystemDescription, heights: Mapping[tuple[str, str], float]
) -> tuple[list[Bends], tuple[float, float, float, float]]:
    """Return the bends of every connection [mm], without its ends, and the corners of the canvas.

    The boxes stand in columns. All signals of a group leave their box to the right into one lane. To the next column it
    leads to the connectors, at `heights` [mm] by component and connector; to others by a lane below all boxes and one
    in front of the target.
    """
    corners, columns = description.corners, list(description.corners)
    bottom = min(corner[1] for corner in corners.values())
    behind: dict[tuple[str, str], float] = {}  # component and group to the lane
    below: dict[tuple[str, str], float] = {}
    before: dict[tuple[str, str, str], float] = {}
    for (source, start), (target, _) in reversed([(link.start, link.end) for link in description.links]):
        if columns.index(target) != columns.index(source) + 1:
            taken = sum(component == target for component, *_ in before)
            x_end = corners[target][0] - _MARGIN - taken * _LANE
            before.setdefault((target, source, start.group), x_end)
    paths: list[Bends] = []
    for link in description.links:
        (source, start), (target, end) = link.start, link.end
        taken = sum(component == source for component, _ in behind)
        x = behind.setdefault((source, start.group), corners[source][2] + _MARGIN + taken * _LANE)
        y, y_end = heights[source, start.name], heights[target, end.name]
        x_end = before.get((target, source, start.group))
        if x_end is None:
            paths.append([(x, y), (x, y_end)])
        else:
            low = below.setdefault((source, start.group), bottom - _MARGIN - len(below) * _LANE)
            paths.append([(x, y), (x, low), (x_end, low), (x_end, y_end)])
    points = [(c[k], c[k + 1]) for c in corners.values() for k in (0, 2)] + [p for path in paths for p in path]
    xs, ys = zip(*points, strict=True)
    return paths, (min(xs) - _MARGIN, min(ys) - _MARGIN, max(xs) + _MARGIN, max(ys) + 2 * _MARGIN)
