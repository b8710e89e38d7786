"""terminalsAndIcons/ of an FMU: groups of variables that are connected together, and the unit's icon.

Connecting terminals of the same name, output to input, member by member, results in the connections of
``ssp/system.toml``. FMI 2.0 allows the folder since 2.0.4; the file has the format of FMI 3.0.
"""

from __future__ import annotations

from collections.abc import Iterator
from xml.etree.ElementTree import Element, SubElement

from vdfmu.base.files import data_path
from vdfmu.base.standards import FMI_3, FmiVersion
from vdfmu.compiler.fmu.description import document
from vdfmu.compiler.unit.declaration import Terminal
from vdfmu.compiler.unit.interface import Interface

FOLDER = "terminalsAndIcons"

# Corners of a terminal (x1, y1, x2, y2); the unit spans -100 .. 100.
_PLACES = {
    "left": (-110, -10, -90, 10), "right": (90, -10, 110, 10), "bottom": (-10, -110, 10, -90), "top": (-10, 90, 10, 110)
}  # fmt: skip
_COLOR = "31 78 121"


def terminals_and_icons(interface: Interface, version: FmiVersion) -> Element:
    """Return the root element of ``terminalsAndIcons.xml``.

    The rule is ``bus``: two terminals need not have all members in common. In FMI 3.0 a member is an array, in
    FMI 2.0 each of its elements.
    """
    root = Element("fmiTerminalsAndIcons", {"fmiVersion": FMI_3.name})
    picture = SubElement(root, "GraphicalRepresentation")
    extent = _extent(-100, -100, 100, 100)
    SubElement(picture, "CoordinateSystem", extent | {"suggestedScalingFactorTo_mm": "0.1"})
    SubElement(picture, "Icon", extent)
    listed = [t for t in interface.unit.terminals if any(group in interface.groups for group in t.groups)]
    terminals = SubElement(root, "Terminals") if listed else root
    for terminal in listed:
        about = {"name": terminal.name, "matchingRule": "bus", "description": terminal.description}
        element = SubElement(terminals, "Terminal", about)
        for name in _members(interface, terminal, version):
            SubElement(element, "TerminalMemberVariable", variableName=name, memberName=name, variableKind="signal")
        place = _extent(*_PLACES[terminal.side])
        line = {"defaultConnectionColor": _COLOR, "defaultConnectionStrokeSize": "2"}
        SubElement(element, "TerminalGraphicalRepresentation", line | place | {"iconBaseName": "terminal"})
    return root


def icon_files(interface: Interface, version: FmiVersion) -> dict[str, bytes]:
    """Return path in the FMU to content: terminals, icon and, in FMI 2.0, the picture ``model.png``."""
    icons = data_path("fmu_src") / "icons"
    files = {f"{FOLDER}/terminalsAndIcons.xml": document(terminals_and_icons(interface, version))}
    for kind in ("png", "svg"):
        icon = icons / f"{interface.name}.{kind}"
        files[f"{FOLDER}/icon.{kind}"] = (icon if icon.is_file() else icons / f"unit.{kind}").read_bytes()
        files[f"{FOLDER}/terminal.{kind}"] = (icons / f"terminal.{kind}").read_bytes()
    if version.picture:
        files["model.png"] = files[f"{FOLDER}/icon.png"]
    return files


def _extent(x1: int, y1: int, x2: int, y2: int) -> dict[str, str]:
    return {"x1": str(x1), "y1": str(y1), "x2": str(x2), "y2": str(y2)}


def _members(interface: Interface, terminal: Terminal, version: FmiVersion) -> Iterator[str]:
    for group in terminal.groups:
        where = interface.groups.get(group, slice(0, 0))  # an optional one may be missing
        if version.arrays:
            yield from (a.name for a in interface.arrays if where.start <= a.first < where.stop)
        else:
            yield from (v.name for v in interface.memory[where])
