"""`judge`: is a co-simulation right? The error by communication, estimated from runs with shorter steps.

Three runs are made, with the steps h, h/2 and h/4. ``d1`` is the largest difference of the first two at common times,
``d2`` of the last two, both as shares of each signal's largest value, and ``q = d2 / d1``. A master of order p has an
error of ``e = d1 / (1 - 2**-p)``, if q is near ``2**-p``. Errors inside FMUs are the same in all runs and stay unseen.

The bands of q and the margin of 1.5 come from 330 random linear systems, see ``benchmarks/referee.py``.
"""

from __future__ import annotations

import math
import os
from collections.abc import Collection, Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from vdfmu.base.arrays import Floats
from vdfmu.base.errors import CosimError, SspError, UsageError
from vdfmu.engine.algorithms import ALGORITHMS, named
from vdfmu.engine.fmu.access import TEXTS
from vdfmu.engine.linear.linearise import linear_system
from vdfmu.engine.linear.system import cut
from vdfmu.engine.package.read import load_ssp
from vdfmu.engine.package.system import FlatSystem
from vdfmu.engine.plan.check import Checked, check_system
from vdfmu.engine.plan.grid import Grid
from vdfmu.engine.run import LostProcessError, Simulator

MARGIN = 1.5
"""Factor on the estimate: without it, 6 of 638 systems with an error beyond the wanted one were called right."""
BANDS = {1: (0.35, 0.65), 2: (0.0, 0.40)}
"""Values of q at which a master of an order shows its order, or a higher one.

The first step of `extrapolated` holds its inputs. With feedthrough this error is at the first point of the longest step
only, so d2 does not have it: q falls to 0.002, and the error is d1. With 0.15 as limit 8 % of the right runs were not
called right."""
_SMALL = 20
"""Differences below the wanted error divided by this need no order: rounding and solvers decide them."""
_FLOOR = 1e-6
"""Smallest scale of an element, as a share of the largest of its vector: below, rounding of solvers decides."""
_BEND = 1e-4
"""Smallest change of slope that is an event, as a change in a step."""
_JUMP, _JUMPS = 3.0, (1e-3, 0.5)
"""A jump is a change in a step of more than this times the changes before and after it. As a share of the signal's
largest value, a change below the first limit is none, and a change above the second is always one."""
RIGHT, WRONG, OPEN = "right", "not right", "not decided"


class SignalError(NamedTuple):
    """A signal: error as a share of its largest value, d2 / d1, and time [s] of its largest difference."""

    name: str
    error: float
    q: float
    time: float


@dataclass(frozen=True)
class Judgement:
    """Whether a co-simulation is right by communication.

    Attributes
    ----------
    verdict : "right", "not right" or "not decided"
    text : str
        The verdict in a sentence.
    wanted, error : float
        Wanted and estimated error, as shares of each signal's largest value; NaN without an estimate.
    signal : str
        The signal with the largest error.
    step : float [s]
    algorithm : str
    signals : tuple of SignalError
        Connected signals, and outputs of components at the end of a chain, the largest error first.
    """

    verdict: str
    text: str
    wanted: float
    error: float = math.nan
    signal: str = ""
    step: float = math.nan
    algorithm: str = ""
    signals: tuple[SignalError, ...] = ()

    @property
    def right(self) -> bool | None:
        """Whether the system is right; None if this is not decided."""
        return None if self.verdict == OPEN else self.verdict == RIGHT

    def __str__(self) -> str:
        return self.text

    def to_dict(self) -> dict[str, Any]:
        """Return the judgement for JSON."""
        return asdict(self) | {"signals": [each._asdict() for each in self.signals]}


class Differences(NamedTuple):
    """The differences of three runs, signal by signal."""

    d1: Floats
    """Of the first two, as a share of the signal's largest value."""
    d2: Floats
    """Of the last two."""
    row: Any
    """Row of the largest difference of the first two."""
    jumps: Any
    """Number of jumps."""
    late: float
    """Share that runs may miss in common, since all see an event late: by up to a step of the last run."""


