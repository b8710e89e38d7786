"""Layout of a system's diagram: columns of cards, and a wire for each vector.

A wire runs from the vector of a source to its sinks by horizontal and vertical lines: directly to the next column, and
below the cards to all others. All lengths are in pixels, y is downwards.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from itertools import count, pairwise
from typing import NamedTuple

Port = tuple[str, str]
"""A component, and the name of a scalar, or of an array without indices."""
Point = tuple[float, float]

HEAD, ROW = 50.0, 24.0
"""Heights of the head of a card, and of a connector."""
STUB, LANE, EDGE = 124.0, 9.0, 14.0
"""Lengths of a wire before its lane, with space for its width and value, between lanes, and of margins."""
_GAP = 30.0
"""Distance of cards in a column."""
LETTER = 0.62
"""Width of a letter of a wide sans-serif relative to its size."""


class Net(NamedTuple):
    """The vector of a source and the ports that read it or elements of it."""

    start: Port
    ends: Sequence[Port]
    width: str
    """Size of the vector as text, ``6`` or ``6 × 6``."""


@dataclass
class Card:
    """A component with its connected vectors and its position."""

    name: str
    words: str = ""
    inputs: list[str] = field(default_factory=list)
    outputs: list[str] = field(default_factory=list)
    free: Mapping[str, Sequence[str]] = field(default_factory=dict)
    """Names of free vectors by kind."""
    icon: bytes | None = None
    x: float = 0.0
    y: float = 0.0
    width: float = 0.0
    column: int = 0

    @property
    def height(self) -> float:
        """Height of the card."""
        return HEAD + ROW * max(len(self.inputs), len(self.outputs)) + (16.0 if any(self.free.values()) else 4.0)

    def port(self, kind: str, name: str) -> float:
        """Return the height of a port below the top of its card."""
        return HEAD + ROW * ((self.inputs if kind == "input" else self.outputs).index(name) + 0.5)


class Wire(NamedTuple):
    """A drawn net."""

    net: Net
    source: str
    lines: list[list[Point]]
    dots: list[Point]
    """Branches of its lines."""


class PlacedSystem(NamedTuple):
    """Wires between the placed cards, and the size of the picture."""

    wires: list[Wire]
    width: float
    height: float


def arrange(cards: Sequence[Card], nets: Sequence[Net], ordered: bool = False) -> PlacedSystem:
    """Place every card and return the wires. If `ordered`, the cards are placed from left to right."""
    by_name = {card.name: card for card in cards}
    order = list(by_name) if ordered else _order(list(by_name), nets)
    for name in order:
        before = [
            net.start[0]
            for net in nets
            for end, _ in net.ends
            if end == name and order.index(net.start[0]) < order.index(name)
        ]
        by_name[name].column = 1 + max((by_name[source].column for source in before), default=-1)
    columns: list[list[Card]] = [[] for _ in range(1 + max((card.column for card in cards), default=0))]
    for name in order:
        columns[by_name[name].column].append(by_name[name])
    return _DiagramLayout(columns, nets).placed()


def _order(names: Sequence[str], nets: Sequence[Net]) -> list[str]:
    """Return an order in which components follow their sources, as far as there is no loop."""
    sources = {name: {net.start[0] for net in nets for end, _ in net.ends if end == name} - {name} for name in names}
    order, left = list[str](), list(names)
    while left:
        order.append(next((name for name in left if sources[name].isdisjoint(left)), left[0]))
        left.remove(order[-1])
    return order


class _DiagramLayout:
    """Lanes and lines of nets between columns of cards. Gap k is to the right of column k."""

    def __init__(self, columns: Sequence[Sequence[Card]], nets: Sequence[Net]) -> None:
        self.columns, self.nets = columns, nets
        self.cards = {card.name: card for column in columns for card in column}
        self.around = [[end for end in net.ends if self._gap(net, end) != 1] for net in nets]
        """Ends that each net reaches below all cards."""
        self.lanes: dict[int, float] = {}
        self.entries: dict[tuple[int, int], float] = {}

    def _gap(self, net: Net, end: Port) -> int:
        """Return how many columns an end is to the right of its source."""
        return self.cards[end[0]].column - self.cards[net.start[0]].column

    def placed(self) -> PlacedSystem:
        """Place the cards and return the wires."""
        bottom = self._stack()
        width = self._spread()
        tracks = self._tracks(bottom)
        wires = [self._wire(i, tracks) for i in range(len(self.nets))]
        return PlacedSystem(wires, width, max([bottom, *tracks.values()]) + EDGE)

    def _stack(self) -> float:
        """Stack cards near the height of their inputs, and return the lowest edge."""
        bottom = 0.0
        for column in self.columns:
            y = 0.0
            for card in column:
                pairs = [(net, end) for net in self.nets for end in net.ends if end[0] == card.name]
                heights = sorted(
                    self._leaves(net) - card.port("input", end[1]) for net, end in pairs if self._gap(net, end) == 1
                )
                card.y = max(y + (_GAP if y else 0.0), heights[len(heights) // 2] if heights else 0.0)
                y = card.y + card.height
            bottom = max(bottom, y)
        return bottom

    def _leaves(self, net: Net) -> float:
        card = self.cards[net.start[0]]
        return card.y + card.port("output", net.start[1])

    def _goal(self, end: Port) -> float:
        card = self.cards[end[0]]
        return card.y + card.port("input", end[1])

    def _spread(self) -> float:
        """Place the columns of cards with gaps as wide as their lanes, and return the width."""
        x = EDGE
        for gap in range(-1, len(self.columns)):
            if gap >= 0:
                width = max((card_width(card) for card in self.columns[gap]), default=0.0)
                for card in self.columns[gap]:
                    card.x, card.width = x, width
                x += width
            leaving = {
                i: (self._leaves(net), [1e9 if end in self.around[i] else self._goal(end) for end in net.ends])
                for i, net in enumerate(self.nets)
                if self.cards[net.start[0]].column == gap
            }
            turned = [i for i, (y, goals) in leaving.items() if any(abs(goal - y) > 0.5 for goal in goals)]
            down = sorted((i for i in turned if max(leaving[i][1]) > leaving[i][0]), key=lambda i: -leaving[i][0])
            up = sorted((i for i in turned if i not in down), key=lambda i: leaving[i][0])
            x += STUB if leaving else 0.0
            for i in _lane_order([*up, *down], leaving):
                self.lanes[i] = x
                x += LANE
            for i, ends in enumerate(self.around):
                if any(self.cards[end].column == gap + 1 for end, _ in ends):
                    self.entries[i, gap + 1] = x = x + LANE
            x += EDGE
        return x

    def _tracks(self, bottom: float) -> dict[int, float]:
        """Return the height of each path below the cards: short paths on top, overlapping paths below each other."""
        reach = {
            i: [self.lanes[i], *(self.entries[i, self.cards[end].column] for end, _ in ends)]
            for i, ends in enumerate(self.around)
            if ends
        }
        tracks: dict[int, float] = {}
        taken = defaultdict[int, list[tuple[float, float]]](list)
        for i in sorted(reach, key=lambda k: max(reach[k]) - min(reach[k])):
            low, high = min(reach[i]), max(reach[i])
            level = next(k for k in count() if all(high + 4 < a or b + 4 < low for a, b in taken[k]))
            taken[level].append((low, high))
            tracks[i] = bottom + 1.6 * EDGE + 12.0 * level
        return tracks

    def _wire(self, i: int, tracks: Mapping[int, float]) -> Wire:
        """Return the lines of a net from the source to every sink."""
        net, card, lines = self.nets[i], self.cards[self.nets[i].start[0]], list[list[Point]]()
        start = (card.x + card.width, self._leaves(net))
        for end in net.ends:
            card, goal, path = self.cards[end[0]], self._goal(end), [start]
            if end in self.around[i]:
                x, low, entry = self.lanes[i], tracks[i], self.entries[i, card.column]
                path += [(x, start[1]), (x, low), (entry, low), (entry, goal)]
            elif abs(goal - start[1]) > 0.5:
                path += [(self.lanes[i], start[1]), (self.lanes[i], goal)]
            lines.append([*path, (card.x, goal)])
        return Wire(net, net.start[0], lines, _branches(lines))


def _lane_order(nets: Sequence[int], leaving: Mapping[int, tuple[float, list[float]]]) -> Iterator[int]:
    """Yield nets so that one that starts at a height precedes those that end there. Cycles start with the first."""
    left = list(nets)
    while left:
        free = (i for i in left if not any(abs(leaving[j][0] - y) < 0.5 for j in left if j != i for y in leaving[i][1]))
        chosen = next(free, left[0])
        left.remove(chosen)
        yield chosen


def card_width(card: Card) -> float:
    """Return the width of a card for its name next to an icon and the connectors on both sides."""
    longest = [max((len(name) for name in names), default=0) for names in (card.inputs, card.outputs)]
    free = len(free_words(card))
    return max(120.0, 58.0 + LETTER * 14.0 * len(card.name), 58.0 + LETTER * 12.0 * len(card.words),
               44.0 + LETTER * 13.0 * sum(longest), 20.0 + LETTER * 11.0 * free)  # fmt: skip


def free_words(card: Card) -> str:
    """Return the number of free vectors of a card as a text."""
    counts = ((len(names), kind) for kind, names in card.free.items() if names)
    words = ", ".join(f"{count} {kind}{'s' if count > 1 else ''}" for count, kind in counts)
    return f"{words} free" if words else ""


def _branches(lines: Sequence[Sequence[Point]]) -> list[Point]:
    """Return the branches of lines: at least three directions meet there."""
    ways: dict[Point, set[tuple[int, int]]] = {}
    pieces = {(a, b) for line in lines for a, b in pairwise(line) if a != b}
    for corner in {point for piece in pieces for point in piece}:
        for a, b in pieces:
            if all(min(p, q) <= c <= max(p, q) for c, p, q in zip(corner, a, b, strict=True)):
                ways.setdefault(corner, set()).update(_direction(corner, end) for end in (a, b) if end != corner)
    return sorted(point for point, directions in ways.items() if len(directions) > 2)


def _direction(start: Point, end: Point) -> tuple[int, int]:
    dx, dy = end[0] - start[0], end[1] - start[1]
    return (dx > 0) - (dx < 0), (dy > 0) - (dy < 0)


def vectors(names: Iterable[str]) -> dict[str, list[str]]:
    """Return the names of scalars and elements of arrays by the name without indices."""
    groups: dict[str, list[str]] = {}
    for name in names:
        groups.setdefault(name.partition("[")[0], []).append(name)
    return groups
