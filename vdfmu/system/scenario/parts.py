"""The FMUs of the components of a scenario's system."""

from __future__ import annotations

import os
from collections.abc import Mapping
from contextlib import suppress
from pathlib import Path
from typing import Any

from vdfmu.arm.fmus import build_fmus
from vdfmu.arm.robot import Robot
from vdfmu.base.cache import cache_folder, load, store
from vdfmu.base.standards import FMI_2
from vdfmu.compiler.fmu.build import FMI, TARGETS, Content, choose_backend, form_of, unit_name
from vdfmu.compiler.unit import Unit
from vdfmu.system.scenario.scenario import Scenario


def build_parts(
    scenario: Scenario,
    folder: str | os.PathLike[str],
    values: Mapping[str, Mapping[str, Any]] | None = None,
    *,
    target: str = FMI,
    **options: Any,
) -> dict[str, Path]:
    """Build the FMUs of the scenario's system, or take those that are there; component to its FMU.

    `values` are start values by component; `target` and `options`: see :func:`vdfmu.build_fmus`. Components of one
    unit have an FMU each if their start values differ. Those that cannot be built for the target are left out.
    """
    units, robots = _units_for(scenario, target), scenario.resolved.robots
    # links and joints have one FMU for all of a kind: their numbers are in the package
    given = {name: each for name, each in (values or {}).items() if name in units and not units[name].exchange}
    placed = _placed(units, robots, given, Path(folder))
    found: dict[str, Path] = {name: part.fmu for name, part in scenario.system.parts.items() if part.fmu is not None}
    found = found if target == FMI else {}
    for place, robot in dict.fromkeys((placed[name], robots[name]) for name in units):
        here = {name: unit for name, unit in units.items() if (placed[name], robots[name]) == (place, robot)}
        built = build_fmus(
            robot,
            place,
            units=list(dict.fromkeys(here.values())),
            start_values={unit_name(unit): dict(given.get(name, {})) for name, unit in here.items()},
            target=target,
            step=scenario.step,
            **options,
        )
        found |= {name: built[unit_name(unit)] for name, unit in here.items()}
    return {name: found[name] for name in scenario.system.parts if name in found}


def _units_for(scenario: Scenario, target: str) -> Mapping[str, type[Unit]]:
    """Return the units of a scenario's components that can be built for a target, or all for one that there is not."""
    units, known = scenario.resolved.units, TARGETS.get(target)
    return {name: unit for name, unit in units.items() if known is None or not known.load().reason_against(unit)}


def left_out(scenario: Scenario, target: str) -> list[str]:
    """Return why components are not built for a target, a sentence each."""
    known = TARGETS.get(target)
    reasons = {name: known and known.load().reason_against(unit) for name, unit in scenario.resolved.units.items()}
    return [f"{name}: not for {target}: {reason}." for name, reason in reasons.items() if reason]


def _placed(
    units: Mapping[str, type[Unit]],
    robots: Mapping[str, Robot | None],
    values: Mapping[str, Mapping[str, Any]],
    folder: Path,
) -> dict[str, Path]:
    """Folder of each component's FMU: one of its own where another unit, robot, or start values have its name."""
    placed: dict[str, Path] = {}
    taken: dict[str, tuple[type[Unit], Robot | None, dict[str, Any]]] = {}
    for name, unit in units.items():
        mine = unit, robots[name] if unit.needs_robot() else None, dict(values.get(name, {}))
        names = (unit.__name__, unit_name(unit))
        placed[name] = folder if all(taken.get(key, mine) == mine for key in names) else folder / name
        if placed[name] == folder:
            taken |= dict.fromkeys(names, mine)
    return placed


def cached_fmus(
    scenario: Scenario, folder: str | os.PathLike[str], backend: str | None = None, fmi_version: str = FMI_2.name
) -> dict[str, Path]:
    """FMUs of a scenario's system in `folder`: those that the cache has, by their content, and the others built."""
    backend = choose_backend(backend)
    cached: dict[str, bytes | None] = {}
    places: dict[str, Path] = {}
    resolved = scenario.resolved
    units, robots = resolved.units, resolved.robots
    placed = _placed(units, robots, {}, Path(folder))
    for name, unit in units.items():
        own = form_of(unit, backend, fmi_version)
        content = Content(unit, robots[name] if unit.needs_robot() else None, {}, *own)
        places[name] = cache_folder() / "fmus" / content.guid.strip("{}")
        cached[name] = fmu = load(places[name])
        if fmu is not None:
            with suppress(OSError):  # of which the build then says more
                placed[name].mkdir(parents=True, exist_ok=True)
                (placed[name] / f"{unit.__name__}.fmu").write_bytes(fmu)
    fmus = build_parts(scenario, folder, backend=backend, fmi_version=fmi_version)
    for name, place in places.items():
        fmu = fmus[name].read_bytes()
        if fmu != cached[name]:
            store(place, fmu)
    return fmus
