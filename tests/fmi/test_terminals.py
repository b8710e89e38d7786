"""Terminals and icons: valid, complete, and connecting the units as the shipped system does."""

from __future__ import annotations

import struct
from pathlib import Path
from typing import Literal

import fmpy
import pytest
from lxml import etree

from vdfmu.fmu import UNIT_NAMES
from vdfmu.fmu.description import document
from vdfmu.fmu.interface import interface
from vdfmu.fmu.layout import Layout
from vdfmu.fmu.terminals import icon_files, terminals_and_icons
from vdfmu.model import Robot
from vdfmu.ssp.system_file import read_system

SCHEMA = etree.XMLSchema(etree.parse(Path(fmpy.__file__).parent / "schema/fmi3/fmi3TerminalsAndIcons.xsd"))
FMI = Literal[2, 3]


@pytest.fixture(params=(2, 3))
def fmi(request: pytest.FixtureRequest) -> FMI:
    return request.param


@pytest.fixture
def layout(robots: dict[str, Robot], robot_name: str, unit_name: str) -> Layout:
    return Layout(interface(unit_name, robots[robot_name]))


def read(layout: Layout, fmi: FMI) -> etree._Element:
    return etree.fromstring(document(terminals_and_icons(layout, fmi)))


def members(layout: Layout, fmi: FMI) -> dict[str, dict[str, str]]:
    """Return terminal and member to the name of the variable."""
    return {
        terminal.get("name"): {
            m.get("memberName"): m.get("variableName") for m in terminal.findall("TerminalMemberVariable")
        }
        for terminal in read(layout, fmi).findall("Terminals/Terminal")
    }


def test_it_obeys_the_schema_of_the_standard(layout: Layout, fmi: FMI) -> None:
    assert SCHEMA.validate(read(layout, fmi)), SCHEMA.error_log


def test_members_are_inputs_and_outputs_of_the_unit(layout: Layout, fmi: FMI) -> None:
    if fmi == 2:
        causality = {v.name: v.causality for v in layout.table}
    else:
        causality = {a.name: layout.variables[a.first].causality for a in layout.arrays}
    named = [name for terminal in members(layout, fmi).values() for name in terminal.values()]
    assert len(set(named)) == len(named)
    assert {causality[name] for name in named} <= {"input", "output"}
    assert {name for name, kind in causality.items() if kind == "input"} <= set(named)
    rest = {name.split("[")[0] for name, kind in causality.items() if kind == "output"} - {
        name.split("[")[0] for name in named
    }
    assert rest <= {"tau_e", "E_kin", "E_pot", "E_spring"}  # to look at, not to connect


def test_joining_terminals_of_one_name_makes_the_connections_of_the_system(
    robots: dict[str, Robot], robot_name: str, fmi: FMI
) -> None:
    """Output to input, member by member; all elements of both."""
    layouts = {unit: Layout(interface(unit, robots[robot_name])) for unit in UNIT_NAMES}
    causality = {
        (unit, name): v.causality
        for unit, layout in layouts.items()
        for v in layout.table
        for name in (v.name, v.group)
    }
    terminals = {unit: members(layout, fmi) for unit, layout in layouts.items()}
    found = {
        (f"{source}.{out.split('[')[0]}", f"{target}.{into.split('[')[0]}")
        for source in UNIT_NAMES
        for target in UNIT_NAMES
        for terminal, ours in terminals[source].items()
        for member, out in ours.items()
        if (into := terminals[target].get(terminal, {}).get(member)) is not None
        and source != target
        and causality[source, out] == "output"
        and causality[target, into] == "input"
    }
    system = read_system("estimator")  # has all units
    expected = {(start, end) for start, ends in system["connections"].items() for end in ends}
    assert found == expected


def test_all_pictures_are_there_and_small(layout: Layout, fmi: FMI) -> None:
    files = icon_files(layout, fmi)
    folder = "terminalsAndIcons/"
    assert files[f"{folder}terminalsAndIcons.xml"] == document(terminals_and_icons(layout, fmi))
    drawn = {t.get("iconBaseName") for t in read(layout, fmi).iter("TerminalGraphicalRepresentation")}
    for name in ("icon", *drawn):
        png, svg = files[f"{folder}{name}.png"], files[f"{folder}{name}.svg"]
        assert png[:8] == b"\x89PNG\r\n\x1a\n"
        width, height = struct.unpack(">II", png[16:24])
        assert width == height >= 40
        assert etree.fromstring(svg).tag == "{http://www.w3.org/2000/svg}svg"
        assert max(len(png), len(svg)) < 10_000
    assert ("model.png" in files) == (fmi == 2)


def test_each_unit_has_its_own_icon(robots: dict[str, Robot]) -> None:
    robot = robots["planar_2dof"]
    files = [icon_files(Layout(interface(unit, robot)), 3) for unit in UNIT_NAMES]
    assert len({f["terminalsAndIcons/icon.png"] for f in files}) == len(UNIT_NAMES)