def differences(runs: Sequence[Floats], names: Sequence[str], sampled: Collection[str] = ()) -> Differences:
    """Return the differences of runs with the steps h, h/2 and h/4: arrays (rows, signals).

    Events are jumps, and bends of signals without jumps. Those at samples of the components in `sampled` have declared
    times. Other events may be between rows. Then the last run is late by up to its step, and the others by no less. If
    they are as late, no difference shows it. In this time a signal changes by its largest change in a step at most.
    """
    least = min(len(run[:: 2**k]) for k, run in enumerate(runs))  # a component may end the run
    first, half, quarter = (run[:: 2**k][:least] for k, run in enumerate(runs))
    size, groups = np.abs(quarter).max(axis=0), np.array([name.partition("[")[0] for name in names])
    scale = np.maximum(size, [_FLOOR * size[groups == group].max() for group in groups])
    scale = np.where(scale > 0.0, scale, np.inf)
    change: Any = np.abs(np.diff(runs[2], axis=0)) / scale
    jumping = change[1:-1] > np.clip(_JUMP * np.maximum(change[:-2], change[2:]), *_JUMPS)
    bend = np.abs(np.diff(runs[2], 2, axis=0)) / scale
    bending = bend[1:-1] > np.maximum(_JUMP * np.maximum(bend[:-2], bend[2:]), _BEND)
    smooth, timed = ~jumping.any(axis=0), np.isin([name.partition(".")[0] for name in names], [*sampled])
    events: Any = jumping[:, ~timed].any(axis=1)
    events[:-1] |= bending[:, ~timed & smooth].any(axis=1)
    sample: Any = (change[:, timed] > 0.0).any(axis=1)
    count = int((events & ~(sample[:-2] | sample[1:-1] | sample[2:])).sum())
    late = count * change[1:-1, smooth].max(initial=0.0 if smooth.any() else 1.0) if count else 0.0
    far, near = np.abs(first - half), np.abs(half - quarter)
    return Differences(
        far.max(axis=0) / scale, near.max(axis=0) / scale, far.argmax(axis=0), jumping.sum(axis=0), float(late)
    )


def error_of(d1: Any, order: int) -> Any:
    """Return the estimated error for a difference of a master of an order, 1 or 2."""
    return d1 / (1.0 - 0.5**order)


def verdict_of(seen: Differences, order: int, wanted: float) -> str:
    """Return the verdict by the largest differences of all signals."""
    largest, second, (low, high) = float(seen.d1.max()), float(seen.d2.max()), BANDS[order]
    worst, regular = error_of(largest, order), largest > 0.0 and low < second / largest < high
    small = max(largest, second) < wanted / _SMALL
    if MARGIN * max(worst, seen.late) <= wanted and (regular or small):
        return RIGHT
    return WRONG if regular and worst > MARGIN * wanted else OPEN


def check_wanted(wanted: float | None, meant: str | None, adaptive: float | None = None) -> None:
    """Raise UsageError for options of :func:`judge` that do not fit together; `wanted` is None without a judgement."""
    if wanted is None:
        if meant is not None:
            raise UsageError("meant needs judge. Give --judge with the largest error in %.")
        return
    if not 0.0 < wanted < 1.0:
        raise UsageError(f"wanted must be an error between 0 and 1, got {wanted:g}. Give 0.01 for 1 %.")
    if meant not in (None, "sampled", "continuous"):
        raise UsageError(f"meant must be sampled or continuous, got {meant!r}.")
    if adaptive is not None:
        raise UsageError("judge compares fixed steps, got adaptive. Leave it out.")


def judge(
    system: str | os.PathLike[str] | FlatSystem, wanted: float = 0.01, *, start: float | None = None,
    stop: float | None = None, step: float | None = None, meant: str | None = None, **options: Any,
) -> Judgement:  # fmt: skip
    """Judge whether a co-simulation is right by communication. It takes seven times the steps of one run.

    Parameters
    ----------
    system : path or FlatSystem
        A package (SSP).
    wanted : float
        Largest error, as a share of each connected signal's largest value.
    start, stop, step : float, optional [s]
        Default the system's.
    meant : "sampled" or "continuous", optional
        Meaning of components that may sample and declare no period: with discrete outputs, or with held inputs and no
        states. Sampled components keep `step` as their period while the communication step is halved.
    **options
        :class:`vdfmu.engine.options.SimulatorOptions`.

    Returns
    -------
    Judgement

    Raises
    ------
    UsageError, SspError
        See :func:`vdfmu.simulate`; UsageError for systems without connected signals.
    """
    check_wanted(wanted, meant, options.get("adaptive"))
    flat = system if isinstance(system, FlatSystem) else load_ssp(Path(system))
    if flat.experiment.adaptive is not None:
        flat = replace(flat, experiment=replace(flat.experiment, adaptive=None))
    algorithm = options.get("algorithm") or flat.experiment.algorithm
    checked = check_system(flat, options.get("parameters"), algorithm=algorithm)
    grid = Simulator(flat, **options).grid(start, stop, step)
    case = _Case(checked, wanted, grid, options)
    undeclared = _undeclared(checked)
    if not undeclared or meant == "continuous":
        return case.judged(flat)
    if meant == "sampled":
        return case.judged(_sampled(flat, undeclared, grid.step))
    readings = [case.judged(each) for each in (_sampled(flat, undeclared, grid.step), flat)]
    worse = WRONG if all(each.verdict == WRONG for each in readings) else OPEN
    text = (
        f"{worse.capitalize()}: no period is declared for {', '.join(undeclared)}. If it is {_time(grid.step)}: "
        f"{readings[0].text} If continuous: {readings[1].text} Choose --meant sampled or --meant continuous."
    )
    return replace(readings[1], verdict=worse, text=text)


