"""Plans a parameter study: from a scenario or package and its axes to checked systems and points."""

from __future__ import annotations

import hashlib
import json
import os
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any, Unpack

import numpy as np

from vdfmu.base.errors import UsageError
from vdfmu.base.extras import module_of_extra
from vdfmu.base.files import read_regular, temporary_folder
from vdfmu.base.option import pick, with_options
from vdfmu.base.progress import counted
from vdfmu.base.text import close_to, matching
from vdfmu.base.version import __version__
from vdfmu.engine.options import CouplingOptions
from vdfmu.engine.package.archive import unpack_limit
from vdfmu.engine.package.read import DEFAULT
from vdfmu.engine.plan.check import check_system
from vdfmu.engine.plan.inputs import read_inputs
from vdfmu.engine.results.results import Results, Signal
from vdfmu.engine.rules import runs_anyway
from vdfmu.study.options import ENGINES, PlanOptions, ScenarioOptions
from vdfmu.study.sweeps.axes import Axis, Points, draw, is_option, read_axes
from vdfmu.study.sweeps.digest import value_digest
from vdfmu.study.sweeps.job import AxisBinding, Job, Task, WiredSystem
from vdfmu.study.sweeps.measures import Measure, read_measures, unit_of

TRACKING = {
    "error": "rms(trajectory.q_d - plant.q)",
    "peak_error": "peak(trajectory.q_d - plant.q)",
    "peak_torque": "peak(controller.tau)",
}
"""Default measures of a tracking loop."""
_COUPLED = ("algorithm", "parameters", "tolerance", *CouplingOptions.__annotations__)
"""Options of the simulator of a package."""


def signals_of(system: WiredSystem, axes: Sequence[Axis]) -> tuple[list[str], dict[str, str], tuple[float, float]]:
    """Check a system and its axes. Return signals to record, units by name and by array, start and stop [s]."""
    parameters = dict(system.options.get("parameters", {}))
    for axis in axes:
        if axis.target in system.bindings:
            value = axis.values[0] if axis.values else axis.at(0.5).item()
            parameters |= system.bindings[axis.target].values(value)
    with temporary_folder("vdfmu_sweep_") as folder:
        read = system.read(Path(folder, "system"))
        checked = check_system(
            read, parameters, inputs=system.inputs, algorithm=system.options.get("algorithm"),
            repeats=system.options.get("adaptive") is not None,
        )  # fmt: skip
    run = {name: getattr(read.experiment, name) for name in ("start", "stop", "step")} | dict(system.run)
    missing = [name for name in ("stop", "step") if run[name] is None]
    if missing:
        raise UsageError(f"{' and '.join(missing)}: the package does not state it, so give it as an option.")
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
    """Raise UsageError for axes without effect because later ones set the same."""
    problems: list[str] = []
    later: dict[str, str] = {}
    for target in reversed([axis.target for axis in axes if axis.target in system.bindings]):
        names = system.bindings[target].names
        over = {later.get(name, later.get(name.partition("[")[0], "")) for name in names}
        if "" not in over:
            problems.append(
                f"{target}: has no effect, because {', '.join(sorted(over))} comes after it and sets the same. Remove "
                "one, or put the axis with more elements first."
            )
        later |= dict.fromkeys(names, target)
    if problems:
        raise UsageError("\n".join(problems[::-1]))


def try_measures(names: Sequence[str], measures: Sequence[Measure], times: tuple[float, float]) -> None:
    """Evaluate the expressions on zero signals; UsageError for expressions that cannot be evaluated."""
    signals = [Signal(name, "real", "", 0) for name in names]
    zeros = Results(np.array(times), signals, {"real": np.zeros((2, 1))})
    problems: list[str] = []
    for measure in measures:
        if measure.function is not None:
            continue
        try:
            measure.of(zeros)
        except UsageError as error:
            problems.append(str(error))
    if problems:
        raise UsageError("\n".join(problems))


def default_measures(names: Sequence[str]) -> list[Measure]:
    """Return the measures of a tracking loop; UsageError for another system."""
    if not {"trajectory.q_d[1]", "plant.q[1]", "controller.tau[1]"} <= set(names):
        raise UsageError(
            "measure: expected at least one, such as 'error=rms(a.x - b.y)'; only the loop of trajectory, controller "
            "and plant has default measures."
        )
    return read_measures(TRACKING)


