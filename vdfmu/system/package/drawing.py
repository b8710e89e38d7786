"""The diagram of a system as SVG: a card per component, a wire per vector, in light and dark schemes."""

from __future__ import annotations

import base64
import math
import re
from collections.abc import Container, Iterable, Mapping, Sequence
from html import escape
from os.path import commonprefix
from pathlib import Path, PurePosixPath
from typing import TYPE_CHECKING, Any, NamedTuple

from vdfmu.base.errors import SspError
from vdfmu.base.measure import per_cent
from vdfmu.engine.package.archive import Archive
from vdfmu.engine.package.parse import NAMESPACES, parse_xml
from vdfmu.engine.package.read import load_ssp
from vdfmu.system.package.diagram import HEAD, LETTER, Card, Net, Point, Port, Wire, arrange, free_words, vectors

if TYPE_CHECKING:
    from vdfmu.system.package.description import SystemDescription

_COLOURS = 4
"""Number of colours of wires, which depend on the source."""
_STYLE = """
svg.system { font: 13px system-ui, "DejaVu Sans", Arial, sans-serif; color: #24292f; --back: #fff; --card: #f2f5f9;
  --soft: #57606a; --w0: #0b5cad; --w1: #b8500c; --w2: #1a7f37; --w3: #8e3b8c; }
@media (prefers-color-scheme: dark) { svg.system { color: #e6edf3; --back: #18212b; --card: #243040; --soft: #aab4c0;
  --w0: #79b8ff; --w1: #ffa066; --w2: #56d364; --w3: #e3a3e0; } }
.system text { fill: currentColor; } .system .end { text-anchor: end; }
.system .name { font-size: 14px; font-weight: 600; }
.system .soft { fill: var(--soft); font-size: 12px; } .system :is(.width, .value, .free) { font-size: 11px; }
.system :is(.value, .free) { fill: var(--soft); } .system .width { font-weight: 700; }
.system .value { font-variant-numeric: tabular-nums; }
.system .card { fill: var(--card); stroke: currentColor; stroke-width: 1.2; }
.system .w0 { color: var(--w0); } .system .w1 { color: var(--w1); } .system .w2 { color: var(--w2); }
.system .w3 { color: var(--w3); } .system .wire path { fill: none; stroke: currentColor; stroke-width: 1.5; }
.system .wire path { stroke-linejoin: round; } .system .wire path.tip { fill: currentColor; stroke: none; }
.system .wire path.line { stroke-width: var(--width, 1.5px); }
.system .wire circle { fill: currentColor; } .system .wire .held { fill: var(--back); stroke: currentColor; }
"""
_GREEK = dict(
    alpha="α",
    beta="β",
    gamma="γ",
    delta="δ",
    epsilon="ε",
    zeta="ζ",
    eta="η",
    theta="θ",
    kappa="κ",
    mu="μ",
    nu="ν",
    xi="ξ",
    rho="ρ",
    sigma="σ",
    tau="τ",
    phi="φ",
    chi="χ",
    psi="ψ",
    omega="ω",
    ell="ℓ",
)
_MARKS = {"dot": "\u0307", "ddot": "\u0308", "hat": "\u0302"}
_POWERS = {"dddot": "(3)", "ddddot": "(4)"}


_CUTS = ("V_A", "V_B", "V_C", "V_D")
"""Connectors through which an arm's subsystems pass on their velocities."""
_FEWEST = 4
"""Subsystems that are drawn as one box."""
_WIDTHS = (1.5, 1.3, 5.4)
"""Width [px] of a wire whose error is at most a hundredth of the requested one, the increase for a factor of ten, and
the largest width."""
Kinds = Mapping[str, Mapping[str, Sequence[str]]]
"""Component to kind of connector to names."""


