"""Paths of the connections in the diagram of a system: horizontal and vertical lines in lanes between the boxes."""

from __future__ import annotations

from vdfmu.ssp.description import Link, SystemDescription

__all__ = ["Router"]

_LANE = 5.0
"""Distance of two lanes [mm]."""
_MARGIN = 12.0
"""Distance of the outermost lane from a box, and of the canvas from what is on it [mm]."""

Key = tuple[str, ...]


class Router:
    """Paths of all connections.

    The boxes stand in columns. All signals of a group leave their box to the right into one lane, which is vertical,
    and end in the lane of the group in front of the target. To the next column the two are one. To others
    they go through a horizontal lane below the boxes in between.

    Attributes
    ----------
    canvas : tuple of float [mm]
        Lower left and upper right corner of all.
    """

    def __init__(self, description: SystemDescription) -> None:
        self._corners = description.corners
        self._columns = list(description.corners)
        self._gaps: dict[int, list[list[Key]]] = {}  # gap to the lanes at its left, and those at its right
        self._channels: dict[Key, float] = {}
        for source, targets in description.groups.items():
            self._plan(source, targets)
        lanes = {gap: (list(dict.fromkeys(a)), list(dict.fromkeys(b))) for gap, (a, b) in self._gaps.items()}
        self._lanes: dict[Key, float] = {}
        for gap, (left, right) in lanes.items():
            start = self._corners[self._columns[gap]][2]
            for k, key in enumerate(left):
                self._lanes[key] = start + _MARGIN + k * _LANE
            for k, key in enumerate(right):
                end = self._corners[self._columns[gap + 1]][0]
                self._lanes[key] = end - _MARGIN - (len(right) - 1 - k) * _LANE
        corners = list(self._corners.values())
        low = min([corner[1] for corner in corners] + list(self._channels.values()))
        right = max([corner[2] for corner in corners] + list(self._lanes.values()))
        self.canvas = (
            min(corner[0] for corner in corners) - _MARGIN,
            low - _MARGIN,
            right + _MARGIN,
            max(corner[3] for corner in corners) + 2 * _MARGIN,
        )

    def _plan(self, source: str, targets: list[str]) -> None:
        column = self._columns.index(source.split(".")[0])
        self._lanes_of(column)[0].append(("out", source))
        for target in targets:
            other = self._columns.index(target.split(".")[0])
            if other == column + 1:
                continue
            self._lanes_of(other - 1)[1].append(("in", source, self._columns[other]))
            channel = ("forward" if other > column else "back", source)
            if channel not in self._channels:
                taken = sum(key[0] == channel[0] for key in self._channels)
                below = self._columns[column + 1 : other] if other > column else self._columns
                lowest = min(self._corners[unit][1] for unit in below)
                self._channels[channel] = lowest - _MARGIN - taken * _LANE

    def _lanes_of(self, gap: int) -> list[list[Key]]:
        return self._gaps.setdefault(gap, [[], []])

    def path(self, link: Link, start_height: float, end_height: float) -> list[tuple[float, float]]:
        """Bends of a connection [mm], from its start to its end, without these two.

        Parameters
        ----------
        link : Link
        start_height, end_height : float [mm]
            Where the two connectors are.
        """
        source, target = link.start[0], link.end[0]
        group = f"{source}.{link.start[1].group}"
        out = self._lanes[("out", group)]
        step = self._columns.index(target) - self._columns.index(source)
        if step == 1:
            return [(out, start_height), (out, end_height)]
        into = self._lanes[("in", group, target)]
        y = self._channels[("forward" if step > 0 else "back", group)]
        return [(out, start_height), (out, y), (into, y), (into, end_height)]
