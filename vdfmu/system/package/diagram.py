"""Places of cards and wires in the diagram of a system: columns of cards, a wire for each vector.

A wire goes from the vector of a source to its sinks by horizontal and vertical lines: to the next column straight, past
a column between its cards, and back below all cards. All lengths are pixels, y downwards.
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
"""Heights of the head of a card, and of a connector, or a wire that passes a column."""
STUB, LANE, EDGE = 124.0, 9.0, 14.0
"""Lengths: of a wire in front of its lane, with room for its width and value; from lane to lane; and of margins."""
_GAP = 30.0
"""Between two cards of a column."""
LETTER = 0.62
"""Width of a letter over its size, of a wide sans-serif."""


class Net(NamedTuple):
    """The vector of a source and the ports that get it, or elements of it."""

    start: Port
    ends: Sequence[Port]
    width: str
    """Size of the vector, ``6`` or ``6 × 6``."""


@dataclass
class Card:
    """A component with its connected vectors, and where it stands."""

    name: str
    words: str = ""
    inputs: list[str] = field(default_factory=list)
    outputs: list[str] = field(default_factory=list)
    free: Mapping[str, Sequence[str]] = field(default_factory=dict)
    """Names of vectors that are not connected, by their kind."""
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
    """A net as it is drawn."""

    net: Net
    source: str
    lines: list[list[Point]]
    dots: list[Point]
    """Where lines of it branch."""


class PlacedSystem(NamedTuple):
    """Wires among the placed cards, and the size of the picture."""

    wires: list[Wire]
    width: float
    height: float


def arrange(cards: Sequence[Card], nets: Sequence[Net], ordered: bool = False) -> PlacedSystem:
    """Give every card its place, and return the wires between them; `ordered`: the cards stand from left to right."""
    by_name = {card.name: card for card in cards}
    order = list(by_name) if ordered else _order(list(by_name), nets)
    for name in order:
        before = [
            net.start[0] for net in nets for end, _ in net.ends
            if end == name and order.index(net.start[0]) < order.index(name)
        ]  # fmt: skip
        by_name[name].column = 1 + max((by_name[one].column for one in before), default=-1)
    columns: list[list[Card]] = [[] for _ in range(1 + max((card.column for card in cards), default=0))]
    for name in order:
        columns[by_name[name].column].append(by_name[name])
    passes, bottom = _stack(columns, nets, by_name)
    return _route(columns, nets, by_name, passes, bottom)


def _order(names: Sequence[str], nets: Sequence[Net]) -> list[str]:
    """Return components so that few vectors go back: as declared, or by Eades, Lin and Smyth (1993) if that is less."""
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


def _stack(
    columns: Sequence[Sequence[Card]], nets: Sequence[Net], cards: Mapping[str, Card]
) -> tuple[dict[tuple[int, int], float], float]:
    """Place cards one below the other, near what they get; heights at which a net passes a column; the lowest edge."""
    passes: dict[tuple[int, int], float] = {}
    bottom = 0.0
    for k, column in enumerate(columns):
        crossing = [i for i, net in enumerate(nets) if cards[net.start[0]].column < k < _last_column(net, cards)]
        wanted: list[tuple[float, int, Card | int]] = []
        for place, card in enumerate(column):
            heights = [
                _leaves(i, k, nets, cards, passes) - card.port("input", port)
                for i, net in enumerate(nets) for end, port in net.ends
                if end == card.name and cards[net.start[0]].column < k
            ]  # fmt: skip
            wanted.append((sorted(heights)[len(heights) // 2] if heights else -1e9, place, card))
        wanted += [(_leaves(i, k, nets, cards, passes) - ROW / 2.0, len(column) + i, i) for i in crossing]
        y, below = 0.0, 0.0  # `below`: distance that a wire keeps from a card above it
        for height, _, item in sorted(wanted, key=lambda one: one[:2]):
            if isinstance(item, Card):
                item.y = max(y + (_GAP if y else 0.0), height)
                y, below = item.y + item.height, ROW / 3.0
            else:
                passes[item, k] = max(y + below, height) + ROW / 2.0
                y, below = passes[item, k] + ROW / 2.0, 0.0
        bottom = max(bottom, y)
    return passes, bottom


def _last_column(net: Net, cards: Mapping[str, Card]) -> int:
    return max(cards[end].column for end, _ in net.ends)


def _leaves(
    i: int, column: int, nets: Sequence[Net], cards: Mapping[str, Card], passes: Mapping[tuple[int, int], float]
) -> float:
    """Return the height at which a net comes to a column: from its source, or where it passes the column before."""
    card, port = cards[nets[i].start[0]], nets[i].start[1]
    return card.y + card.port("output", port) if card.column == column - 1 else passes[i, column - 1]


def _route(
    columns: Sequence[Sequence[Card]], nets: Sequence[Net], cards: Mapping[str, Card],
    passes: Mapping[tuple[int, int], float], bottom: float,
) -> PlacedSystem:  # fmt: skip
    """Return the wires, and give the cards their columns: each gap is as broad as its lanes need."""
    backs = [[(end, port) for end, port in net.ends if cards[end].column <= cards[net.start[0]].column] for net in nets]
    leaving: dict[tuple[int, int], tuple[float, list[float]]] = {}
    """Net and gap to the height from which it comes, and those to which it goes; a gap is right of its column."""
    for i, net in enumerate(nets):
        first = cards[net.start[0]].column
        for gap in range(first, max(first + 1, _last_column(net, cards))):
            goals = [cards[end].y + cards[end].port("input", p) for end, p in net.ends if cards[end].column == gap + 1]
            goals += [passes[i, gap + 1]] if (i, gap + 1) in passes else []
            goals += [1e9] if gap == first and backs[i] else []
            leaving[i, gap] = (_leaves(i, gap + 1, nets, cards, passes), goals)
    lanes: dict[tuple[int, int], float] = {}
    entries: dict[tuple[int, int], float] = {}
    x = EDGE
    for gap in range(-1, len(columns)):
        if gap >= 0:
            width = max((card_width(card) for card in columns[gap]), default=0.0)
            for card in columns[gap]:
                card.x, card.width = x, width
            x += width
        own = {i: leaving[i, g] for i, g in leaving if g == gap}
        turned = [i for i, (y, goals) in own.items() if any(abs(goal - y) > 0.5 for goal in goals)]
        down = sorted((i for i in turned if max(own[i][1]) > own[i][0]), key=lambda i: -own[i][0])
        up = sorted((i for i in turned if i not in down), key=lambda i: own[i][0])
        x += STUB if own else 0.0
        for i in _lane_order([*up, *down], own):
            lanes[i, gap] = x
            x += LANE
        for i, ends in enumerate(backs):
            if any(cards[end].column == gap + 1 for end, _ in ends):
                entries[i, gap] = x = x + LANE
        x += EDGE
    tracks = _tracks(nets, cards, backs, lanes, entries, bottom)
    wires: list[Wire] = []
    for i, net in enumerate(nets):
        card = cards[net.start[0]]
        start = (card.x + card.width, card.y + card.port("output", net.start[1]))
        wires.append(_wire(net, i, start, cards, passes, leaving, lanes, entries, tracks, backs[i]))
    low = max([bottom, *tracks.values()])
    return PlacedSystem(wires, x, low + EDGE)


def _lane_order(found: Sequence[int], own: Mapping[int, tuple[float, list[float]]]) -> Iterator[int]:
    """Yield nets so that one which comes at a height stands before one that goes at it, and both share no line.

    In a ring of such nets the first is first.
    """
    left = list(found)
    while left:
        free = (i for i in left if not any(abs(own[j][0] - y) < 0.5 for j in left if j != i for y in own[i][1]))
        chosen = next(free, left[0])
        left.remove(chosen)
        yield chosen


def card_width(card: Card) -> float:
    """Return the room that a card needs: its name beside an icon, and its connectors on both sides."""
    longest = [max((len(name) for name in names), default=0) for names in (card.inputs, card.outputs)]
    free = len(free_words(card))
    return max(120.0, 58.0 + LETTER * 14.0 * len(card.name), 58.0 + LETTER * 12.0 * len(card.words),
               44.0 + LETTER * 13.0 * sum(longest), 20.0 + LETTER * 11.0 * free)  # fmt: skip


def free_words(card: Card) -> str:
    """Return how many vectors of a card are not connected, in words."""
    counts = ((len(names), kind) for kind, names in card.free.items() if names)
    words = ", ".join(f"{count} {kind}{'s' if count > 1 else ''}" for count, kind in counts)
    return f"{words} free" if words else ""


def _tracks(
    nets: Sequence[Net], cards: Mapping[str, Card], backs: Sequence[Sequence[Port]],
    lanes: Mapping[tuple[int, int], float], entries: Mapping[tuple[int, int], float], bottom: float,
) -> dict[int, float]:  # fmt: skip
    """Return the height of each net's way back: short ways above, and one below the other where they overlap."""
    spans: dict[int, tuple[float, float]] = {}
    for i, ends in enumerate(backs):
        if ends:
            first = lanes[i, cards[nets[i].start[0]].column]
            xs = [entries[i, cards[end].column - 1] for end, _ in ends]
            spans[i] = (min(first, *xs), max(first, *xs))
    taken: list[list[tuple[float, float]]] = []
    found: dict[int, float] = {}
    for i in sorted(spans, key=lambda one: spans[one][1] - spans[one][0]):
        low, high = spans[i]
        level = next((k for k, own in enumerate(taken) if all(high + 4 < a or b + 4 < low for a, b in own)), len(taken))
        if level == len(taken):
            taken.append([])
        taken[level].append((low, high))
        found[i] = bottom + 1.6 * EDGE + 12.0 * level
    return found


