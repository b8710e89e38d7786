"""The components of a scenario's system: their variables, and their FMUs."""

from __future__ import annotations

import dataclasses
import os
import shutil
from collections.abc import Collection, Mapping, Sequence
from contextlib import suppress
from pathlib import Path
from typing import Any

from vdfmu.errors import StorageError
from vdfmu.fmu import build_fmus
from vdfmu.fmu.build import choose_backend
from vdfmu.fmu.content import Content
from vdfmu.kernel.cache import cache_folder, load, store
from vdfmu.model import Scenario
from vdfmu.ssp.foreign import ForeignInterface
from vdfmu.unit.base import Unit, unit_name
from vdfmu.unit.interface import Interface
from vdfmu.units import find_unit

__all__ = ["Variables", "build_parts", "cached_fmus", "tables_of", "units_of", "with_units"]

Variables = Interface | ForeignInterface
"""The variables of a component."""


def units_of(scenario: Scenario) -> dict[str, type[Unit]]:
    """Units of the scenario's system by component, without those that are FMUs of any tool."""
    parts = scenario.system.parts
    return {
        name: part.unit if isinstance(part.unit, type) else find_unit(part.unit)
        for name, part in parts.items()
        if part.fmu is None
    }


def tables_of(scenario: Scenario, components: Collection[str] | None = None) -> dict[str, Variables]:
    """Variables of the components of the scenario's system, or of some of them, by component."""
    units = units_of(scenario)
    found: dict[str, Variables] = {}
    for name, part in scenario.system.parts.items():
        if components is not None and name not in components:
            continue
        if part.fmu is not None:
            found[name] = ForeignInterface(part.fmu)
        else:
            robot = scenario.robot if units[name].needs_robot() else None
            found[name] = Interface(units[name], robot)
    return found


def with_units(scenario: Scenario, units: Mapping[str, Any]) -> Scenario:
    """Return the scenario with other units for some components, without connections to signals that these lack.

    Raises
    ------
    UsageError, UnitError
        For a name that is not that of a component, or what is no unit.
    """
    system = scenario.system.with_units(units)
    tables = tables_of(dataclasses.replace(scenario, system=system), units)
    has = {
        name: {(v.group, v.causality) for v in table if v.causality in ("input", "output")}
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
    return dataclasses.replace(
        scenario, system=dataclasses.replace(system, connections=kept, dropped=tuple(dropped))
    )


def build_parts(
    scenario: Scenario,
    folder: str | os.PathLike[str],
    values: Mapping[str, Mapping[str, Any]] | None = None,
    *,
    backend: str | None = None,
    fmi_version: str = "2.0",
    platforms: Sequence[str] | str | None = None,
) -> dict[str, Path]:
    """Build the FMUs of the scenario's system, or take those that are there; component to its FMU.

    `values` are start values by component; other arguments as of :func:`vdfmu.fmu.build_fmus`. Components of one unit
    have an FMU each if their start values differ.
    """
    units = units_of(scenario)
    places: dict[Path, dict[str, dict[str, Any]]] = {}  # folder to unit to its start values
    where: dict[str, tuple[Path, str]] = {}
    for name, unit in units.items():
        start = dict((values or {}).get(name, {}))
        shared = places.setdefault(Path(folder), {})
        place = Path(folder) / name if shared.get(unit_name(unit), start) != start else Path(folder)
        places.setdefault(place, {})[unit_name(unit)] = start
        where[name] = place, unit_name(unit)
    built: dict[tuple[Path, str], Path] = {}
    by_name = {unit_name(unit): unit for unit in units.values()}
    for place, starts in places.items():
        made = build_fmus(
            scenario.robot, place, units=[by_name[unit] for unit in starts], start_values=starts, backend=backend,
            fmi_version=fmi_version, platforms=platforms,
        )  # fmt: skip
        built |= {(place, unit): fmu for unit, fmu in made.items()}
    found: dict[str, Path] = {}
    for name, part in scenario.system.parts.items():
        found[name] = _copied(part.fmu, Path(folder)) if part.fmu is not None else built[where[name]]
    return found


def _copied(fmu: Path, folder: Path) -> Path:
    try:
        folder.mkdir(parents=True, exist_ok=True)
        return Path(shutil.copyfile(fmu, folder / fmu.name))
    except OSError as error:
        raise StorageError(
            f"{folder / fmu.name}: cannot be written: {error}. Choose another folder."
        ) from error


def cached_fmus(
    scenario: Scenario, folder: str | os.PathLike[str], backend: str | None = None
) -> dict[str, Path]:
    """FMUs of a scenario's system in `folder`: those that the cache has, by their content, and the others built."""
    backend = choose_backend(backend)
    cached: dict[str, bytes | None] = {}
    places: dict[str, Path] = {}
    for name, unit in units_of(scenario).items():
        robot = scenario.robot if unit.needs_robot() else None
        own = "python" if unit.backend == "python" else backend
        places[name] = cache_folder() / "fmus" / Content(unit, robot, {}, own).guid.strip("{}")
        cached[name] = content = load(places[name])
        if content is not None:
            with suppress(OSError):  # of which the build then says more
                (Path(folder) / f"{unit.__name__}.fmu").write_bytes(content)
    fmus = build_parts(scenario, folder, backend=backend)
    for name, place in places.items():
        content = fmus[name].read_bytes()
        if content != cached[name]:
            store(place, content)
    return fmus
