"""Checks users' robot, scenario and system files, and their units."""

from __future__ import annotations

import re
import sys
from collections.abc import Callable, Iterable
from pathlib import Path
from typing import Any

from vdfmu.arm.robot import Robot, load_robot
from vdfmu.arm.robot.plausible import robot_notes
from vdfmu.arm.units import find_unit
from vdfmu.base.errors import ModelError, VdfmuError
from vdfmu.base.process import contained
from vdfmu.base.toml_file import kind_of, read_toml
from vdfmu.base.trust import CodeNotRunError, announced_to, reading_only
from vdfmu.compiler.unit.interface import Interface, interface_of
from vdfmu.compiler.unit.load import load_units
from vdfmu.engine.inspect.inspection import Report
from vdfmu.engine.inspect.trial import run_apart, serve
from vdfmu.engine.rules import Finding, Findings, finding
from vdfmu.system.package.description import SystemDescription
from vdfmu.system.scenario.check import model_notes, remarks
from vdfmu.system.scenario.scenario import resolve
from vdfmu.system.scenario.scenario_file import load_scenario, load_system
from vdfmu.system.scenario.values import system_values


def inspect_source(path: Path, robot: str, run: bool = True, say: Callable[[str], None] = lambda text: None) -> Report:
    """Check a TOML file or units with a `robot`. If `run`, code runs in another process, after `say` gets its path."""
    kind = "unit" if path.suffix.lower() == ".py" else "TOML"
    findings = Findings()
    try:
        if kind == "TOML":
            kind = kind_of(read_toml(path))
    except ModelError as error:
        findings.entries += _findings("SRC001", str(error).splitlines(), path)
        return Report.of(findings, path, kind)
    try:
        with announced_to(reading_only):
            findings = _run(f"{kind} {robot}", path)
    except CodeNotRunError as code:
        if run:
            say(str(code.code))
            arm = str(Path(robot).resolve()) if Path(robot).exists() else robot
            findings.add(run_apart(path, f"{kind} {arm}", "vdfmu.system.inspect_source", f"the check of {path.name}"))
        else:
            text = f"{code.code} is code and was not run (--no-run): only its syntax was read"
            if code.code != path:
                text += f"; the parts of {path.name} that depend on it were not checked"
            findings.entries.append(finding("RUN006", text, (str(path), 0)))
    return Report.of(findings, path, kind)


def _findings(rule: str, lines: Iterable[str], path: Path) -> list[Finding]:
    """Return texts as findings, with the line of the file if they state it."""
    pattern = re.compile(rf"^{re.escape(str(path))}, line (\d+)")
    places = ((text, pattern.match(text)) for text in lines)
    return [finding(rule, text, (str(path), int(place[1]) if place else 0)) for text, place in places]


def _run(words: str, path: Path, *_: Any) -> Findings:
    """Check a file in this process, with its code. `words` are its kind and the robot."""
    kind, robot = words.split(" ", 1)
    default = load_robot(robot)
    try:
        return Findings([*_findings("SRC002", _CHECKS[kind](path, default), path)])
    except VdfmuError as error:
        return Findings([*_findings("SRC001", str(error).splitlines(), path)])


def _robot(path: Path, robot: Robot) -> list[str]:
    _trace_drive(robot := load_robot(path))
    return robot_notes(robot)


def _scenario(path: Path, robot: Robot) -> list[str]:
    scenario = load_scenario(path)
    system = SystemDescription(scenario, system_values(scenario, {}))
    _ = system.links
    _trace_drive(scenario.robot)
    facts = remarks(scenario, None, system.values)
    cut = [f"stop = {scenario.stop:g} s cuts the motion of {facts['cut']['end']:g} s"] if "cut" in facts else []
    return [*model_notes(scenario), *cut, *facts.get("unfed", ())]


def _system(path: Path, robot: Robot) -> list[str]:
    system = load_system(path)
    resolved = resolve(system, robot)
    resolved.check_connections()
    for table in resolved.tables.values():
        if isinstance(table, Interface):
            _trace(table)
    return []


def _units(path: Path, robot: Robot) -> list[str]:
    for unit in load_units(path).values():
        _trace(interface_of(unit, robot if unit.needs_robot() else None))
    return []


def _trace_drive(robot: Robot | None) -> None:
    """Trace the laws of a robot's own drive, in the units that use them."""
    if robot is not None and robot.own_options:
        for name in ("feedforward", "plant"):
            _trace(interface_of(find_unit(name), robot))


def _trace(interface: Interface) -> None:
    if interface.unit.backend != "python":
        _ = interface.program


_CHECKS: dict[str, Callable[[Path, Robot], list[str]]] = {
    "robot": _robot,
    "scenario": _scenario,
    "system": _system,
    "unit": _units,
}

if __name__ == "__main__":
    contained(serve, _run, *sys.argv[1:])