def _wire(
    net: Net, i: int, start: Point, cards: Mapping[str, Card], passes: Mapping[tuple[int, int], float],
    leaving: Mapping[tuple[int, int], tuple[float, list[float]]], lanes: Mapping[tuple[int, int], float],
    entries: Mapping[tuple[int, int], float], tracks: Mapping[int, float], backs: Sequence[Port],
) -> Wire:  # fmt: skip
    """Return the lines of a net: to every sink from where it branches, the first from the source."""
    first = cards[net.start[0]].column
    lines: list[list[Point]] = []
    for end, port in net.ends:
        card = cards[end]
        goal = (card.x, card.y + card.port("input", port))
        path = [start]
        if (end, port) in backs:
            x, low, entry = lanes[i, first], tracks[i], entries[i, card.column - 1]
            path += [(x, start[1]), (x, low), (entry, low), (entry, goal[1])]
        else:
            for gap in range(first, card.column):
                y = leaving[i, gap][0]
                to = goal[1] if gap + 1 == card.column else passes[i, gap + 1]
                if abs(to - y) > 0.5:
                    path += [(lanes[i, gap], y), (lanes[i, gap], to)]
        lines.append([*path, (goal[0], goal[1])])
    return Wire(net, net.start[0], lines, _branches(lines))


def _branches(lines: Sequence[Sequence[Point]]) -> list[Point]:
    """Return the points at which lines from one source part: three directions or more meet there."""
    ways: dict[Point, set[tuple[int, int]]] = {}
    pieces = {(a, b) for line in lines for a, b in pairwise(line) if a != b}
    for corner in {point for piece in pieces for point in piece}:
        for a, b in pieces:
            if _on(corner, a, b):
                ways.setdefault(corner, set()).update(_direction(corner, end) for end in (a, b) if end != corner)
    return sorted(point for point, found in ways.items() if len(found) > 2)


def _on(point: Point, a: Point, b: Point) -> bool:
    return all(min(p, q) <= c <= max(p, q) for c, p, q in zip(point, a, b, strict=True))


def _direction(start: Point, end: Point) -> tuple[int, int]:
    dx, dy = end[0] - start[0], end[1] - start[1]
    return (dx > 0) - (dx < 0), (dy > 0) - (dy < 0)


def vectors(names: Iterable[str]) -> dict[str, list[str]]:
    """Return the names of scalars and of elements of arrays by the name without indices."""
    found: dict[str, list[str]] = {}
    for name in names:
        found.setdefault(name.partition("[")[0], []).append(name)
    return found
