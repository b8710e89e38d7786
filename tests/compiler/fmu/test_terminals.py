"""Terminals and icons: valid, complete, and connecting the units as the shipped system does."""

from pathlib import Path

import fmpy
import pytest
from lxml import etree

from vdfmu.arm.units import find_unit, shipped_units
from vdfmu.base.files import data_path
from vdfmu.base.standards import FMI_2, FMI_3, FMI_VERSIONS, FmiVersion
from vdfmu.compiler.fmu.description import document
from vdfmu.compiler.fmu.terminals import icon_files, terminals_and_icons
from vdfmu.compiler.unit.interface import Interface
from vdfmu.system.scenario.scenario_file import load_system

SCHEMA = etree.XMLSchema(etree.parse(Path(fmpy.__file__).parent / "schema/fmi3/fmi3TerminalsAndIcons.xsd"))


@pytest.fixture(params=FMI_VERSIONS.values(), ids=lambda version: version.prefix)
def fmi(request):
    return request.param


def read(interface: Interface, fmi: FmiVersion) -> etree._Element:
    return etree.fromstring(document(terminals_and_icons(interface, fmi)))


def members(interface: Interface, fmi: FmiVersion) -> dict[str, dict[str, str]]:
    return {
        terminal.get("name"): {
            m.get("memberName"): m.get("variableName") for m in terminal.findall("TerminalMemberVariable")
        }
        for terminal in read(interface, fmi).findall("Terminals/Terminal")
    }


def test_it_obeys_the_schema_of_the_standard_and_members_are_inputs_and_outputs_of_the_unit(interface, fmi):
    assert SCHEMA.validate(read(interface, fmi)), SCHEMA.error_log
    if fmi is FMI_2:
        causality = {v.name: v.causality for v in interface}
    else:
        causality = {a.name: interface.memory[a.first].causality for a in interface.arrays}
    named = [name for terminal in members(interface, fmi).values() for name in terminal.values()]
    assert len(set(named)) == len(named)
    assert {causality[name] for name in named} <= {"input", "output"}
    assert {name for name, kind in causality.items() if kind == "input"} <= set(named)
    rest = {name.split("[")[0] for name, kind in causality.items() if kind == "output"} - {
        name.split("[")[0] for name in named
    }
    assert rest <= {"tau_e", "E_kin", "E_pot", "E_spring"}  # to look at, not to connect


def test_joining_terminals_of_one_name_makes_the_connections_of_the_system(robots, robot_name, fmi):
    """Output to input, member by member; all elements of both."""
    interfaces = {unit: Interface(shipped_units()[unit], robots[robot_name]) for unit in shipped_units()}
    causality = {
        (unit, name): v.causality
        for unit, interface in interfaces.items()
        for v in interface
        for name in (v.name, v.group)
    }
    terminals = {unit: members(interface, fmi) for unit, interface in interfaces.items()}
    connections = {
        (f"{source}.{out.split('[')[0]}", f"{target}.{into.split('[')[0]}")
        for source in shipped_units()
        for target in shipped_units()
        for terminal, ours in terminals[source].items()
        for member, out in ours.items()
        if (into := terminals[target].get(terminal, {}).get(member)) is not None
        and source != target
        and causality[source, out] == "output"
        and causality[target, into] == "input"
    }
    system = load_system("estimator")  # has all units
    expected = {(start, end) for start, ends in system.connections.items() for end in ends}
    assert connections == expected


def test_each_unit_has_its_own_icon_or_that_of_all_units(robots):
    robot = robots["planar_2dof"]
    files = [icon_files(Interface(shipped_units()[unit], robot), FMI_3) for unit in shipped_units()]
    assert len({f["terminalsAndIcons/icon.png"] for f in files}) == len(shipped_units())
    # And no terminals, where it declares none.
    interface = Interface(find_unit(Path(__file__).parent / "own_units.py:LowPass"), None)
    files = icon_files(interface, FMI_2)
    for kind in ("png", "svg"):
        picture = (data_path("fmu_src") / "icons" / f"unit.{kind}").read_bytes()
        assert files[f"terminalsAndIcons/icon.{kind}"] == picture
    assert SCHEMA.validate(read(interface, FMI_2)), SCHEMA.error_log
    assert members(interface, FMI_2) == {}