class Coupling(NamedTuple):
    """Coupling errors of a judged run, and the requested largest error, relative to the signals' ranges."""

    errors: Mapping[str, float]
    """Errors by ``component.signal``; for an array the largest of its elements."""
    wanted: float

    def width(self, error: float) -> float:
        """Return the width [px] of a wire whose signal has this error."""
        least, more, most = _WIDTHS
        share = 100.0 * error / self.wanted
        return min(least + more * math.log10(share), most) if share > 1.0 else least


_UNJUDGED = Coupling({}, 1.0)


def system_diagram(package: Path, held: Container[str] = (), coupling: Coupling = _UNJUDGED) -> str:
    """Return HTML with the picture of the system in a package, or an empty text.

    `held` inputs read the value of the last step. Errors of `coupling` widen wires. An arm's subsystems are one box,
    and are all drawn in a picture that can be opened. A key explains the colours and the widths.
    """
    if not package.is_file():
        return ""
    try:
        system = load_ssp(package)
    except SspError:
        return ""
    kinds = {
        c.name: {kind: [n for n, port in c.connectors.items() if port.kind == kind] for kind in ("input", "output")}
        for c in system.components
    }
    words = {c.name: PurePosixPath(c.source).stem for c in system.components}
    with Archive(package, package.name) as archive:
        places = _places(parse_xml(archive.read("SystemStructure.ssd"), str(package)))
        sources = (source for *_, source in places.values() if source.endswith(".svg") and source in archive)
        icons = {source: archive.read(source) for source in sources}
    links = [(c.start, c.end) for c in system.connections]
    sizes = {
        (c.name, name): " × ".join(str(size or "n") for size in port.dimensions)
        for c in system.components
        for name, port in c.connectors.items()
        if port.dimensions
    }
    picture = _draw(kinds, words, links, sizes, places, icons, held, coupling)
    boxes = _boxes(links)
    if not boxes:
        return picture + _key(_in_order(kinds, places), links, coupling)
    inside, joined, late, errors = _folded(kinds, links, boxes, held, coupling.errors)
    outer = coupling._replace(errors=errors)
    words |= {box: f"{len(pieces)} pieces" for box, pieces in boxes.items()}
    folded = _draw(inside, words, joined, {}, {}, icons, late, outer)
    count = sum(map(len, boxes.values()))
    whole = f"<details><summary>All {count} pieces of {escape(' and '.join(boxes))}</summary>{picture}</details>"
    return folded + _key([*inside], joined, coupling) + whole


def _boxes(links: Iterable[tuple[Port, Port]]) -> dict[str, list[str]]:
    """Return the subsystems of each arm, which are connected through velocities, by the common start of their names."""
    arms = list[list[str]]()
    for link in links:
        if all(name.partition("[")[0] in _CUTS for _, name in link):
            parts = [part for part, _ in link]
            touched = [arm for arm in arms if {*arm} & {*parts}]
            arms = [arm for arm in arms if arm not in touched] + [list(dict.fromkeys(sum(touched, parts)))]
    names = {commonprefix(arm).rpartition("_")[0] or f"arm {k}": arm for k, arm in enumerate(arms, 1)}
    return {name: sorted(arm) for name, arm in names.items() if len(arm) >= _FEWEST}


def _folded(
    kinds: Kinds,
    links: Iterable[tuple[Port, Port]],
    boxes: Mapping[str, Sequence[str]],
    held: Container[str],
    errors: Mapping[str, float],
) -> tuple[Kinds, list[tuple[Port, Port]], set[str], dict[str, float]]:
    """Return components and links with boxes instead of subsystems; equal connectors of these form a vector.

    Also return the held inputs, and the errors of signals, for each vector the largest.
    """
    late, worst, numbers = set[str](), dict(errors), dict[tuple[str, str, str], dict[str, int]]()
    box_of = {piece: box for box, pieces in boxes.items() for piece in pieces}

    def outside(end: Port, kind: str) -> Port:
        part, name = end
        group, _, index = name.partition("[")
        box = box_of.get(part, part)
        if f"{part}.{group}" in held:
            late.add(f"{box}.{group}")
        if (error := errors.get(f"{part}.{group}")) is not None:
            worst[f"{box}.{group}"] = max(error, worst.get(f"{box}.{group}", 0.0))
        if part not in box_of:
            return end
        places = numbers.setdefault((box, kind, group), {})
        return box, f"{group}[{places.setdefault(part, len(places) + 1)}{f',{index}' if index else ']'}"

    joined = [
        (outside(start, "output"), outside(end, "input"))
        for start, end in links
        if box_of.get(start[0], start) != box_of.get(end[0], end)
    ]
    ports = {
        box: {kind: [link[k][1] for link in joined if link[k][0] == box] for k, kind in enumerate(("output", "input"))}
        for box in boxes
    }
    return {name: each for name, each in kinds.items() if name not in box_of} | ports, joined, late, worst


