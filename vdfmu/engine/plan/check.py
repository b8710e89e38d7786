"""A system that can be run, and everything that can be said about one before it runs: all problems at once."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace

from vdfmu.base.errors import SspError, UsageError
from vdfmu.engine.algorithms import ALGORITHMS, Algorithm, choice
from vdfmu.engine.fmu.description import Description
from vdfmu.engine.fmu.variables import FmuVariable
from vdfmu.engine.package.system import FlatSystem, Value
from vdfmu.engine.plan.checker import Checker, overrides
from vdfmu.engine.plan.conversion import SOURCE, Link, Port
from vdfmu.engine.plan.feed import Feed, feed_inputs
from vdfmu.engine.plan.inputs import InputTable
from vdfmu.engine.plan.schedule import Schedule, choose_schedule
from vdfmu.engine.rules import finding


@dataclass(frozen=True)
class Checked:
    """A system that can be run."""

    system: FlatSystem
    descriptions: Mapping[str, Description]
    """Each component by its name, in the order of the SSD."""
    links: tuple[Link, ...]
    """Including links from the signals of `feed`."""
    algorithm: str
    """The master algorithm that `schedule` is for."""
    schedule: Schedule
    starts: Mapping[str, Sequence[tuple[FmuVariable, Value]]]
    """Values to set in each component before initialization, in the units of the FMU."""
    notes: tuple[str, ...]
    """Notes, not errors: inputs that nothing feeds, for example."""
    feed: Feed | None = None
    """Signals from outside."""
    clock_links: tuple[tuple[Port, Port], ...] = ()
    """Connections of clocks."""
    multiples: Mapping[str, int] = field(default_factory=dict)
    """Communication steps that a component's own step takes; empty where all step together."""

    @property
    def how(self) -> Algorithm:
        """The row of the algorithm."""
        return ALGORITHMS[self.algorithm]

    @property
    def held(self) -> list[str]:
        """Inputs, without indices, that take in each step what their source had at its beginning."""
        late = (k.end for k in self.links if k.stepped and k.start[0] != SOURCE and k.end not in self.schedule.fresh)
        return [*dict.fromkeys(f"{unit}.{name.partition('[')[0]}" for unit, name in late)] if self.how.substeps else []

    @property
    def sources(self) -> Mapping[str, Description]:
        """Everything that has outputs: the components, and after them the signals from outside."""
        return {**self.descriptions, **({SOURCE: self.feed.description} if self.feed else {})}


def check_system(
    system: FlatSystem,
    parameters: Mapping[str, Value] | None = None,
    *,
    inputs: Sequence[InputTable] = (),
    algorithm: str | None = None,
    repeats: bool = False,
    strict: bool = False,
    ignore_unmatched: bool = False,
) -> Checked:
    """Check a system against its FMUs and prepare its run.

    Parameters
    ----------
    system : FlatSystem
    parameters : mapping of str to value, optional
        Values of ``component.variable``, in the unit of the FMU; without an index, of all ``component.variable[...]``:
        one value, or a list or array with one for each. They win over the package's values.
    inputs : sequence of InputTable
        Signals for inputs that nothing is connected to.
    algorithm : str, optional
        One of `vdfmu.engine.run.ALGORITHMS`; default: see `vdfmu.engine.plan.schedule.choose_schedule`.
    repeats : bool
        Whether steps may be repeated and vary, so that units must save and restore their state.
    strict : bool
        Makes an input that has neither a connection nor a bound value a problem instead of a note.
    ignore_unmatched : bool
        Makes a bound parameter that no variable matches a note, following SSP 1.0. By default it is a
        problem, because it is nearly always a misspelling.

    Returns
    -------
    Checked

    Raises
    ------
    SspError
        With all problems: of the wiring, connectors, types, units, parameters, FMUs and algebraic loops.
    UsageError
        An unknown algorithm, `inputs` that fit no free input, or `parameters` that name something unknown, not settable
        or of another type.
    """
    if algorithm is not None and algorithm not in ALGORITHMS:
        raise UsageError(f"unknown algorithm {algorithm!r}; there are {', '.join(ALGORITHMS.names())}")
    checker = Checker(system, strict, ignore_unmatched, parameters or {})
    checker.read()
    links = checker.link()
    known = {c.name: checker.descriptions[c.name] for c in system.components if c.name in checker.descriptions}
    feed, wrong = feed_inputs(inputs, known, links, checker.port_unit, system.units)
    if wrong and not checker.problems:
        raise UsageError("\n".join(wrong))
    if feed is not None:
        links += feed.links
        checker.notes += feed.notes
    checker.inputs(links)
    starts = checker.start_values()
    # start values of inputs in parameter sets are common and need no note
    fixed = {link.end: link.start for link in links if not link.stepped}
    for name, values in starts.items():
        notes = _fed(name, values, fixed, "the value of the parameter set")
        checker.notes += [finding("SSP057", note) for note in notes]
    sources = known if feed is None else {**known, SOURCE: feed.description}
    algorithm, schedule, loops, notes = choose_schedule(sources, links, algorithm)
    if feed is not None:
        blocks = tuple(block for block in schedule.blocks if SOURCE not in block)
        schedule = replace(schedule, units=tuple(u for u in schedule.units if u != SOURCE), blocks=blocks)
    checker.problems += [finding("SSP039", loop) for loop in loops]
    checker.notes += [finding("SSP039", note) for note in notes]
    for loop in dict.fromkeys(schedule.initial.loops):
        checker.notes.append(finding("SSP039", f"algebraic loop during initialization, solved: {loop}"))
    problems, notes = _check_abilities(known, links, schedule, algorithm, repeats)
    checker.problems += [finding("RUN007", problem) for problem in problems]
    checker.notes += [finding("RUN007", note) for note in notes]
    if checker.problems:
        error = SspError(list(dict.fromkeys(checker.problems)))
        error.notes = checker.notes
        raise error
    checked = Checked(
        system=system,
        descriptions=known,
        links=tuple(links),
        algorithm=algorithm,
        schedule=schedule,
        starts={name: list(values.values()) for name, values in starts.items()},
        notes=tuple(checker.notes),
        feed=feed,
        clock_links=tuple(checker.clock_links),
    )
    return with_parameters(checked, parameters or {})