def recorded(names: Sequence[str], measures: Sequence[Measure], keep: Sequence[str]) -> list[str]:
    """Return patterns of signals to record; UsageError for unknown signals."""
    signals = set(names)
    groups = {name.partition("[")[0] for name in names}
    record: list[str] = list(keep)
    problems = [f"record: no output or connected input is called {k}." for k in keep if not matching(names, [k])]
    for measure in measures:
        for signal in measure.signals:
            if signal in signals or signal == "*":
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


_FEW = 16
"""Fewest points of a system for which the batch engine is the default."""
_MOST_SYSTEMS = 200


@dataclass(frozen=True)
class Plan:
    """A parameter study, ready to run."""

    points: Points
    chosen: Any
    """Number of each point's system, (n,)."""
    job: Job
    facts: dict[str, Any]
    """Facts for the ledger, the same for the same study."""

    def __len__(self) -> int:
        return len(self.chosen)

    def task(self, point: int) -> Task:
        """Return a worker's task for a point."""
        values = {t: column[point].item() for t, column in self.points.items() if not is_option(t)}
        number = int(self.chosen[point])
        return point, number, values

    @property
    def key(self) -> str:
        """Digest of `facts` without the paths of files and the history of a search; equal if the runs are equal."""
        apart = ("source", "options", "engine", "search")
        facts = {name: fact for name, fact in self.facts.items() if name not in apart}
        return hashlib.sha256(json.dumps(facts, sort_keys=True).encode()).hexdigest()


