"""Changes of a scenario: other units for some components of its system, and a payload."""

from __future__ import annotations

import dataclasses
import os
from collections.abc import Iterable, Mapping
from typing import Any

import numpy as np

from vdfmu.arm.robot.parameters import read_only, section
from vdfmu.base.errors import UsageError
from vdfmu.compiler.unit import Unit
from vdfmu.system.scenario.resolved import ResolvedSystem, resolve
from vdfmu.system.scenario.scenario import Scenario
from vdfmu.system.scenario.start import started
from vdfmu.system.scenario.values import section_values


def with_payload(scenario: Scenario, names: Iterable[str]) -> Scenario:
    """Return the scenario with an empty payload for a robot without one, if settings name its numbers.

    Parameters
    ----------
    names : iterable of str
        Settings: ``plant.payload_mass``, ``robot.payload_inertia[1,1]``.
    """
    robot = scenario.robot
    fields = {name.partition(".")[2].partition("[")[0] for name in names}
    rows = section("payload")
    if robot is None or robot.payload or fields.isdisjoint(row.name for row in rows):
        return scenario
    empty = {row.name: read_only(np.zeros(row.shape)) for row in rows}
    if "payload_inertia" in fields:  # one of zeros, of a point mass, has no parameters
        empty["payload_inertia"] = read_only(1e-12 * np.eye(3))
    return dataclasses.replace(scenario, robot=dataclasses.replace(robot, payload=True, **empty))


def with_units(scenario: Scenario, units: Mapping[str, Any]) -> Scenario:
    """Return the scenario with other units for some components, without the connections and values that these lack.

    An input that the component's unit did not have is joined to the output of its name, if a terminal has both and the
    component was connected to the output's.

    Raises
    ------
    UsageError, UnitError
        For a name that is not that of a component, or a value that is not a unit.
    """
    system, parts = scenario.system, dict(scenario.system.parts)
    for name, unit in units.items():
        if name not in parts:
            raise UsageError(
                f"units: the system {system.name} has no component {name!r}. There are: {', '.join(parts)}."
            )
        known = issubclass(unit, Unit) if isinstance(unit, type) else isinstance(unit, (str, os.PathLike))
        if not known:
            raise UsageError(f"units: {name}: expected a unit, its name or its file, got {unit!r}.")
        value = unit if isinstance(unit, type) else os.fspath(unit)
        parts[name] = dataclasses.replace(parts[name], unit=value)
    system = dataclasses.replace(system, parts=parts)
    resolved = resolve(system, scenario.robot)
    tables = {name: table for name, table in resolved.tables.items() if name in units}
    has = {
        name: {(key, v.causality) for v in table if v.causality in ("input", "output") for key in (v.group, v.name)}
        for name, table in tables.items()
    }

    def lacks(signal: str, causality: str) -> bool:
        component, _, group = signal.partition(".")
        return component in has and (group, causality) not in has[component]

    kept: dict[str, list[str]] = {}
    dropped: list[str] = []
    for source, targets in system.connections.items():
        for target in targets:
            if lacks(source, "output") or lacks(target, "input"):
                dropped.append(f"{source} -> {target}")
            else:
                kept.setdefault(source, []).append(target)
    joined = _joined(scenario, resolved, tables)
    for source, target in joined:
        kept.setdefault(source, []).append(target)
    written = section_values(scenario.resolved, scenario.sections)
    sections = dict(scenario.sections)
    for name, table in tables.items():
        sections[name] = {v: value for v, value in written.get(name, {}).items() if v in table.reference}
    for name, unit in resolved.units.items():
        sections = started(system, name, unit, sections)
    return dataclasses.replace(
        scenario,
        system=dataclasses.replace(
            system, connections=kept, dropped=tuple(dropped), joined=tuple(" -> ".join(ends) for ends in joined)
        ),
        sections=sections,
    )


def _joined(scenario: Scenario, resolved: ResolvedSystem, new: Iterable[str]) -> list[tuple[str, str]]:
    """Return what joining terminals of one name connects to inputs of `new` components that they had not before."""
    old, ends = scenario.resolved, scenario.system.connections.items()
    linked = {
        frozenset(end.partition(".")[0] for end in (source, target)) for source, targets in ends for target in targets
    }
    found: list[tuple[str, str]] = []
    for name in (name for name in new if name in resolved.units and name in old.units):
        for terminal in resolved.units[name].terminals:
            for group in terminal.groups:
                if not _has(resolved, name, group, "input") or _has(old, name, group, "input"):
                    continue
                sources = [
                    f"{other}.{group}"
                    for other, unit in resolved.units.items()
                    if frozenset((name, other)) in linked and _has(resolved, other, group, "output")
                    and any(t.name == terminal.name and group in t.groups for t in unit.terminals)
                ]  # fmt: skip
                if len(sources) == 1:
                    found.append((sources[0], f"{name}.{group}"))
    return found


def _has(system: ResolvedSystem, component: str, group: str, causality: str) -> bool:
    return any(v.group == group and v.causality == causality for v in system.tables[component])
