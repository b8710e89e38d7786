"""Checks that a study fits its systems: signals, measures, axes that act."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from vdfmu.base.errors import UsageError
from vdfmu.base.files import temporary_folder
from vdfmu.base.text import close_to, matching
from vdfmu.engine.package.read import load_ssp
from vdfmu.engine.plan.check import check_system
from vdfmu.engine.results.results import Results, Signal
from vdfmu.study.sweeps.axes import Axis
from vdfmu.study.sweeps.job import WiredSystem
from vdfmu.study.sweeps.measures import Measure, read_measures

TRACKING = {
    "error": "rms(trajectory.q_d - plant.q)",
    "peak_error": "peak(trajectory.q_d - plant.q)",
    "peak_torque": "peak(controller.tau)",
}
"""Measures of a tracking loop, if none are given."""


def signals_of(system: WiredSystem, axes: Sequence[Axis]) -> tuple[list[str], dict[str, str], tuple[float, float]]:
    """Check a system, and the axes by one of their values.

    Returns
    -------
    names
        Signals that it can record.
    units
        Units of all its variables that have one, with and without indices.
    times
        Start and stop [s].
    """
    parameters = dict(system.options.get("parameters", {}))
    for axis in axes:
        if axis.target in system.bindings:
            value = axis.values[0] if axis.values else axis.at(0.5).item()
            parameters |= system.bindings[axis.target].values(value)
    with temporary_folder("vdfmu_sweep_") as folder:
        path = Path(folder, "0.ssp")
        path.write_bytes(system.content)
        read = load_ssp(path)
        checked = check_system(
            read, parameters, inputs=system.inputs, algorithm=system.options.get("algorithm"),
            repeats=system.options.get("adaptive") is not None,
        )  # fmt: skip
    run = {name: getattr(read.experiment, name) for name in ("start", "stop", "step")} | dict(system.run)
    missing = [name for name in ("stop", "step") if run[name] is None]
    if missing:
        raise UsageError(f"{' and '.join(missing)}: the package says none; give one.")
    outputs = [
        f"{name}.{v.name}" for name, each in checked.descriptions.items() for v in each.variables.values()
        if v.causality == "output"
    ]  # fmt: skip
    units: dict[str, str] = {}
    for name, each in checked.descriptions.items():
        for v in each.variables.values():
            if v.unit is not None:
                units[f"{name}.{v.name}"] = units[f"{name}.{v.name.partition('[')[0]}"] = v.unit.name
    names = dict.fromkeys([*outputs, *(".".join(link.end) for link in checked.links if link.stepped)])
    return list(names), units, (run["start"] or 0.0, run["stop"])


def check_overlap(axes: Sequence[Axis], system: WiredSystem) -> None:
    """Raise UsageError for axes without effect, since others after them set the same."""
    problems: list[str] = []
    later: dict[str, str] = {}
    for target in reversed([axis.target for axis in axes if axis.target in system.bindings]):
        names = system.bindings[target].names
        over = {later.get(name, later.get(name.partition("[")[0], "")) for name in names}
        if "" not in over:
            problems.append(
                f"{target}: has no effect, as {', '.join(sorted(over))} after it sets the same; leave one out, or give "
                "the one of more elements first."
            )
        later |= dict.fromkeys(names, target)
    if problems:
        raise UsageError("\n".join(problems[::-1]))


def try_measures(names: Sequence[str], measures: Sequence[Measure], times: tuple[float, float]) -> None:
    """Evaluate the expressions on signals of zeros; UsageError for values that no results have."""
    signals = [Signal(name, "real", "", 0) for name in names]
    zeros = Results(np.array(times), signals, {"real": np.zeros((2, 1))})
    problems: list[str] = []
    for measure in (one for one in measures if one.function is None):
        try:
            measure.of(zeros)
        except UsageError as error:
            problems.append(str(error))
    if problems:
        raise UsageError("\n".join(problems))


def default_measures(names: Sequence[str]) -> list[Measure]:
    """Return the measures of a tracking loop; UsageError where there is none."""
    if not {"trajectory.q_d[1]", "plant.q[1]", "controller.tau[1]"} <= set(names):
        raise UsageError(
            "measure: expected at least one, such as 'error=rms(a.x - b.y)'; only the loop of trajectory, controller "
            "and plant has some of its own."
        )
    return read_measures(TRACKING)


def recorded(names: Sequence[str], measures: Sequence[Measure], keep: Sequence[str]) -> list[str]:
    """Return patterns of what a run records; UsageError for unknown signals."""
    known = set(names)
    groups = {name.partition("[")[0] for name in names}
    record: list[str] = list(keep)
    problems = [
        f"record: no output or connected input is called {text}." for text in keep if not matching(names, [text])
    ]
    for measure in measures:
        for signal in measure.signals:
            if signal in known or signal == "*":
                record.append(signal)
            elif signal in groups:
                record.append(f"{signal}[*")
            else:
                way = close_to(signal, [*groups, *names]) or "."
                problems.append(
                    f"measure {measure.name} = {measure.text}: no output or connected input is called {signal}{way}"
                )
    if problems:
        raise UsageError("\n".join(problems))
    return list(dict.fromkeys(record))