def _key(order: Sequence[str], links: Iterable[tuple[Port, Port]], coupling: Coupling) -> str:
    """Return the key of the wires' colours, which stand for source components, and of their widths."""
    sources = {start[0] for start, _ in links}
    named = [[name for name in order[k::_COLOURS] if name in sources] for k in range(_COLOURS)]
    line = (
        '<svg class="system" aria-label="{}" width="20" height="10">'
        '<path class="{}" d="M0 5h20" stroke="currentColor" stroke-width="{:g}"/></svg>'
    )
    keys = (
        f"<span>{line.format('Colour', f'w{k}', 1.5)} {escape(', '.join(names))}</span>"
        for k, names in enumerate(named)
        if names
    )
    key = f'<p class="note keys">Wires from: {" ".join(keys)}</p>' if sources else ""
    if not coupling.errors:
        return key
    shares = [coupling.wanted * factor for factor in (0.01, 0.1, 1.0, 10.0)]
    widths = (f"<span>{line.format('Width', '', coupling.width(each))} {per_cent(each)}</span>" for each in shares)
    return (
        f'{key}<p class="note keys">Width: coupling error, {per_cent(coupling.wanted)} wanted: {" ".join(widths)}</p>'
    )


def _places(ssd: Any) -> dict[str, tuple[float, float, str]]:
    """Return the left and top edges of an SSD's components, and the sources of their icons."""
    components = ssd.iterfind("ssd:System/ssd:Elements/ssd:Component", NAMESPACES)
    geometry = {c.get("name"): c.find("ssd:ElementGeometry", NAMESPACES) for c in components}
    return {
        name: (float(place.get("x1")), -float(place.get("y2")), place.get("iconSource", ""))
        for name, place in geometry.items()
        if place is not None
    }


def icon_source(component: str) -> str:
    """Return the name of a component's icon in a package."""
    return f"resources/icons/{component}.svg"


def draw_system(description: SystemDescription, icons: Mapping[str, bytes]) -> str:
    """Return the picture of the system of a scenario. `icons` are SVG files by their sources in its package."""
    signals = {
        name: {kind: description.signals(name, kind) for kind in ("input", "output")} for name in description.tables
    }
    kinds = {name: {kind: [s.name for s in each] for kind, each in ends.items()} for name, ends in signals.items()}
    sizes = {
        (name, s.name): " × ".join(map(str, s.shape))
        for name, ends in signals.items()
        for each in ends.values()
        for s in each
        if s.shape
    }
    words = {name: PurePosixPath(description.fmu_name(name)).stem for name in signals}
    links = [((x.start[0], x.start[1].name), (x.end[0], x.end[1].name)) for x in description.links]
    places = {name: (x, -y, icon_source(name)) for name, (x, _, _, y) in description.corners.items()}
    return _draw(kinds, words, links, sizes, places, icons)


def _in_order(kinds: Kinds, places: Mapping[str, tuple[float, float, str]]) -> list[str]:
    """Return the components from left to right if all have positions, else in the order of declaration."""
    return sorted(kinds, key=places.__getitem__) if all(name in places for name in kinds) else [*kinds]


