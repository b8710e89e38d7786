"""terminalsAndIcons/: which variables of a unit belong together in a connection, and how the unit is drawn.

Units are connected by joining their terminals of the same name, output to input, member by member; this makes
the connections of ``ssp/system.toml``. FMI 2.0 allows the folder since 2.0.4; the file has the format of FMI 3.0.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Literal
from xml.etree.ElementTree import Element, SubElement

from vdfmu.data import data_path
from vdfmu.fmu.description import document
from vdfmu.fmu.layout import Layout

__all__ = ["TERMINALS", "Terminal", "icon_files", "terminals_and_icons"]

FOLDER = "terminalsAndIcons"


@dataclass(frozen=True)
class Terminal:
    """Groups of a unit that are connected together.

    Attributes
    ----------
    name : str
    side : "left", "right", "bottom" or "top"
        Where it is drawn.
    groups : tuple of str
        Groups of the variable table; they are the names of the members too.
    description : str
    """

    name: str
    side: Literal["left", "right", "bottom", "top"]
    groups: tuple[str, ...]
    description: str


_MOTION = ("q_d", "q_d_dot", "q_d_ddot", "q_d_dddot", "q_d_ddddot")
_MEASURED = ("q", "q_dot", "kappa_dot")

TERMINALS = {
    "trajectory": (Terminal("desired", "right", _MOTION, "Desired motion of the joints"),),
    "feedforward": (
        Terminal("desired", "left", _MOTION, "Desired motion of the joints"),
        Terminal("joints", "bottom", _MEASURED, "Motion of the joints"),
        Terminal("end_effector", "top", ("F_e_d",), "Desired wrench of the end effector"),
        Terminal(
            "feedforward",
            "right",
            ("tau_m", "tau_s", "kappa_dot_d"),
            "Torques and rotors along the desired motion",
        ),
    ),
    "controller": (
        Terminal("desired", "left", _MOTION[:2], "Desired motion of the joints"),
        Terminal(
            "feedforward", "bottom", ("tau_m", "kappa_dot_d"), "Torques and rotors along the desired motion"
        ),
        Terminal("joints", "right", ("tau", *_MEASURED), "Motor torques and motion of the joints"),
    ),
    "plant": (
        Terminal(
            "joints", "left", ("tau", *_MEASURED, "tau_s", "kappa"), "Motor torques and motion of the joints"
        ),
        Terminal("end_effector", "right", ("F_e", "p_O", "R_O"), "Wrench and pose of the end effector"),
    ),
    "estimator": (
        Terminal("joints", "left", ("tau", "q", "kappa"), "Motor torques and positions of the joints"),
        Terminal("estimates", "right", ("tau_s_hat", "tau_f_hat"), "Estimated spring torques"),
    ),
}
"""Unit to its terminals."""

# Corners of a terminal (x1, y1, x2, y2); the unit fills -100 .. 100.
_PLACES = {
    "left": (-110, -10, -90, 10),
    "right": (90, -10, 110, 10),
    "bottom": (-10, -110, 10, -90),
    "top": (-10, 90, 10, 110),
}
_COLOR = "31 78 121"


def terminals_and_icons(layout: Layout, fmi: Literal[2, 3]) -> Element:
    """Root element of ``terminalsAndIcons.xml``.

    The rule is ``bus``: two terminals need not have all members in common. In FMI 3.0 a member is an array, in
    FMI 2.0 each of its elements.
    """
    root = Element("fmiTerminalsAndIcons", {"fmiVersion": "3.0"})
    picture = SubElement(root, "GraphicalRepresentation")
    extent = _extent(-100, -100, 100, 100)
    SubElement(picture, "CoordinateSystem", extent | {"suggestedScalingFactorTo_mm": "0.1"})
    SubElement(picture, "Icon", extent)
    terminals = SubElement(root, "Terminals")
    for terminal in TERMINALS[layout.table.unit]:
        element = SubElement(
            terminals,
            "Terminal",
            {"name": terminal.name, "matchingRule": "bus", "description": terminal.description},
        )
        for name in _members(layout, terminal, fmi):
            member = {"variableName": name, "memberName": name, "variableKind": "signal"}
            SubElement(element, "TerminalMemberVariable", member)
        place = _extent(*_PLACES[terminal.side])
        line = {"defaultConnectionColor": _COLOR, "defaultConnectionStrokeSize": "2"}
        SubElement(element, "TerminalGraphicalRepresentation", line | place | {"iconBaseName": "terminal"})
    return root


def icon_files(layout: Layout, fmi: Literal[2, 3]) -> dict[str, bytes]:
    """Return path in the FMU to content: terminals, icon and, in FMI 2.0, the picture ``model.png``."""
    icons = data_path("fmu_src") / "icons"
    files = {f"{FOLDER}/terminalsAndIcons.xml": document(terminals_and_icons(layout, fmi))}
    for kind in ("png", "svg"):
        files[f"{FOLDER}/icon.{kind}"] = (icons / f"{layout.table.unit}.{kind}").read_bytes()
        files[f"{FOLDER}/terminal.{kind}"] = (icons / f"terminal.{kind}").read_bytes()
    if fmi == 2:
        files["model.png"] = files[f"{FOLDER}/icon.png"]
    return files


def _extent(x1: int, y1: int, x2: int, y2: int) -> dict[str, str]:
    return {"x1": str(x1), "y1": str(y1), "x2": str(x2), "y2": str(y2)}


def _members(layout: Layout, terminal: Terminal, fmi: int) -> Iterator[str]:
    for group in terminal.groups:
        where = layout.table.groups[group]
        if fmi == 2:
            yield from (v.name for v in layout.variables[where])
        else:
            yield from (a.name for a in layout.arrays if where.start <= a.first < where.stop)
