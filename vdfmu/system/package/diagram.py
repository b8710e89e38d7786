"""Layout of the diagram of a system: columns of cards, a wire for each vector.

A wire runs from the vector of a source to its sinks by horizontal and vertical lines: straight to the next column,
between the cards of a column, and back below all cards. All lengths are pixels, y downwards.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from itertools import pairwise
from typing import NamedTuple

Port = tuple[str, str]
"""A component, and the name of a scalar or of an array without its indices."""
Point = tuple[float, float]

HEAD, ROW = 50.0, 24.0
"""Heights of the head of a card, and of a connector or a wire between cards."""
STUB, LANE, EDGE = 124.0, 9.0, 14.0
"""Lengths of a wire before its lane, with room for its width and value, between lanes, and of margins."""
_GAP = 30.0
"""Distance of cards in a column."""
LETTER = 0.62
"""Width of a letter of a wide sans-serif over its size."""


class Net(NamedTuple):
    """The vector of a source and the ports that read it or elements of it."""

    start: Port
    ends: Sequence[Port]
    width: str
    """Size of the vector, ``6`` or ``6 × 6``."""


@dataclass
class Card:
    """A component with its connected vectors and its place."""

    name: str
    words: str = ""
    inputs: list[str] = field(default_factory=list)
    outputs: list[str] = field(default_factory=list)
    free: Mapping[str, Sequence[str]] = field(default_factory=dict)
    """Names of free vectors by their kind."""
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
    """Wires among the placed cards, and the size of the picture."""

    wires: list[Wire]
    width: float
    height: float


def arrange(cards: Sequence[Card], nets: Sequence[Net], ordered: bool = False) -> PlacedSystem:
    """Place every card and return the wires. `ordered`: the cards stand from left to right."""
    by_name = {card.name: card for card in cards}
    order = list(by_name) if ordered else _order(list(by_name), nets)
    for name in order:
        before = [
            net.start[0] for net in nets for end, _ in net.ends
            if end == name and order.index(net.start[0]) < order.index(name)
        ]  # fmt: skip
        by_name[name].column = 1 + max((by_name[source].column for source in before), default=-1)
    columns: list[list[Card]] = [[] for _ in range(1 + max((card.column for card in cards), default=0))]
    for name in order:
        columns[by_name[name].column].append(by_name[name])
    return _DiagramLayout(columns, nets).placed()


def _order(names: Sequence[str], nets: Sequence[Net]) -> list[str]:
    """Return an order with few backward vectors: as declared, or by Eades, Lin and Smyth (1993) if fewer."""
    edges = [(net.start[0], end) for net in nets for end in {end for end, _ in net.ends} if end != net.start[0]]

    def backward(order: Sequence[str]) -> int:
        return sum(order.index(a) > order.index(b) for a, b in edges)

    first, last, left = list[str](), list[str](), list(names)
    while left:
        inside = [(a, b) for a, b in edges if a in left and b in left]
        out = {name: sum(a == name for a, _ in inside) for name in left}
        into = {name: sum(b == name for _, b in inside) for name in left}
        sink = next((name for name in reversed(left) if not out[name] and into[name]), None)
        if sink is not None:
            last.insert(0, sink)
            left.remove(sink)
            continue
        chosen = next((name for name in left if not into[name]), None) or max(left, key=lambda n: out[n] - into[n])
        first.append(chosen)
        left.remove(chosen)
    return min(list(names), first + last, key=backward)


class _DiagramLayout:
    """Heights, lanes and lines of nets between columns of cards. Gap k is right of column k."""

    def __init__(self, columns: Sequence[Sequence[Card]], nets: Sequence[Net]) -> None:
        self.columns, self.nets = columns, nets
        self.cards = cards = {card.name: card for column in columns for card in column}
        self.first = [cards[net.start[0]].column for net in nets]
        self.last = [max(cards[end].column for end, _ in net.ends) for net in nets]
        self.backs = [
            [(end, port) for end, port in net.ends if cards[end].column <= first]
            for net, first in zip(nets, self.first, strict=True)
        ]
        self.passes: dict[tuple[int, int], float] = {}
        """Net and column to the height of the net between its cards."""
        self.leaving: dict[tuple[int, int], tuple[float, list[float]]] = {}
        """Net and gap to the height of the start, and heights of the ends."""
        self.lanes: dict[tuple[int, int], float] = {}
        self.entries: dict[tuple[int, int], float] = {}

    def placed(self) -> PlacedSystem:
        """Place the cards and return the wires."""
        bottom = self._stack()
        width = self._spread()
        tracks = self._tracks(bottom)
        wires = [self._wire(i, tracks) for i in range(len(self.nets))]
        return PlacedSystem(wires, width, max([bottom, *tracks.values()]) + EDGE)

    def _stack(self) -> float:
        """Stack cards near the height of their inputs, and wires between them. Return the lowest edge."""
        bottom = 0.0
        for k, column in enumerate(self.columns):
            wanted: list[tuple[float, int, Card | int]] = []
            for place, card in enumerate(column):
                heights = [
                    self._leaves(i, k) - card.port("input", port)
                    for i, net in enumerate(self.nets) for end, port in net.ends
                    if end == card.name and self.first[i] < k
                ]  # fmt: skip
                wanted.append((sorted(heights)[len(heights) // 2] if heights else -1e9, place, card))
            crossing = [i for i in range(len(self.nets)) if self.first[i] < k < self.last[i]]
            wanted += [(self._leaves(i, k) - ROW / 2.0, len(column) + i, i) for i in crossing]
            y, below = 0.0, 0.0  # `below`: distance of a wire to a card above it
            for height, _, item in sorted(wanted, key=lambda item: item[:2]):
                if isinstance(item, Card):
                    item.y = max(y + (_GAP if y else 0.0), height)
                    y, below = item.y + item.height, ROW / 3.0
                else:
                    self.passes[item, k] = max(y + below, height) + ROW / 2.0
                    y, below = self.passes[item, k] + ROW / 2.0, 0.0
            bottom = max(bottom, y)
        return bottom

    def _leaves(self, i: int, column: int) -> float:
        """Return the height of a net before a column: from its source, or in the column before."""
        card, port = self.cards[self.nets[i].start[0]], self.nets[i].start[1]
        return card.y + card.port("output", port) if card.column == column - 1 else self.passes[i, column - 1]

    def _spread(self) -> float:
        """Place the columns of cards with gaps as wide as their lanes. Return the width."""
        for i, net in enumerate(self.nets):
            for gap in range(self.first[i], max(self.first[i] + 1, self.last[i])):
                goals = [self._goal(end) for end in net.ends if self.cards[end[0]].column == gap + 1]
                goals += [self.passes[i, gap + 1]] if (i, gap + 1) in self.passes else []
                goals += [1e9] if gap == self.first[i] and self.backs[i] else []
                self.leaving[i, gap] = (self._leaves(i, gap + 1), goals)
        x = EDGE
        for gap in range(-1, len(self.columns)):
            if gap >= 0:
                width = max((card_width(card) for card in self.columns[gap]), default=0.0)
                for card in self.columns[gap]:
                    card.x, card.width = x, width
                x += width
            leaving = {i: self.leaving[i, g] for i, g in self.leaving if g == gap}
            turned = [i for i, (y, goals) in leaving.items() if any(abs(goal - y) > 0.5 for goal in goals)]
            down = sorted((i for i in turned if max(leaving[i][1]) > leaving[i][0]), key=lambda i: -leaving[i][0])
            up = sorted((i for i in turned if i not in down), key=lambda i: leaving[i][0])
            x += STUB if leaving else 0.0
            for i in _lane_order([*up, *down], leaving):
                self.lanes[i, gap] = x
                x += LANE
            for i, ends in enumerate(self.backs):
                if any(self.cards[end].column == gap + 1 for end, _ in ends):
                    self.entries[i, gap] = x = x + LANE
            x += EDGE
        return x

    def _goal(self, end: Port) -> float:
        card = self.cards[end[0]]
        return card.y + card.port("input", end[1])

    def _tracks(self, bottom: float) -> dict[int, float]:
        """Return the height of each backward path: short paths above, overlapping paths below each other."""
        spans: dict[int, tuple[float, float]] = {}
        for i, ends in enumerate(self.backs):
            if ends:
                xs = [self.lanes[i, self.first[i]]]
                xs += [self.entries[i, self.cards[end].column - 1] for end, _ in ends]
                spans[i] = (min(xs), max(xs))
        taken: list[list[tuple[float, float]]] = []
        tracks: dict[int, float] = {}
        for i in sorted(spans, key=lambda k: spans[k][1] - spans[k][0]):
            low, high = spans[i]
            free = (k for k, intervals in enumerate(taken) if all(high + 4 < a or b + 4 < low for a, b in intervals))
            level = next(free, len(taken))
            if level == len(taken):
                taken.append([])
            taken[level].append((low, high))
            tracks[i] = bottom + 1.6 * EDGE + 12.0 * level
        return tracks

    def _wire(self, i: int, tracks: Mapping[int, float]) -> Wire:
        """Return the lines of a net from the source to every sink."""
        net, card, lines = self.nets[i], self.cards[self.nets[i].start[0]], list[list[Point]]()
        start = (card.x + card.width, card.y + card.port("output", net.start[1]))
        for end in net.ends:
            card, goal, path = self.cards[end[0]], self._goal(end), [start]
            if end in self.backs[i]:
                x, low, entry = self.lanes[i, self.first[i]], tracks[i], self.entries[i, card.column - 1]
                path += [(x, start[1]), (x, low), (entry, low), (entry, goal)]
            else:
                for gap in range(self.first[i], card.column):
                    y = self.leaving[i, gap][0]
                    to = goal if gap + 1 == card.column else self.passes[i, gap + 1]
                    if abs(to - y) > 0.5:
                        path += [(self.lanes[i, gap], y), (self.lanes[i, gap], to)]
            lines.append([*path, (card.x, goal)])
        return Wire(net, net.start[0], lines, _branches(lines))


def _lane_order(nets: Sequence[int], leaving: Mapping[int, tuple[float, list[float]]]) -> Iterator[int]:
    """Yield nets so that a net that starts at a height precedes nets that end there. A cycle starts with its first."""
    left = list(nets)
    while left:
        free = (i for i in left if not any(abs(leaving[j][0] - y) < 0.5 for j in left if j != i for y in leaving[i][1]))
        chosen = next(free, left[0])
        left.remove(chosen)
        yield chosen


def card_width(card: Card) -> float:
    """Return the width of a card: its name beside an icon, and its connectors on both sides."""
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