def _draw(
    kinds: Mapping[str, Mapping[str, Sequence[str]]],
    words: Mapping[str, str],
    links: Iterable[tuple[Port, Port]],
    sizes: Mapping[Port, str],
    places: Mapping[str, tuple[float, float, str]],
    icons: Mapping[str, bytes | None],
    held: Container[str] = (),
    coupling: Coupling = _UNJUDGED,
) -> str:
    """Draw components with connectors by kind, and their links. If all have positions, these order them."""
    if not kinds:
        return ""
    ends: dict[Port, dict[Port, None]] = {}
    late: set[tuple[Port, Port]] = set()
    elements: dict[Port, set[str]] = {}
    for start, end in links:
        source, sink = ((part, name.partition("[")[0]) for part, name in (start, end))
        ends.setdefault(source, {})[sink] = None
        elements.setdefault(source, set()).add(start[1])
        if ".".join(sink) in held:
            late.add((source, sink))
    cards: dict[str, Card] = {}
    ordered = all(name in places for name in kinds)
    for name in _in_order(kinds, places):
        connectors = kinds[name]
        used = {
            "input": dict.fromkeys(port for sinks in ends.values() for component, port in sinks if component == name),
            "output": dict.fromkeys(port for component, port in ends if component == name),
        }
        declared = {kind: vectors(connectors.get(kind, ())) for kind in used}
        # in the order of declaration, then connected but undeclared names
        connected = {kind: [n for n in {**declared[kind], **names} if n in names] for kind, names in used.items()}
        free = {kind: [n for n in names if n not in used[kind]] for kind, names in declared.items()}
        same = "" if words[name].lower() == name.lower() else words[name]
        *_, icon = places.get(name, ("",))
        cards[name] = Card(name, same, connected["input"], connected["output"], free, icons.get(icon))
    nets = [Net(source, list(sinks), sizes.get(source) or _shape(elements[source])) for source, sinks in ends.items()]
    layout = arrange(list(cards.values()), nets, ordered)
    colours = {name: k % _COLOURS for k, name in enumerate(cards)}
    note = '<text class="soft" x="14" y="{:g}">Hollow dot: gets the value of the step before.</text>'
    height = layout.height + (20.0 if late else 0.0)
    return "\n".join(
        [
            f'<svg class="system" xmlns="http://www.w3.org/2000/svg" viewBox="0 -10 {layout.width:g} {height + 10:g}" '
            f'style="width: 100%; min-width: {0.6 * layout.width:.0f}px; max-width: {layout.width:.0f}px" '
            'role="img" aria-label="Diagram of the system">',
            f"<style>{_STYLE}</style>",
            *(_wire(wire, colours[wire.source], late, coupling) for wire in layout.wires),
            *map(_card, cards.values()),
            *([note.format(height - 8.0)] if late else []),
            "</svg>",
        ]
    )


def _shape(names: Iterable[str]) -> str:
    """Return the size of a vector from its connected elements; empty for a scalar."""
    matches = (re.search(r"\[([\d,]+)\]$", name) for name in names)
    indices = [[int(i) for i in match[1].split(",")] for match in matches if match]
    return " × ".join(str(max(index)) for index in zip(*indices, strict=False)) if indices else ""


