"""Components with steps of their own, whole multiples of the communication step, and the periods of sampled states."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace

from vdfmu.base.errors import UsageError
from vdfmu.engine.algorithms import DELAYED, choice
from vdfmu.engine.fmu.access import Call
from vdfmu.engine.fmu.instance import Instance
from vdfmu.engine.masters.exchange import Exchange
from vdfmu.engine.masters.sampled import SampledStepper
from vdfmu.engine.plan.check import Checked
from vdfmu.engine.plan.conversion import Link
from vdfmu.engine.plan.grid import largest_step


def with_steps(checked: Checked, step: float) -> Checked:
    """Return a checked system with the number of communication steps that each component's own step takes.

    Raises
    ------
    UsageError
        Steps that are not whole multiples of `step`, or that the algorithm cannot make; periods of sampled states that
        are not whole multiples of their component's step.
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
        problems.append(
            f"{', '.join(slow)}: have steps of their own, and {checked.algorithm} takes one step for all; use "
            f"{choice(substeps=1)}"
        )
    ticking = [name for name, d in checked.descriptions.items() if any(v.clock for v in d.variables.values())]
    if multiples and ticking:
        problems.append(
            f"{', '.join(ticking)}: have clocks, which tick where all components step together; "
            f"{', '.join(multiples)} have steps of their own. Leave these out, or the clocks"
        )
    for name in set(slow) & _feeding(checked):
        late = [k for k in checked.links if k.stepped and k.start[0] == name and k.start not in checked.schedule.direct]
        if late:
            problems.append(
                f"{name}: has a step of its own, passes inputs on within it, and {'.'.join(late[0].start)}, which is "
                f"read, is a state; {checked.algorithm} cannot pass on both at their times; use {DELAYED}, or split "
                "the unit"
            )
    notes: list[str] = []
    for name, period in periods(checked).items():
        if wrong := [k for k in checked.links if k.end == (name, checked.descriptions[name].period)]:
            problems.append(f"{wrong[0]}: expected a value for the time between samples, not a connection")
        fed = [k for k in checked.links if k.stepped and k.end[0] == name]
        own = step * multiples.get(name, 1) / max(1, checked.how.substeps)
        if fed and abs(period / own - max(1, round(period / own))) > 1e-9 * period / own:
            problems.append(
                f"{name}: samples every {period:g} s, expected a whole multiple of its step {own:g} s: between "
                f"communication points it would read inputs of an earlier time. Take a step that divides the period, "
                f"such as {period / math.ceil(period / own - 1e-9):g} s (step, --step), or another period (--set "
                f"{name}.{checked.descriptions[name].period}={own * max(1, round(period / own)):g})"
            )
        late = {k.start[1] for k in checked.links if _is_late(checked, k, name)}
        if late and not checked.how.continuous:
            groups = ", ".join(dict.fromkeys(output.split("[")[0] for output in late))
            notes.append(
                f"{name}: samples every {period:g} s; what {groups} says of a sample acts a step later, after {own:g} s"
            )
    if problems:
        raise UsageError("\n".join(problems))
    return replace(checked, multiples=multiples if slow else {}, notes=(*checked.notes, *sorted(notes)))


def periods(checked: Checked) -> dict[str, float]:
    """Return the times between samples [s] of the components that have sampled states and name their period."""
    found: dict[str, float] = {}
    for name, each in checked.descriptions.items():
        if each.period in each.variables:
            given = {v.name: value for v, value in checked.starts.get(name, ())}
            found[name] = float(given.get(each.period, each.variables[each.period].start))
    return found


def _is_late(checked: Checked, link: Link, name: str) -> bool:
    """Whether a link brings samples of a component to another one a step late."""
    sampled = link.source.variability == "discrete" or link.start in checked.schedule.direct
    return link.stepped and link.start[0] == name and sampled and link.end not in checked.schedule.fresh


def _feeding(checked: Checked) -> set[str]:
    """Return the units that compute for a step at its begin: of an ordered algorithm those that pass inputs on."""
    direct = checked.schedule.direct
    return {k.start[0] for k in checked.links if k.start in direct} if checked.how.ordered else set()


@dataclass
class _RateUnit:
    """One component: what brings its inputs up to date, its calls, and the step that it is in."""

    instance: Instance
    multiple: int
    early: bool
    """Whether it steps when its step begins, so that others read what it passes on for that time."""
    opening: list[Callable[[], None]]
    fresh: list[Callable[[], None]]
    sets: list[Call]
    rest: list[Call]
    begun: float = 0.0
    last: int = 0


class MultirateStepper(SampledStepper):
    """Steps units like `SampledStepper`, each by its own multiple of the communication step.

    A unit reads its inputs when its step begins, and they hold until it ends. Then it steps, so its outputs change at
    the end of its step; one that passes inputs on to others within the step steps when its step begins, and its
    outputs hold for its step. The last step of a unit may be shorter.
    """

    def __init__(self, exchange: Exchange, span: float) -> None:
        super().__init__(exchange)
        self._exchange, self._span = exchange, span
        self._k, self._stop = 0, 0.0
        early = _feeding(exchange.checked)
        self._units: list[_RateUnit] = []
        for name, (instance, fresh, calls) in zip(exchange.checked.schedule.units, self.stages, strict=True):
            at = next(i for i, call in enumerate(calls) if call[2] == "doStep")
            gathers = (bank.gather(bank.input_windows[name]) for bank in exchange.banks)
            opening = [gather for gather in gathers if gather is not None]
            multiple = exchange.checked.multiples.get(name, 1)
            self._units.append(_RateUnit(instance, multiple, name in early, opening, fresh, calls[:at], calls[at:]))

    def advance(self, time: float, step: float, stop: float) -> None:
        """Begin or end the steps that begin at `time` or end a communication step later."""
        k, n = self._k, round(self._span / step)
        self._stop = self._stop if k else time + self._span
        self._clock.value, self._size.value = time, step
        self._exchange.feed(time)
        begin = [unit for unit in self._units if k % unit.multiple == 0]
        for unit in begin:
            unit.begun, unit.last = time, min(k + unit.multiple, n) - 1
            for gather in unit.opening:
                gather()
        for unit in self._units:
            if k % unit.multiple == 0:
                for gather in unit.fresh:
                    gather()
                unit.instance.run(unit.sets)
            if k % unit.multiple == 0 if unit.early else k == unit.last:
                length = step * (unit.last + 1 - k if unit.early else k % unit.multiple + 1)
                self._clock.value = unit.begun
                self._size.value = largest_step(unit.begun, self._stop) if unit.last == n - 1 else length
                unit.instance.run(unit.rest)
        self._clock.value, self._size.value = time, step
        self._k += 1
