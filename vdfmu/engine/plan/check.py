"""Checks a system before it runs, with all problems at once: the checked system, and the steps of its components."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property

from vdfmu.base.errors import SspError, UsageError
from vdfmu.engine.algorithms import ALGORITHMS, DELAYED, Algorithm, choice
from vdfmu.engine.fmu.description import Description
from vdfmu.engine.fmu.variables import FmuVariable
from vdfmu.engine.package.system import FlatSystem, Value
from vdfmu.engine.plan.checker import Checker, overrides, unfed
from vdfmu.engine.plan.conversion import SOURCE, Link, Port
from vdfmu.engine.plan.inputs import Feed, InputTable, feed_inputs
from vdfmu.engine.plan.schedule import Schedule, choose_schedule
from vdfmu.engine.rules import finding


@dataclass(frozen=True)
class Checked:
    """A system that can be run."""

    system: FlatSystem
    descriptions: Mapping[str, Description]
    """Each component by its name, in the order of the SSD."""
    links: tuple[Link, ...]
    """Connections, including those from the signals of `feed`."""
    algorithm: str
    """The master algorithm of `schedule`."""
    schedule: Schedule
    starts: Mapping[str, Sequence[tuple[FmuVariable, Value]]]
    """Values to set in each component before initialization, in the units of the FMU."""
    notes: tuple[str, ...]
    """Notes, not errors, such as unconnected inputs."""
    feed: Feed | None = None
    """Signals from outside."""
    clock_links: tuple[tuple[Port, Port], ...] = ()
    """Connections of clocks."""
    multiples: Mapping[str, int] = field(default_factory=dict)
    """Communication steps per own step of a component; empty if all step together."""

    @property
    def how(self) -> Algorithm:
        """The row of the algorithm."""
        return ALGORITHMS[self.algorithm]

    @cached_property
    def held(self) -> list[str]:
        """Inputs, without indices, that hold the value of their source at the start of each step."""
        late = (k.end for k in self.links if k.stepped and k.start[0] != SOURCE and k.end not in self.schedule.fresh)
        return [*dict.fromkeys(f"{unit}.{name.partition('[')[0]}" for unit, name in late)] if self.how.substeps else []

    @property
    def early(self) -> set[str]:
        """Components that make their own step at its start: in an ordered algorithm, the sources of fresh inputs."""
        direct = self.schedule.direct
        return {k.start[0] for k in self.links if k.start in direct} if self.how.ordered else set()

    @property
    def sizes(self) -> dict[str, Value]:
        """The structural parameters that are set, and their values."""
        return {
            f"{name}.{variable.name}": value
            for name, each in self.starts.items()
            for variable, value in each
            if variable.causality == "structuralParameter"
        }

    @property
    def sources(self) -> Mapping[str, Description]:
        """Everything that has outputs: the components, then the external signals."""
        return {**self.descriptions, **({SOURCE: self.feed.description} if self.feed else {})}


def check_system(
    system: FlatSystem,
    parameters: Mapping[str, Value] | None = None,
    *,
    inputs: Sequence[InputTable] = (),
    algorithm: str | None = None,
    repeats: bool = False,
    ignore_unmatched: bool = False,
) -> Checked:
    """Check a system against its FMUs and prepare its run.

    Parameters
    ----------
    system : FlatSystem
    parameters : mapping of str to value, optional
        Values of ``component.variable``, in the unit of the FMU; without an index, of all its elements: one value, or a
        list or array with one each. They override the package's values.
    inputs : sequence of InputTable
        Signals for unconnected inputs.
    algorithm : str, optional
        Default: see `vdfmu.engine.plan.schedule.choose_schedule`.
    repeats : bool
        Whether steps may be repeated and vary in length, so that units must save and restore their state.
    ignore_unmatched : bool
        Makes a bound parameter without a variable a note, as in SSP 1.0. It is almost always a spelling mistake.

    Raises
    ------
    SspError
        With all problems: of the wiring, connectors, types, units, parameters, FMUs and algebraic loops.
    UsageError
        For an unknown algorithm, for `inputs` without a free input, and for unknown, fixed or mistyped `parameters`.
    """
    require_algorithm(algorithm)
    checker = Checker(system, ignore_unmatched, parameters or {})
    checker.read()
    links = checker.link()
    descriptions = {c.name: checker.descriptions[c.name] for c in system.components if c.name in checker.descriptions}
    feed, wrong = feed_inputs(inputs, descriptions, links, checker.port_unit, system.units)
    if wrong and not checker.problems:
        raise UsageError("\n".join(wrong))
    if feed is not None:
        links += feed.links
    checker.inputs(links)
    starts = checker.start_values()
    # start values of inputs are common in parameter sets and need no note
    fixed = {link.end: link.start for link in links if not link.stepped}
    for name, values in starts.items():
        notes = _fed(name, values, fixed, "the value of the parameter set")
        checker.findings += [finding("SSP057", note) for note in notes]
    sources = descriptions if feed is None else {**descriptions, SOURCE: feed.description}
    algorithm, schedule, loops, notes = choose_schedule(sources, links, algorithm)
    if feed is not None:
        blocks = tuple(block for block in schedule.blocks if SOURCE not in block)
        schedule = schedule._replace(units=tuple(u for u in schedule.units if u != SOURCE), blocks=blocks)
    notes += [f"algebraic loop during initialization, solved: {loop}" for loop in dict.fromkeys(schedule.initial.loops)]
    checker.findings += [finding("SSP039", loop) for loop in loops] + [finding("SSP059", note) for note in notes]
    problems, notes = _check_abilities(descriptions, links, schedule, algorithm, repeats)
    checker.findings += [finding("RUN007", each) for each in problems] + [finding("RUN010", each) for each in notes]
    if problems := checker.problems:
        error = SspError(list(dict.fromkeys(problems)))
        error.notes = checker.notes
        raise error
    notes = *checker.notes, *(feed.notes if feed is not None else ())
    checked = Checked(
        system,
        descriptions,
        tuple(links),
        algorithm,
        schedule,
        {name: list(values.values()) for name, values in starts.items()},
        notes,
        feed,
        tuple(checker.clock_links),
    )
    return with_parameters(checked, parameters or {})


def require_algorithm(name: str | None) -> None:
    """Raise UsageError for an unknown algorithm."""
    if name is not None and name not in ALGORITHMS:
        raise UsageError(f"unknown algorithm {name!r}; there are {', '.join(ALGORITHMS.names())}")


def check_coupling(algorithm: str, adaptive: float | None, convergence: float | None = None) -> None:
    """Raise UsageError for inconsistent options of the coupling."""
    if adaptive is not None:
        if algorithm in ALGORITHMS and not ALGORITHMS[algorithm].continuous:
            raise UsageError(
                f"adaptive: {algorithm} samples the signals with the step, so the step is a property of the system; "
                f"use {choice(continuous=True)}"
            )
        if not 0.0 < adaptive < 1.0:
            raise UsageError(f"adaptive: expected a relative error between 0 and 1, got {adaptive:g}")
    if convergence is not None and algorithm in ALGORITHMS and not ALGORITHMS[algorithm].repeats:
        raise UsageError(f"convergence is only for {choice(repeats=True)}, because {algorithm} repeats no steps")
    if convergence is not None and not 0.0 < convergence < 1.0:
        raise UsageError(f"convergence: expected a relative change between 0 and 1, got {convergence:g}")


def with_parameters(checked: Checked, parameters: Mapping[str, Value]) -> Checked:
    """Return a checked system with other `parameters`, see `check_system`; they override its own."""
    if not parameters:
        return checked
    fed = {link.end: link.start for link in checked.links}
    starts = {name: {v.name: (v, value) for v, value in each} for name, each in checked.starts.items()}
    notes = [*checked.notes]
    for name, values in overrides(checked.descriptions, parameters, starts).items():
        starts.setdefault(name, {}).update(values)
        without = {unfed(name, each) for each in values}
        notes = [each for each in notes if each not in without]
        notes += _fed(name, values, fed, "the value that was given")
    return replace(checked, starts={name: list(each.values()) for name, each in starts.items()}, notes=tuple(notes))


def _fed(name: str, values: Iterable[str], sources: Mapping[Port, Port], subject: str) -> list[str]:
    """Return notes on values of a component's variables that are connected to `sources`."""
    return [
        f"{name}.{variable}: {subject} has no effect, because {'.'.join(sources[name, variable])} is connected to it"
        for variable in values
        if (name, variable) in sources
    ]