def _wire(wire: Wire, colour: int, late: Container[tuple[Port, Port]], coupling: Coupling) -> str:
    net = wire.net
    signal = ".".join(net.start)
    ends = ", ".join(".".join(end) for end in net.ends)
    title = f"{signal}{f', {net.width} elements' if net.width else ''}, to {ends}"
    error, judged, wide = coupling.errors.get(signal), "", 0.0
    if error is not None:
        words, width = f"coupling error {per_cent(error)} of its range", coupling.width(error)
        title += f"; {words}"
        judged = f' data-error="{escape(signal)}: {words}." style="--width: {width:.2g}px"'
        wide = 0.5 * (width - _WIDTHS[0])
    lines = ([*line[:-1], (line[-1][0] - 4.0 * wide, line[-1][1])] for line in wire.lines)  # keeps the tip pointed
    path = "".join("M" + "L".join(f"{x:g} {y:g}" for x, y in line) for line in lines)
    marks = [f'<circle cx="{x:g}" cy="{y:g}" r="3"/>' for x, y in wire.dots]
    for end, line in zip(net.ends, wire.lines, strict=True):
        x, y = line[-1]
        tip = 4.0 + wide
        marks.append(f'<path class="tip" d="M{x:g} {y:g}l{-2.0 * tip:g} {-tip:g}v{2.0 * tip:g}z"/>')
        if (net.start, end) in late:
            marks.append(f'<circle class="held" cx="{x - 12 - 2.0 * wide:g}" cy="{y:g}" r="{3 + wide:g}"/>')
    x, y = wire.lines[0][0]
    if net.width:
        marks.append(f'<path d="M{x + 6:g} {y + 4:g}l5 -8"/>')
        marks.append(f'<text class="width" x="{x + 13:g}" y="{y - 4:g}">{net.width}</text>')
    at = x + 13 + (LETTER * 11.0 * len(net.width) + 8 if net.width else 0)
    marks.append(f'<text class="value" x="{at:g}" y="{y - 4 - wide:g}"></text>')
    return (
        f'<g class="wire w{colour}"{judged} data-signal="{escape(signal)}" '
        f'data-ends="{escape(" ".join(".".join(end) for end in net.ends))}"><title>{escape(title)}</title>'
        f'<path class="line" d="{path}"/>{"".join(marks)}</g>'
    )


def _card(card: Card) -> str:
    x, y = card.x, card.y
    parts = [f'<rect class="card" x="{x:g}" y="{y:g}" width="{card.width:g}" height="{card.height:g}" rx="7"/>']
    left = x + 10
    if card.icon is not None:
        data = base64.b64encode(card.icon).decode()
        href = f"data:image/svg+xml;base64,{data}"
        parts.append(f'<image x="{left:g}" y="{y + 8:g}" width="34" height="34" href="{href}"/>')
        left += 42
    middle = y + (HEAD - 10) / 2 + 8
    line = middle - (4 if card.words else 0)
    parts.append(f'<text class="name" x="{left:g}" y="{line:g}">{escape(card.name)}</text>')
    if card.words:
        parts.append(f'<text class="soft" x="{left:g}" y="{middle + 13:g}">{escape(card.words)}</text>')
    for kind, at, style in (("input", x + 10, ""), ("output", x + card.width - 10, "end")):
        for name in card.inputs if kind == "input" else card.outputs:
            parts.append(_label((at, y + card.port(kind, name) + 4), name, style))
    if words := free_words(card):
        names = "; ".join(f"{kind}s {', '.join(unused)}" for kind, unused in card.free.items() if unused)
        title = f"<title>Not connected: {escape(names)}</title>"
        parts.append(f'<text class="free" x="{x + 10:g}" y="{y + card.height - 6:g}">{title}{words}</text>')
    return "\n".join(parts)


def _label(place: Point, name: str, style: str) -> str:
    """Return the label of a variable as in the paper: ``kappa_dot_d`` as κ̇ with index d. Other names are unchanged."""
    first, *rest = name.split("_")
    text = f'<text class="{style}" x="{place[0]:g}" y="{place[1]:g}"><title>{escape(name)}</title>'
    if not (len(first) == 1 or first in _GREEK):
        return f"{text}{escape(name)}</text>"
    marks = "".join(_MARKS[part] for part in rest if part in _MARKS)
    power = "".join(_POWERS[part] for part in rest if part in _POWERS)
    below = ", ".join(part for part in rest if part not in _MARKS and part not in _POWERS)
    small = '<tspan dy="{}" font-size="75%">{}</tspan><tspan dy="{}">&#8203;</tspan>'
    raised = (small.format(-5, power, 5) if power else "") + (small.format(3, escape(below), -3) if below else "")
    return f"{text}{escape(_GREEK.get(first, first))}{marks}{raised}</text>"