@with_options
def make_plan(scenario: Any, over: Mapping[str, Any] | Sequence[str] = (), **options: Unpack[PlanOptions]) -> Plan:
    """Plan a study; for arguments see `vdfmu.sweep`. Errors are raised before anything runs."""
    engine, measure, keep = options["engine"], options["measure"], options["record"]
    sample = os.fspath(options["sample"])
    if engine not in (None, *ENGINES):
        raise UsageError(f"engine: expected {' or '.join(ENGINES)}, got {engine!r}.")
    axes, points = draw(read_axes(over), sample, options["points"], options["seed"])
    switches = [axis for axis in axes if is_option(axis.target)]
    for axis in switches:
        if axis.factor:
            raise UsageError(f"{axis.target}: expected values, got factors.")
    count = len(next(iter(points.values())))
    rows = list(zip(*(points[axis.target].tolist() for axis in switches), strict=True)) or [()] * count
    combinations = {row: number for number, row in enumerate(dict.fromkeys(rows))}
    if len(combinations) > _MOST_SYSTEMS:
        raise UsageError(
            f"{', '.join(axis.target for axis in switches)}: expected at most {_MOST_SYSTEMS} different systems, got "
            f"{len(combinations)}; each is a package."
        )
    is_package = isinstance(scenario, (str, os.PathLike)) and Path(scenario).suffix.lower() == ".ssp"
    start, variant = options["start"], options["variant"]
    if not is_package and (start is not None or variant != DEFAULT):
        wrong = "start" if start is not None else "variant"
        raise UsageError(f"{wrong} is only for packages and FMUs, got the scenario {name_of(scenario)}. Omit it.")
    wire = partial(_of_package, start, variant) if is_package else of_scenario
    if engine is None:
        engine = "fmu" if count < _FEW * len(combinations) or options["backend"] == "python" else ""
    changes = pick(ScenarioOptions, options)
    systems: list[WiredSystem] = []
    measures: list[Measure] = [] if measure is None else read_measures(measure)
    for combination in counted("systems", combinations, len(combinations)):
        switched = dict(zip((axis.target for axis in switches), combination, strict=True))
        systems.append(wire(scenario, [a for a in axes if a not in switches], switched, changes, engine))
    record: list[str] = []
    units: dict[str, str] = {}
    for system in systems:
        names, signal_units, times = signals_of(system, axes)
        units = signal_units | units
        if measure is None:
            measures = default_measures(names)
        record = recorded(names, measures, keep)
        try_measures(names, measures, times)
    check_overlap(axes, systems[0])
    facts: dict[str, Any] = {
        "vdfmu": __version__,
        "scenario": name_of(scenario),
        "source": _plain(scenario),
        "axes": [str(axis) for axis in axes],
        "sample": sample,
        "n": count,
        "seed": options["seed"],
        "parameters": {name: _plain(value) for name, value in (options["parameters"] or {}).items()},
        "options": {
            name: _plain(value) for name, value in changes.items()
            if value is not None and name not in ("parameters", "backend")
        },
        "measures": {m.name: m.text for m in measures},
        "units": {axis.target: _unit_of_axis(axis, systems[0], units) for axis in axes}
        | {m.name: unit_of(m, units) for m in measures},
        "keep": list(keep),
        "engine": "batch" if any(system.program is not None for system in systems) else "fmu",
        "points": digest(*map(_bytes_of, points.values())),
        "systems": [
            {"options": {**s.options, **s.run}, "package": digest(s.content), "inputs": [t.digest for t in s.inputs],
             **({} if s.variant == DEFAULT else {"variant": s.variant})}
            for s in systems
        ],
    }  # fmt: skip
    if functions := {m.name: value_digest(m.function) for m in measures if m.function is not None}:
        facts["functions"] = functions
    chosen = np.array([combinations[row] for row in rows])
    compared = tuple(sorted({0, count // 2, count - 1}))
    kept = tuple(systems), tuple(measures), tuple(record), tuple(keep), compared
    return Plan(points, chosen, Job(*kept, unpack_limit(), runs_anyway()), facts)


def _plain(value: Any) -> Any:
    """Return an option as JSON if it is a number, several, a path or a name."""
    if isinstance(value, Mapping):
        return {str(name): _plain(each) for name, each in value.items()}
    if isinstance(value, (np.ndarray, np.generic)):
        return value.tolist()
    if isinstance(value, (list, tuple)):
        return [_plain(each) for each in value]
    if isinstance(value, os.PathLike):
        return os.fspath(value)
    return value if isinstance(value, (int, float)) else str(getattr(value, "name", value))


def name_of(scenario: Any) -> str:
    """Return the name of a scenario, or of a file without its suffix."""
    return Path(scenario).stem if isinstance(scenario, (str, os.PathLike)) else str(scenario.name)


def digest(*parts: bytes) -> str:
    """Return a short SHA-256 digest of contents."""
    return hashlib.sha256(b"\0".join(parts)).hexdigest()[:16]


def _bytes_of(column: np.ndarray[Any, Any]) -> bytes:
    """Return the bits of numbers, because their text takes long, and the text of other values."""
    return (column if column.dtype.kind in "iuf" else column.astype(str)).tobytes()


def _unit_of_axis(axis: Axis, system: WiredSystem, units: Mapping[str, str]) -> str:
    """Return the unit of an axis' values; empty for factors and texts."""
    if axis.target in system.bindings:
        name = system.bindings[axis.target].names[0]
        return "" if axis.factor else units.get(name, "")
    return "s" if axis.target in ("step", "stop") else ""


def _of_package(
    start: float | None,
    variant: str,
    package: Any,
    axes: Sequence[Axis],
    switched: Mapping[str, Any],
    options: ScenarioOptions,
    engine: str,
) -> WiredSystem:
    """Use a package as it is; the master checks the names of the axes."""
    if engine == "batch":
        raise UsageError("engine: batch needs a scenario, whose equations are known, got FMUs. Choose the engine fmu.")
    wrong = [target for target in switched if target not in ("algorithm", "step", "stop")]
    wrong += [name for name in ("robot", "units", "connections", "unfed") if options.get(name) is not None]
    wrong += [axis.target for axis in axes if axis.factor]
    wrong += [name for name in ("backend",) if options.get(name) is not None]
    if wrong:
        raise UsageError(f"{', '.join(wrong)}: expected a scenario, got FMUs, which have only parameters.")
    chosen: dict[str, Any] = {
        name: value for name, value in {**options, "start": start, **switched}.items() if value is not None
    }
    hold = bool(chosen.get("input_hold"))
    return WiredSystem(
        read_regular(Path(package)),
        {name: value for name, value in chosen.items() if name in _COUPLED},
        ({} if start is None else {"start": start})
        | {name: chosen[name] for name in ("step", "stop") if name in chosen},
        read_inputs(chosen.get("inputs"), hold),
        hold,
        {axis.target: AxisBinding((axis.target,)) for axis in axes},
        name=Path(package).name,
        variant=variant,
    )


def of_scenario(
    scenario: Any, axes: Sequence[Axis], switched: Mapping[str, Any], options: ScenarioOptions, engine: str = "fmu"
) -> WiredSystem:
    """Build and pack a scenario with a combination of options."""
    from vdfmu.study.run.prepare import prepare
    from vdfmu.system.package.write import cached_fmus, write_ssp
    from vdfmu.system.scenario.values import system_values

    units = dict(options.get("units") or {})
    units |= {name.removeprefix("unit:"): value for name, value in switched.items() if name.startswith("unit:")}
    plain = {name: value for name, value in switched.items() if not name.startswith("unit:")}
    changes: dict[str, Any] = {**options, **plain, "units": units or None}
    loaded = prepare(scenario, [axis.target for axis in axes], **changes)
    values = system_values(loaded, options.get("parameters"))
    bindings = {axis.target: _binding(loaded, axis, values) for axis in axes}
    bound = [name for binding in bindings.values() for name in binding.names]
    with temporary_folder("vdfmu_sweep_") as folder:
        fmus = cached_fmus(loaded, folder, options.get("backend"))
        package = write_ssp(loaded, fmus, Path(folder, "system.ssp"), values, mixed=True)
        content = read_regular(package)
    return WiredSystem(
        content,
        loaded.coupling,
        {"start": 0.0, "stop": loaded.stop, "step": loaded.step},
        read_inputs(loaded.inputs, loaded.input_hold),
        loaded.input_hold,
        bindings,
        None if engine == "fmu" else _program(loaded, values, bound, needed=engine == "batch"),
        scenario=value_digest(loaded),
    )


def _program(scenario: Any, values: Mapping[str, Any], names: Sequence[str], *, needed: bool) -> Any:
    """Return the program that runs points of a scenario side by side, if possible; UsageError if it is `needed`."""
    from vdfmu.system.package.description import SystemDescription

    try:
        return module_of_extra("programs", "batch", "the engine").make_program(
            SystemDescription(scenario, values), names
        )
    except UsageError as error:
        if not needed:
            return None
        lines = "\n".join(f"engine: batch: {line}" for line in str(error).splitlines())
        raise UsageError(f"{lines}\nChoose the engine fmu.") from None


def _binding(scenario: Any, axis: Axis, values: Mapping[str, Mapping[str, Any]]) -> AxisBinding:
    """Return the variables that an axis sets; UsageError if they are unknown or do not allow its values."""
    from vdfmu.system.scenario.values import override, present_values

    def names(value: Any) -> dict[str, Any]:
        by_component = override(scenario, {axis.target: value})
        return {f"{c}.{name}": number for c, each in by_component.items() for name, number in each.items()}

    if not axis.factor:
        if axis.form == "values" and any(isinstance(value, str) for value in axis.values):
            spread = {value: names(value) for value in axis.values}
            words = {value: next(iter(each.values())) for value, each in spread.items()}
            return AxisBinding(tuple(next(iter(spread.values()))), words=words)
        tried = axis.values or [axis.at(u).item() for u in ((0.0, 1.0) if axis.form in ("lin", "log") else (0.5,))]
        return AxisBinding([tuple(names(value)) for value in tried][0])
    reached = present_values(scenario, values, axis.target, 1.0)
    nominal = [value for value in reached.values() if isinstance(value, float)]
    if len(nominal) < len(reached):
        raise UsageError(f"{axis}: expected numbers to multiply, got {', '.join(map(str, reached.values()))}.")
    if not any(nominal):
        raise UsageError(f"{axis}: expected numbers to multiply that are not all 0. Vary values instead, without '*'.")
    return AxisBinding(tuple(reached), nominal=tuple(nominal))
