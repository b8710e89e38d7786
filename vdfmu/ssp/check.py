"""Check of what users write for the arm: robot, scenario and system files, and units of their own."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

from vdfmu.errors import VdfmuError
from vdfmu.model import Robot, load_robot
from vdfmu.model.toml_file import read_toml
from vdfmu.scenario.check import model_notes
from vdfmu.scenario.load import load_scenario, load_system
from vdfmu.scenario.parts import check_connections, tables_of
from vdfmu.ssp.description import SystemDescription
from vdfmu.unit.interface import Interface
from vdfmu.unit.load import load_units

Checked = tuple[str, list[str], list[str]]


def check_source(path: Path, robot: Robot) -> Checked:
    """Check a TOML file, or the units of a Python file, which is run.

    Parameters
    ----------
    path : Path
        ``.toml`` or ``.py``.
    robot : Robot
        For units and systems, which are for any robot.

    Returns
    -------
    tuple of str, list of str, list of str
        What it is, problems and notes.
    """
    kinds = {
        "joints": "robot",
        "kind": "scenario",
        "units": "system",
        "extends": "system",
        "connections": "system",
    }
    kind = "unit" if path.suffix == ".py" else "TOML"
    try:
        if kind == "TOML":
            written = read_toml(path)
            kind = next((kind for key, kind in kinds.items() if key in written), "scenario")
        return kind, [], _CHECKS[kind](path, robot)
    except VdfmuError as error:
        return kind, str(error).splitlines(), []


def _scenario(path: Path, robot: Robot) -> list[str]:
    scenario = load_scenario(path)
    _ = SystemDescription(scenario).links
    return model_notes(scenario)


def _system(path: Path, robot: Robot) -> list[str]:
    system = load_system(path)
    tables = tables_of(system, robot)
    check_connections(system, tables)
    for table in tables.values():
        if isinstance(table, Interface):
            _trace(table)
    return []


def _units(path: Path, robot: Robot) -> list[str]:
    for unit in load_units(path).values():
        _trace(Interface(unit, robot if unit.needs_robot() else None))
    return []


def _trace(interface: Interface) -> None:
    if interface.unit.backend != "python":
        _ = interface.program


def _robot(path: Path, robot: Robot) -> list[str]:
    load_robot(path)
    return []


_CHECKS: dict[str, Callable[[Path, Robot], list[str]]] = {
    "robot": _robot, "scenario": _scenario, "system": _system, "unit": _units,
}  # fmt: skip
