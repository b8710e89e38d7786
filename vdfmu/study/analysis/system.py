"""Linear systems of scenarios and packages, by their FMUs."""

from __future__ import annotations

import math
import os
from collections.abc import Generator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from typing import Any, NamedTuple

from vdfmu.base.errors import UsageError
from vdfmu.base.files import temporary_folder
from vdfmu.base.progress import counted
from vdfmu.engine.linear.growth import margin_rows
from vdfmu.engine.linear.linearise import linear_system
from vdfmu.engine.linear.loops import GROWTH, Margins, fastest_mode, of_positions, system_margins
from vdfmu.engine.linear.system import LinearSystem
from vdfmu.engine.run.simulator import Simulator
from vdfmu.system.package.write import write_ssp
from vdfmu.system.scenario import Scenario, load_scenario
from vdfmu.system.scenario.parts import cached_fmus
from vdfmu.system.scenario.values import system_values


@contextmanager
def packaged(
    system: Scenario | str | os.PathLike[str],
    settings: Mapping[str, Any] | None = None,
    backend: str | None = None,
    master: str | None = None,
) -> Generator[tuple[Path, dict[str, Any]]]:
    """Yield the package of a system, and the options of :class:`vdfmu.Simulator` that it takes.

    The system is a scenario, its name or file, or an ``.ssp``; `settings` change its parameters, `backend` is the kind
    of a scenario's FMUs, ``native`` or ``python``, and `master` replaces its own.
    """
    if not isinstance(system, Scenario):
        if Path(system).suffix.lower() == ".ssp":
            yield Path(system), {"parameters": settings, "algorithm": master}
            return
        system = load_scenario(system)
    values = system_values(system, settings)
    with temporary_folder("vdfmu_") as folder:
        built = cached_fmus(system, folder, backend)
        options = {"algorithm": master or system.master, "inputs": system.inputs, "input_hold": system.input_hold}
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


class SystemMargins(NamedTuple):
    """Margins of the loops of a system: names of the inputs where they are opened, times [s], and margins at each."""

    names: tuple[str, ...]
    times: list[float]
    margins: list[Margins]
    algorithm: str
    step: float
    notes: tuple[str, ...]
    growth: float
    """Rate [1/s] that still counts as stable."""
    growing: list[str]
    """At each time the state with the largest part in the mode that grows most; empty where it is stable."""

    def rate(self, k: int) -> float:
        """Return the rate [1/s] of the mode that grows most at the k-th time, or decays least; -inf without any."""
        radius = self.margins[k].radius
        return math.log(radius) / self.step if radius else -math.inf


def margins_along(
    system: Scenario | str | os.PathLike[str],
    opened: Sequence[str] = ("plant.tau",),
    at: Sequence[float] | None = None,
    *,
    growth: float = GROWTH,
    master: str | None = None,
    settings: Mapping[str, Any] | None = None,
    backend: str | None = None,
) -> SystemMargins:
    """Margins of stability of the sampled loops of a scenario or package, linearised at times of its run.

    Parameters
    ----------
    system, settings, backend, master
        See :func:`packaged`; under ``gauss-seidel`` or ``jacobi``.
    opened, growth
        See :func:`vdfmu.engine.linear.loops.system_margins`; by default the growth that the verdict of a run allows.
    at : sequence of float, optional [s]
        Default five, evenly spread from the start to the end, as the verdict of a run has them.

    Raises
    ------
    UsageError, SspError, CosimError
        See these, and :func:`vdfmu.engine.linear.linearise.linear_system`.
    """
    if math.isnan(growth):
        raise UsageError("growth: expected a rate in 1/s up to which what grows counts as stable, got nan.")
    with packaged(system, settings, backend, master) as (package, options):
        if at is None:
            begin, end, step, n = Simulator(package, **options).grid(None, None, None)
            at = [begin + row * step for row in margin_rows(n)[:-1]] + [end]
        found = (linear_system(package, t, **options) for t in counted("loops", at, len(at)))
        systems = [replace(one, parts=of_positions(one.parts)) for one in found]
    first = systems[0]
    names = tuple(first.parts.inputs[i] for i in first.places(opened))
    notes = tuple(dict.fromkeys(note for each in systems for note in each.parts.notes))
    margins = [system_margins(each, opened, growth) for each in systems]
    growing = [
        "" if m.radius < math.exp(growth * s.period) else fastest_mode(s)[1]
        for s, m in zip((each.around(opened) for each in systems), margins, strict=True)
    ]
    period = first.around(opened).period
    return SystemMargins(names, [float(t) for t in at], margins, first.algorithm, period, notes, growth, growing)