def _check_abilities(
    descriptions: Mapping[str, Description], links: Sequence[Link], schedule: Schedule, algorithm: str, adaptive: bool
) -> tuple[list[str], list[str]]:
    """Return problems and notes of units that the algorithm cannot step; `adaptive` repeats and varies steps."""
    problems: list[str] = []
    how = ALGORITHMS[algorithm]
    for name, unit in descriptions.items():
        clocks = [v.name for v in unit.variables.values() if v.clock is not None]
        if clocks and unit.identifier and (how.continuous or not unit.event_mode):
            way = f"use {choice(continuous=False)}"
            way = way if unit.event_mode else "the FMU declares no event mode (hasEventMode)"
            problems.append(f"{name}: {unit.source} has clocks ({', '.join(clocks)}) that tick in event mode; {way}")
    if not (how.continuous or how.substeps):
        text = f"the algorithm {algorithm} declares neither substeps nor continuous in its Algorithm"
        return problems, [f"{text}: the run records all inputs, and its stability is not judged"]
    if not how.continuous:
        return problems, []
    # a unit alone in its block is repeated only by error control
    repeated = {name for block in schedule.blocks if adaptive or (how.repeats and len(block) > 1) for name in block}
    notes: list[str] = []
    for name, unit in descriptions.items():
        if name in repeated and not unit.saves_state:
            way = f"use {choice(continuous=True, repeats=False)} with a fixed step, {choice(continuous=False)}"
            text = f"{name}: {unit.source} cannot save and restore its state (canGetAndSetFMUstate)"
            problems.append(f"{text}, so its steps cannot be repeated; {way}")
        if adaptive and not unit.varies_steps:
            text = f"{name}: {unit.source} takes steps of one length only (canHandleVariableCommunicationStepSize)"
            problems.append(f"{text}; use a fixed step")
        direct = [k.end[1] for k in links if k.end[0] == name and not k.discrete and k.end in schedule.through]
        if direct and not unit.interpolates_inputs and not unit.varies_steps:
            notes.append(
                f"{name}: takes no derivatives of its inputs and steps of one length only; {', '.join(direct)} hold "
                "their values at the end of a step, because an output depends on them directly. If it integrates them, "
                "the coupling is of first order"
            )
    return problems, notes