def _declared(checked: Checked, system: FlatSystem) -> set[str]:
    """Return the components whose samples have declared times: by a step, a period, or a clock."""
    stepped = {component.name for component in system.components if component.step is not None}
    described = checked.descriptions.items()
    return stepped | {name for name, each in described if each.period or any(v.clock for v in each.variables.values())}


def _timed(checked: Checked, system: FlatSystem) -> set[str]:
    """Return the components whose samples act at declared times: with a step, or passed on within the step."""
    stepped = {component.name for component in system.components if component.step is not None}
    late = {link.start[0] for link in checked.links if link.stepped and link.end not in checked.schedule.fresh}
    return stepped | _declared(checked, system) - late


def _undeclared(checked: Checked) -> list[str]:
    """Return the components that may sample: with discrete outputs, or with held inputs and without states.

    Components for model exchange have no steps that could be samples.
    """
    declared, names = _declared(checked, checked.system), dict[str, None]()
    fed = {link.end[0] for link in checked.links if link.stepped and checked.how.substeps}
    for link in checked.links:
        name, each = link.start[0], checked.descriptions.get(link.start[0])
        if each is not None and name not in declared and link.stepped and link.source.type == "Real":
            law = name in fed and not each.states and not each.exchange
            names |= {name: None} if law or link.source.variability == "discrete" else {}
    return list(names)


def _sampled(system: FlatSystem, names: Sequence[str], step: float) -> FlatSystem:
    """Return a system some of whose components keep a step."""
    parts = tuple(replace(each, step=step) if each.name in names else each for each in system.components)
    return replace(system, components=parts, inspected={})


