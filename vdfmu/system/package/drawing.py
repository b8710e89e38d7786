"""The diagram of a system as SVG, from the geometry that its SSD holds."""

from __future__ import annotations

import base64
from collections.abc import Mapping
from html import escape
from itertools import groupby
from pathlib import Path
from typing import Any

from vdfmu.base.files import read_member
from vdfmu.engine.package.parse import NAMESPACES, parse_xml

_COLOURS = ("#1f4e79", "#d9730d", "#2e7d4f", "#8e3b8c")
_ICON = 10.0
"""Size of an icon [mm]."""
_STYLE = """
svg.system { font-family: system-ui, sans-serif; max-width: 100%; height: auto; background: #ffffff; }
.system .box { fill: #f4f7fa; stroke: #1f2328; stroke-width: .6; }
.system .name { font-size: 7px; font-weight: 600; fill: #1f2328; }
.system .label { font-size: 4.2px; fill: #1f2328; }
.system .wire { fill: none; stroke-width: .5; stroke-linejoin: round; }
.system .open { fill: #ffffff; stroke: #57606a; stroke-width: .4; }
"""


def system_diagram(package: Path) -> str:
    """Return the picture of the system in a package; empty where there is none, or not all of it has a place."""
    data = read_member(package, "SystemStructure.ssd")
    if data is None:
        return ""
    ssd = parse_xml(data, str(package))
    places = [ssd.find("ssd:System/ssd:SystemGeometry", NAMESPACES)]
    sources: set[str] = set()
    for component in ssd.iterfind("ssd:System/ssd:Elements/*", NAMESPACES):
        geometry = component.find("ssd:ElementGeometry", NAMESPACES)
        places += [geometry, *(c.find("*") for c in component.iterfind("ssd:Connectors/*", NAMESPACES))]
        sources |= set() if geometry is None else {geometry.get("iconSource", "")}
    if any(place is None for place in places):
        return ""
    icons = {source: read_member(package, source) for source in sources if source}
    return draw_system(ssd, {source: icon for source, icon in icons.items() if icon is not None})


def draw_system(ssd: Any, icons: Mapping[str, bytes]) -> str:
    """Picture of the system of an SSD: boxes, connectors, and connections along their bends.

    All elements of the SSD have their geometry; `icons` has the SVG file of an icon by its source.
    """
    system = ssd.find("ssd:System", NAMESPACES)
    x1, y1, x2, y2 = _corners(system.find("ssd:SystemGeometry", NAMESPACES))
    width, height = x2 - x1, y2 - y1
    components = system.findall("ssd:Elements/ssd:Component", NAMESPACES)
    colours = {c.get("name"): _COLOURS[i % len(_COLOURS)] for i, c in enumerate(components)}
    places: dict[tuple[str, str], tuple[float, float]] = {}
    boxes = [_box(component, (x1, y2), icons, places) for component in components]
    connections = system.findall("ssd:Connections/ssd:Connection", NAMESPACES)
    wires: list[str] = []
    used: dict[tuple[str, str], str] = {}
    for connection in connections:
        colour = colours[connection.get("startElement")]
        start = (connection.get("startElement"), connection.get("startConnector"))
        end = (connection.get("endElement"), connection.get("endConnector"))
        used[start] = used[end] = colour
        geometry = connection.find("ssd:ConnectionGeometry", NAMESPACES)
        bends = zip(geometry.get("pointsX").split(), geometry.get("pointsY").split(), strict=True)
        path = [places[start], *((float(x) - x1, y2 - float(y)) for x, y in bends), places[end]]
        points = " ".join(f"{x:.4g},{y:.4g}" for x, y in path)
        title = f"{start[0]}.{start[1]} to {end[0]}.{end[1]}"
        wires.append(f'<polyline class="wire" stroke="{colour}" points="{points}"><title>{title}</title></polyline>')
    marks = [
        f'<circle cx="{x:.4g}" cy="{y:.4g}" r=".9" fill="{used[key]}"/>'
        if key in used
        else f'<circle class="open" cx="{x:.4g}" cy="{y:.4g}" r=".8"/>'
        for key, (x, y) in places.items()
    ]
    return "\n".join(
        [
            f'<svg class="system" xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {width:g} {height:g}" '
            f'width="{2.4 * width:.0f}" role="img" aria-label="Diagram of the system">',
            f"<style>{_STYLE}</style>",
            *wires,
            *boxes,
            *marks,
            "</svg>",
        ]
    )


def _corners(geometry: Any) -> tuple[float, float, float, float]:
    x1, y1, x2, y2 = (float(geometry.get(key)) for key in ("x1", "y1", "x2", "y2"))
    return x1, y1, x2, y2


def _box(
    component: Any,
    origin: tuple[float, float],
    icons: Mapping[str, bytes],
    places: dict[tuple[str, str], tuple[float, float]],
) -> str:
    """Box of a component with its name, icon and the names of its groups; the places of its connectors."""
    geometry = component.find("ssd:ElementGeometry", NAMESPACES)
    x1, y1, x2, y2 = _corners(geometry)
    left, top, width, height = x1 - origin[0], origin[1] - y2, x2 - x1, y2 - y1
    name = component.get("name")
    parts = [f'<rect class="box" x="{left:g}" y="{top:g}" width="{width:g}" height="{height:g}" rx="2"/>']
    icon = icons.get(geometry.get("iconSource"))
    indent = 0.0
    if icon is not None:  # above the box, where no label of a connector is
        data = base64.b64encode(icon).decode()
        parts.append(
            f'<image x="{left:g}" y="{top - 1 - _ICON:g}" width="{_ICON:g}" height="{_ICON:g}" '
            f'href="data:image/svg+xml;base64,{data}"/>'
        )
        indent = _ICON + 1.5
    parts.append(f'<text class="name" x="{left + indent:g}" y="{top - 3:g}">{escape(name)}</text>')
    connectors = component.findall("ssd:Connectors/ssd:Connector", NAMESPACES)
    for (group, kind), found in groupby(connectors, lambda c: (c.get("name").split("[")[0], c.get("kind"))):
        members = list(found)
        heights: list[float] = []
        for connector in members:
            place = connector.find("ssd:ConnectorGeometry", NAMESPACES)
            x = left + float(place.get("x")) * width
            y = top + (1.0 - float(place.get("y"))) * height
            places[name, connector.get("name")] = (x, y)
            heights.append(y)
        at_left = kind == "input"
        x = left + 2.5 if at_left else left + width - 2.5
        y = sum(heights) / len(heights) + 1.4
        count = f"[1..{len(members)}]" if len(members) > 1 else _shape_text(members[0])
        parts.append(
            f'<text class="label" x="{x:g}" y="{y:.4g}" text-anchor="{"start" if at_left else "end"}">'
            f"{escape(group)}{count}</text>"
        )
    return "\n".join(parts)


def _shape_text(connector: Any) -> str:
    sizes = [d.get("size") for d in connector.iterfind("ssc:Dimension", NAMESPACES)]
    if sizes:
        return f"[{', '.join(f'1..{size}' for size in sizes)}]"
    return "[" + connector.get("name").partition("[")[2] if "[" in connector.get("name") else ""