def with_steps(checked: Checked, step: float) -> Checked:
    """Return a checked system with the number of communication steps, `step` [s], per own step of each component.

    UsageError for steps that are not whole multiples of `step` or that the algorithm cannot make, and for periods of
    sampled states that are not whole multiples of their component's step.
    """
    multiples: dict[str, int] = {}
    problems: list[str] = []
    for component in checked.system.components:
        if component.step is None:
            continue
        ratio = component.step / step
        multiples[component.name] = max(1, round(ratio))
        if abs(ratio - multiples[component.name]) > 1e-9 * ratio:
            problems.append(
                f"{component.name}: its step {component.step:g} s is not a whole multiple of the communication step "
                f"{step:g} s; choose another one (step, --step)"
            )
    slow = [name for name, multiple in multiples.items() if multiple > 1]
    if slow and checked.how.substeps != 1:
        text = f"{', '.join(slow)}: have their own steps, but {checked.algorithm} takes one step for all"
        problems.append(f"{text}; use {choice(substeps=1)}")
    if multiples and (
        ticking := [name for name, d in checked.descriptions.items() if any(v.clock for v in d.variables.values())]
    ):
        problems.append(
            f"{', '.join(ticking)}: have clocks, and {', '.join(multiples)} their own steps; clocks need components "
            "that step together. Leave out the steps or the clocks"
        )
    for name in set(slow) & checked.early if slow else ():
        late = [k for k in checked.links if k.stepped and k.start[0] == name and k.start not in checked.schedule.direct]
        if late:
            problems.append(
                f"{name}: has its own step, passes inputs on within it, and its state {'.'.join(late[0].start)} is "
                f"read; {checked.algorithm} cannot pass on both at their times; use {DELAYED}, or split the unit"
            )
    notes: list[str] = []
    for name, period in periods(checked).items():
        if wrong := [k for k in checked.links if k.end == (name, checked.descriptions[name].period)]:
            problems.append(f"{wrong[0]}: expected a value for the time between samples, not a connection")
        fed = [k for k in checked.links if k.stepped and k.end[0] == name]
        h = step * multiples.get(name, 1) / max(1, checked.how.substeps)
        if fed and abs(period / h - max(1, round(period / h))) > 1e-9 * period / h:
            problems.append(
                f"{name}: samples every {period:g} s, expected a whole multiple of its step {h:g} s: between "
                f"communication points it would read inputs of an earlier time. Take a step that divides the period, "
                f"such as {period / math.ceil(period / h - 1e-9):g} s (step, --step), or another period (--set "
                f"{name}.{checked.descriptions[name].period}={h * max(1, round(period / h)):g})"
            )
        sampled = {k.start for k in checked.links if k.source.variability == "discrete"} | checked.schedule.direct
        late = {
            k.start[1]
            for k in checked.links
            if k.stepped and k.start[0] == name and k.start in sampled and k.end not in checked.schedule.fresh
        }
        if late and not checked.how.continuous:
            groups = ", ".join(dict.fromkeys(output.split("[")[0] for output in late))
            notes.append(f"{name}: samples every {period:g} s; a sample acts on {groups} a step later, after {h:g} s")
    if problems:
        raise UsageError("\n".join(problems))
    if not (slow or notes or checked.multiples):
        return checked
    return replace(checked, multiples=multiples if slow else {}, notes=(*checked.notes, *sorted(notes)))


def periods(checked: Checked) -> dict[str, float]:
    """Return the sample periods [s] of the components that have sampled states and name their period."""
    times: dict[str, float] = {}
    for name, each in checked.descriptions.items():
        if each.period in each.variables:
            values = {v.name: value for v, value in checked.starts.get(name, ())}
            times[name] = float(values.get(each.period, each.variables[each.period].start))
    return times