class _Case(NamedTuple):
    """What is judged."""

    checked: Checked
    wanted: float
    grid: Grid
    options: Mapping[str, Any]

    @property
    def step(self) -> float:
        """Communication step [s]."""
        return self.grid.step

    @property
    def names(self) -> list[str]:
        """The connected signals, and the real outputs of fed components that feed none."""
        links = [link for link in self.checked.links if link.stepped and link.start[0] in self.checked.descriptions]
        names = [".".join(link.start) for link in links if link.source.type not in TEXTS]
        feeding = {link.start[0] for link in links}
        for name in dict.fromkeys(link.end[0] for link in links if link.end[0] not in feeding):
            outputs = self.checked.descriptions[name].named("output")
            names += [f"{name}.{v.name}" for v in outputs if v.type == "Real"]
        return list(dict.fromkeys(names))

    def judged(self, flat: FlatSystem) -> Judgement:
        """Judge a system by three runs."""
        names, algorithm = self.names, self.checked.algorithm
        order = ALGORITHMS[algorithm].order
        facts: dict[str, Any] = {"wanted": self.wanted, "step": self.step, "algorithm": algorithm}
        if not names:
            raise UsageError(
                "judge needs connected signals, got none: only exchange between components has this error."
            )  # fmt: skip
        if not order:
            why = f"the algorithm {algorithm} declares no order. Declare substeps or continuous in its row."
            return Judgement(OPEN, f"Not decided: {why}", **facts)
        options: dict[str, Any] = {**self.options, "algorithm": algorithm}
        runs: list[Floats] = []
        with Simulator(flat, **options) as simulator:
            for divisor in (1, 2, 4):
                step = self.step / divisor
                try:
                    results = simulator.run(start=self.grid.begin, stop=self.grid.end, step=step, record=names)
                except (CosimError, UsageError) as error:
                    if isinstance(error, LostProcessError) or (divisor == 1 and isinstance(error, UsageError)):
                        raise
                    at = f"the run with a step of {_time(step)} failed: {error}"
                    return Judgement(OPEN, f"Not decided: {at}{self._cause(flat, None)}", **facts)
                runs.append(np.column_stack([results[name] for name in names]).astype(float))
        seen = differences(runs, names, _timed(self.checked, flat))
        if not np.ptp(runs[2], axis=0).any():
            return Judgement(
                OPEN, "Not decided: no connected signal changes. Set inputs or values that move it.", **facts
            )
        verdict, error = verdict_of(seen, order, self.wanted), error_of(seen.d1, order)
        q, times = seen.d2 / np.where(seen.d1 > 0.0, seen.d1, np.inf), results.time[::4][seen.row]
        signals = map(SignalError, names, error.tolist(), q.tolist(), times.tolist())
        table = sorted(zip(signals, seen.jumps, strict=True), key=lambda each: -each[0].error)
        worst = table[0][0]
        facts |= {"error": worst.error, "signal": worst.name, "signals": tuple(signal for signal, _ in table)}
        return Judgement(verdict, self._text(verdict, table, order, flat, seen.late), **facts)

    def _text(
        self, verdict: str, table: Sequence[tuple[SignalError, int]], order: int, flat: FlatSystem, late: float
    ) -> str:
        worst = table[0][0]
        error = _share(max(worst.error, late) if verdict == RIGHT else worst.error)
        periods = ", ".join(f"{each.name} {_time(each.step)}" for each in flat.components if each.step is not None)
        kept = f" Kept periods: {periods}." if periods else ""
        at = f"step {_time(self.step)}; wanted {_share(self.wanted)}"
        if verdict == RIGHT:
            return f"Right to {error} by communication ({worst.name}, {at}). Errors inside FMUs are not judged.{kept}"
        share = self.wanted / (MARGIN * worst.error) if worst.error else 1.0
        way = f"a step of {_time(_rounded(self.step * share ** (1.0 / order)))}"
        if verdict == WRONG:
            way = f"{named(repeats=True)[0]}, or {way}," if order == 1 and self._repeats() else way
            return f"Not right: about {error} at {worst.name} ({at}). {way[:1].upper()}{way[1:]} should do.{kept}"
        if MARGIN * worst.error > self.wanted >= worst.error / MARGIN:
            near = f"is too near the wanted {_share(self.wanted)}; {way} should do"
            why = f"the error of about {error} at {worst.name} {near}"
        elif late > worst.error or any(jumps for _, jumps in table):
            jumping = next((f"{signal.name} jumps" for signal, jumps in table if jumps), "an event bends signals")
            smooth = max([late, *(signal.error for signal, jumps in table if not jumps)])
            other = f"Signals without jumps may have an error of {_share(smooth)}"
            why = f"{jumping}, and a run may pass an event on at its next step only. {other}"
        else:
            change = _share(worst.error * (1.0 - 0.5**order))
            why = (
                f"halving the step changes {worst.name} by {change} of its largest value at {worst.time:.4g} s, and "
                f"halving it again by {worst.q:.2g} times as much; an order of {order} would give {0.5**order:g} times"
            )
        return f"Not decided: {why}.{self._cause(flat, worst.time)}{kept}"

    def _repeats(self) -> bool:
        """Whether an algorithm that repeats steps can run the system."""
        try:
            check_system(self.checked.system, self.options.get("parameters"), algorithm=named(repeats=True)[0])
        except SspError:
            return False
        return True

    def _cause(self, flat: FlatSystem, at: float | None) -> str:
        """Return the radius of the coupled loop, if the FMUs have derivatives and the loop grows or decays slowly."""
        options: dict[str, Any] = {**self.options, "algorithm": self.checked.algorithm, "log": None}
        try:
            at = None if at is None else round(at / self.step) * self.step
            linear = linear_system(flat, at, step=self.step, **options)
            poles = np.abs(np.linalg.eigvals(linear.sampled().A))
            opened = cut(linear)
        except (CosimError, UsageError, np.linalg.LinAlgError):
            return ""
        if not opened or not len(poles):
            return ""
        grows = "grows" if poles.max() > 1.0 else "decays"
        return f" The loop at {', '.join(opened)} {grows}: its radius is {poles.max():.4g} a step."


def _share(value: float) -> str:
    return f"{100.0 * value:.2g} %" if math.isfinite(value) else "infinite"


def _time(seconds: float) -> str:
    return f"{1e3 * seconds:.4g} ms" if seconds < 1.0 else f"{seconds:.4g} s"


def _rounded(step: float) -> float:
    """Return the next shorter step of 1, 2 or 5 times a power of ten; 0 for steps of no size."""
    if not 0.0 < step < math.inf:
        return 0.0
    power = 10.0 ** math.floor(math.log10(step) + 1e-9)
    return max(each * power for each in (1.0, 2.0, 5.0) if each * power <= step * (1.0 + 1e-9))
