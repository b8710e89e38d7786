"""Linear systems of scenarios and packages, by their FMUs."""

from __future__ import annotations

import os
from collections.abc import Generator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any, Unpack

from vdfmu.base.files import temporary_folder
from vdfmu.engine.linear.linearise import LinearSystem, linear_system
from vdfmu.engine.options import CouplingOptions
from vdfmu.system.package.write import cached_fmus, write_ssp
from vdfmu.system.scenario import Scenario, load_scenario
from vdfmu.system.scenario.values import system_values


@contextmanager
def packaged(
    system: Scenario | str | os.PathLike[str],
    settings: Mapping[str, Any] | None = None,
    backend: str | None = None,
    master: str | None = None,
    **coupling: Unpack[CouplingOptions],
) -> Generator[tuple[Path, dict[str, Any]]]:
    """Yield the package of a system, and the options of :class:`vdfmu.Simulator` that it takes.

    The system is a scenario, its name or file, or an ``.ssp``; `settings` change its parameters, `backend` is the kind
    of a scenario's FMUs, ``native`` or ``python``. `master` and `coupling` replace its own.
    """
    given = {name: value for name, value in coupling.items() if value is not None}
    if not isinstance(system, Scenario):
        if Path(system).suffix.lower() == ".ssp":
            yield Path(system), {**given, "parameters": settings, "algorithm": master}
            return
        system = load_scenario(system)
    values = system_values(system, settings)
    with temporary_folder("vdfmu_") as folder:
        built = cached_fmus(system, folder, backend)
        own = system.coupling if master in (None, system.master) else {**system.options, "algorithm": master}
        options = {**own, **given, "inputs": system.inputs, "input_hold": system.input_hold}
        yield write_ssp(system, built, Path(folder) / "system.ssp", values, mixed=True), options


def linearized(
    system: Scenario | str | os.PathLike[str],
    at: float | None = None,
    *,
    master: str | None = None,
    settings: Mapping[str, Any] | None = None,
    backend: str | None = None,
) -> LinearSystem:
    """Linearise the components of a scenario or package at a time of its run, by default its start.

    For the others see :func:`packaged`, for errors :func:`vdfmu.engine.linear.linearise.linear_system`.
    """
    with packaged(system, settings, backend, master) as (package, options):
        return linear_system(package, at, **options)