def with_parameters(checked: Checked, parameters: Mapping[str, Value]) -> Checked:
    """Return a checked system with other `parameters`, see `check_system`; they win over those that it has."""
    fed = {link.end: link.start for link in checked.links}
    starts = {name: {v.name: (v, value) for v, value in each} for name, each in checked.starts.items()}
    notes = [*checked.notes]
    for name, values in overrides(checked.descriptions, parameters).items():
        starts.setdefault(name, {}).update(values)
        notes += _fed(name, values, fed, "the value that was given")
    return replace(checked, starts={name: list(each.values()) for name, each in starts.items()}, notes=tuple(notes))


def _fed(name: str, values: Iterable[str], sources: Mapping[Port, Port], what: str) -> list[str]:
    """Return the notes on values of variables of a component that a connection feeds, by what feeds each."""
    return [
        f"{name}.{variable}: {what} has no effect; it is that of {'.'.join(sources[name, variable])}, which feeds it"
        for variable in values
        if (name, variable) in sources
    ]


def _check_abilities(
    descriptions: Mapping[str, Description], links: Sequence[Link], schedule: Schedule, algorithm: str, adaptive: bool
) -> tuple[list[str], list[str]]:
    """Return the problems and notes of units that an algorithm cannot step as it has to.

    `adaptive`: steps may be rejected and differ in length.
    """
    problems: list[str] = []
    how = ALGORITHMS[algorithm]
    for name, unit in descriptions.items():
        clocks = [v.name for v in unit.variables.values() if v.clock is not None]
        if clocks and unit.identifier and (how.continuous or not unit.event_mode):
            way = (
                f"use {choice(continuous=False)}"
                if unit.event_mode
                else "the FMU declares no event mode (hasEventMode)"
            )
            problems.append(f"{name}: {unit.source} has clocks, {', '.join(clocks)}, which tick in event mode; {way}")
    if not (how.continuous or how.substeps):
        text = f"the algorithm {algorithm} declares neither substeps nor continuous in its Algorithm"
        return problems, [f"{text}: the run records all inputs, and its stability is not judged"]
    if not how.continuous:
        return problems, []
    # a unit alone in its block is repeated by error control only
    repeated = {name for block in schedule.blocks if adaptive or (how.repeats and len(block) > 1) for name in block}
    notes: list[str] = []
    for name, unit in descriptions.items():
        if name in repeated and not unit.saves_state:
            problems.append(
                f"{name}: {unit.source} cannot save and restore its state (canGetAndSetFMUstate), so its steps cannot "
                f"be repeated; use {choice(continuous=True, repeats=False)} with a fixed step, "
                f"{choice(continuous=False)}"
            )
        if adaptive and not unit.varies_steps:
            problems.append(
                f"{name}: {unit.source} takes steps of one length only (canHandleVariableCommunicationStepSize); use a "
                "fixed step"
            )
        direct = [k.end[1] for k in links if k.end[0] == name and not k.discrete and k.end in schedule.through]
        if direct and not unit.interpolates_inputs and not unit.varies_steps:
            notes.append(
                f"{name}: takes no derivatives of its inputs and steps of one length only; {', '.join(direct)} are "
                "held at their values at the end of a step, as an output depends on them directly. If it integrates "
                "them, the coupling is of first order"
            )
    return problems, notes
