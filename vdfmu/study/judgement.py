"""`judge`: the error that the communication step causes in a co-simulation, estimated from runs with shorter steps.

Three runs are made, with the steps h, h/2 and h/4, see :mod:`vdfmu.study.coupling_error`; one with 8 h / 13 looks for
aliases. No run is longer than the system's, so all runs together take at most nine times its steps.
"""

from __future__ import annotations

import math
import os
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any, NamedTuple, Unpack

import numpy as np

from vdfmu.base.arrays import Floats
from vdfmu.base.errors import CosimError, SspError, UsageError
from vdfmu.base.interrupt import Stopped
from vdfmu.base.measure import per_cent
from vdfmu.base.option import pick, with_options
from vdfmu.engine.algorithms import named
from vdfmu.engine.linear.linearise import linear_system
from vdfmu.engine.linear.system import cut
from vdfmu.engine.options import RowOptions, SimulatorOptions
from vdfmu.engine.package.read import load_ssp
from vdfmu.engine.package.system import FlatSystem
from vdfmu.engine.plan.check import Checked, check_system
from vdfmu.engine.plan.grid import Grid
from vdfmu.engine.results.results import Results
from vdfmu.engine.run import Interrupted, LostProcessError, Simulator
from vdfmu.study.coupling_error import (
    KINDS,
    MARGIN,
    OPEN,
    OTHER_STEPS,
    RIGHT,
    WRONG,
    Differences,
    alias,
    differences,
    error_of,
    kind_of,
    verdict_on_all,
)
from vdfmu.study.options import JudgingOptions
from vdfmu.study.sampling import (
    ambiguous,
    declared_samples,
    exchanged_at_samples,
    judged_signals,
    keeping_steps,
    timed_samples,
)

_LINEARISED = ("growth", "coarse")
"""Kinds without a verdict that are explained by the loop's spectral radius."""


class SignalError(NamedTuple):
    """A signal: error relative to its range, d2 / d1, time [s] of its largest difference, and whether it is read."""

    name: str
    error: float
    q: float
    time: float
    read: bool = True


@dataclass(frozen=True)
class Judgement:
    """Whether the communication step of a co-simulation is short enough.

    Attributes
    ----------
    verdict : "right", "not right" or "not decided"
    text : str
        The verdict in a sentence.
    wanted, error : float
        Largest allowed error, and the estimated one, relative to each signal's range, its largest minus its smallest
        value, or to the value of a constant signal; NaN without an estimate.
    signal : str
        The signal with the largest error.
    step : float [s]
    algorithm : str
    signals : tuple of SignalError
        All real outputs, the largest error first; `read` says whether another component reads it.
    order : int
        Order of the algorithm's coupling error in the step; 0 if unknown.
    kind : str
        Why a verdict is impossible: "near" the allowed error, undeclared "period" of a component, "failed" run, "still"
        signals, algorithm without "order", or one of "growth", "chaos", "bistable", "quantised", "jumps", "bends",
        "delay", "fast", "alias", "solver" errors or a step that is too "coarse".
    """

    verdict: str
    text: str
    wanted: float
    error: float = math.nan
    signal: str = ""
    step: float = math.nan
    algorithm: str = ""
    signals: tuple[SignalError, ...] = ()
    order: int = 0
    kind: str = ""

    @property
    def right(self) -> bool | None:
        """Whether the system is right; None if undecided."""
        return None if self.verdict == OPEN else self.verdict == RIGHT

    def __str__(self) -> str:
        return self.text

    def to_dict(self) -> dict[str, Any]:
        """Return the judgement for JSON."""
        return asdict(self) | {"signals": [each._asdict() for each in self.signals]}


def check_wanted(wanted: float | None, sampled: bool | None, adaptive: float | None = None) -> None:
    """Raise UsageError for inconsistent options of :func:`judge`; `wanted` is None without a judgement."""
    if wanted is None:
        if sampled is not None:
            raise UsageError("sampled and continuous need judge. Add --judge with the largest error in %.")
        return
    if not 0.0 < wanted < 1.0:
        raise UsageError(
            f"the wanted error must be between 0 and 100 % of the range, got {100.0 * wanted:g} %. "
            "Use wanted=0.01, or --judge 1 on the command line, for 1 %."
        )
    if adaptive is not None:
        raise UsageError("judge compares fixed steps, got adaptive. Omit it.")


@with_options
def judge(
    system: str | os.PathLike[str] | FlatSystem, wanted: float = 0.01, **options: Unpack[JudgingOptions]
) -> Judgement:
    """Judge whether the communication step of a co-simulation is short enough.

    It takes at most nine times the steps of one run, or seventeen if two readings are needed.

    Parameters
    ----------
    system : path or FlatSystem
        A package (SSP).
    wanted : float
        Largest allowed error, as a fraction of each real output's range.
    **options
        :class:`vdfmu.study.options.JudgingOptions`. `sampled` tells how components are read that may sample but declare
        no period: those with discrete outputs, or with held inputs and no states. Sampled components keep `step` as
        their period while the communication step is halved. By default the FMU declares this, see ``sampled`` of
        :class:`vdfmu.unit.Unit`. If it does not, both readings are judged, and if their verdicts agree, that is the
        verdict.

    Returns
    -------
    Judgement

    Raises
    ------
    UsageError, SspError
        See :func:`vdfmu.engine.run.simulate`; UsageError for systems without connected signals.
    """
    sampled, how = options["sampled"], pick(SimulatorOptions, options)
    check_wanted(wanted, sampled, how["adaptive"])
    flat = system if isinstance(system, FlatSystem) else load_ssp(Path(system))
    return judge_connected(check_connected(flat, how), wanted, sampled, pick(RowOptions, options), how)


def judge_connected(
    checked: Checked, wanted: float, sampled: bool | None, rows: RowOptions, how: SimulatorOptions
) -> Judgement:
    """Return the judgement of a system of :func:`check_connected`; for arguments and errors see :func:`judge`."""
    flat = replace(checked.system, experiment=checked.system.experiment._replace(adaptive=None))
    grid = Simulator(flat, **how).grid(rows["start"], rows["stop"], rows["step"])
    try:
        return _judged(_Case(checked, wanted, grid, how), flat, sampled)
    except Interrupted as error:  # its time and rows belong to a run that the caller does not know of
        raise Stopped(error.number) from None


def check_connected(flat: FlatSystem, options: Mapping[str, Any]) -> Checked:
    """Return a checked system for options of :func:`judge`; UsageError if it has no connected signals."""
    checked = check_system(
        flat,
        options["parameters"],
        algorithm=options["algorithm"] or flat.experiment.algorithm,
        ignore_unmatched=options["ignore_unmatched"],
    )
    if not judged_signals(checked)[1]:
        raise UsageError(
            "judge needs connected signals, got none: it estimates the error of the exchange between components. "
            "Connect some, or omit judge."
        )
    return checked


def _judged(case: _Case, flat: FlatSystem, sampled: bool | None) -> Judgement:
    """Return the judgement of a system with the reading `sampled`, or with both if its FMUs do not declare it."""
    checked, grid = case.checked, case.grid
    unclear = ambiguous(checked)
    declared = [name for name in unclear if checked.descriptions[name].samples]
    undeclared = [name for name in unclear if checked.descriptions[name].samples is None]
    if sampled is False:
        return case.judged(keeping_steps(flat, declared, grid.step))
    if sampled or not undeclared:
        return case.judged(keeping_steps(flat, unclear if sampled else declared, grid.step))
    return _of_two(undeclared, *(case.judged(keeping_steps(flat, names, grid.step)) for names in (unclear, declared)))


def _of_two(undeclared: Sequence[str], held: Judgement, continuous: Judgement) -> Judgement:
    """Return the judgement from two readings of the components without a declared period."""
    names, period = ", ".join(undeclared), _time(held.step)
    worse, other = sorted((held, continuous), key=lambda each: -math.inf if math.isnan(each.error) else -each.error)
    if held.verdict == continuous.verdict != OPEN:
        both = (
            f"The verdict is the same with {names} sampled every {period} or continuous; the other error is "
            f"{per_cent(other.error)}."
        )
        return replace(worse, text=f"{worse.text} {both}")
    text = (
        f"Not decided: no period is declared for {names}. Sampled every {period}: {held.text} Continuous: "
        f"{continuous.text} Choose --sampled or --continuous."
    )
    return replace(continuous, verdict=OPEN, text=text, kind="period")


class _Case(NamedTuple):
    """The system that is judged."""

    checked: Checked
    wanted: float
    grid: Grid
    options: Mapping[str, Any]

    @property
    def step(self) -> float:
        """Communication step [s]."""
        return self.grid.step

    def judged(self, flat: FlatSystem) -> Judgement:
        """Judge a system from three runs, and from a fourth if they show no error."""
        (names, n_read), order = judged_signals(self.checked), self.checked.how.order
        if not order:
            why = f"the algorithm {self.checked.algorithm} declares no order. Declare declared_order in its Algorithm."
            return self._open("order", why)
        runs: list[Floats] = []
        options: dict[str, Any] = {**self.options, "algorithm": self.checked.algorithm}
        with Simulator(flat, **options) as simulator:
            for divisor in (1, 2, 4):
                step = self.step / divisor
                try:
                    results = self._run(simulator, names, step, self.grid.end)
                except (CosimError, UsageError) as error:
                    if isinstance(error, LostProcessError) or (divisor == 1 and isinstance(error, UsageError)):
                        raise
                    why = f"the run with a step of {_time(step)} failed: {error}{self._cause(flat, None)}"
                    return self._open("failed", why)
                runs.append(_columns(results, names))
            read = np.arange(len(names)) < n_read
            if not np.ptp(runs[2][:, read], axis=0).any():
                return self._open("still", "no connected signal changes. Set inputs or values that change it.")
            timed, units = timed_samples(self.checked, flat), [results.units.get(name, "") for name in names]
            seen, exact = differences(runs, names, timed, units, read), exchanged_at_samples(self.checked, flat)
            seen = seen._replace(late=0.0) if exact else seen
            verdict, deciding = verdict_on_all(seen, read, order, self.wanted, exact)
            other = None if exact or verdict != RIGHT else self._aliases(simulator, names, runs, seen, order)
        error = error_of(seen.d1, order)
        q, times = seen.d2 / np.where(seen.d1 > 0.0, seen.d1, np.inf), results.time[::4][seen.row]
        signals = [*map(SignalError, names, error.tolist(), q.tolist(), times.tolist(), read.tolist())]
        worst = at = int(np.argmax(np.where(deciding, error, -1.0)))
        kind = ""
        if isinstance(other, np.ndarray) and MARGIN * other.max() > self.wanted:
            verdict, kind, at = OPEN, "alias", int(other.argmax())
        elif verdict == OPEN and MARGIN * error[worst] > self.wanted >= error[worst] / MARGIN:
            kind = "near"
        elif verdict == OPEN and exact:
            kind = "solver"
        elif verdict == OPEN:
            timed = np.isin([name.partition(".")[0] for name in names], [*declared_samples(self.checked, flat)])
            kind, at = kind_of(runs, seen, deciding, timed)
        text = self._text(flat, verdict, kind, signals[worst], signals[at], bool(seen.constant[worst]), seen.late)
        unread = max((each for each in signals if not each.read), key=lambda each: each.error, default=signals[worst])
        if signals[worst].read and unread.error > signals[worst].error:
            solver = ", the error of solvers inside FMUs" if exact else ""
            text += f" Unread output {unread.name}: {per_cent(unread.error)}{solver}."
        periods = ", ".join(f"{each.name} {_time(each.step)}" for each in flat.components if each.step is not None)
        text += f" Kept periods: {periods}." if periods else ""
        text += f" Aliasing is not tested: {other}." if isinstance(other, str) else ""
        return Judgement(
            verdict,
            text,
            **self._facts,
            error=signals[worst].error,
            signal=signals[at].name,
            kind=kind,
            signals=tuple(sorted(signals, key=lambda each: -each.error)),
        )

    def _text(
        self,
        flat: FlatSystem,
        verdict: str,
        kind: str,
        worst: SignalError,
        met: SignalError,
        constant: bool,
        late: float,
    ) -> str:
        """Return the verdict in a sentence, on the `worst` signal, or on the signal `met` that prevents a verdict."""
        share = per_cent(max(worst.error, late) if verdict == RIGHT else worst.error)
        about = f"{share} of the {'value' if constant else 'range'} of {worst.name}"
        if verdict == RIGHT:
            return f"Right to {about} ({self._asked}). Errors inside FMUs are not judged."
        if verdict == WRONG:
            unread = "" if worst.read else ", an output that no component reads"
            return f"Not right: about {about}{unread} ({self._asked}). {self._way(worst)}"
        if kind == "near":
            return f"Not decided: about {about} is too near the allowed error ({self._asked}). {self._way(worst)}"
        cause = self._cause(flat, met.time) if kind in _LINEARISED else ""
        return f"Not decided: {KINDS[kind].met.format(signal=met.name)} ({self._asked}). {KINDS[kind].way}.{cause}"

    @property
    def _facts(self) -> dict[str, Any]:
        how = {"algorithm": self.checked.algorithm, "order": self.checked.how.order}
        return {"wanted": self.wanted, "step": self.step, **how}

    def _open(self, kind: str, why: str) -> Judgement:
        return Judgement(OPEN, f"Not decided: {why}", **self._facts, kind=kind)

    @property
    def _asked(self) -> str:
        return f"step {_time(self.step)}; allowed {per_cent(self.wanted)}"

    def _way(self, worst: SignalError) -> str:
        """Return how to make the error of a signal small enough."""
        order = self.checked.how.order
        share = self.wanted / (MARGIN * worst.error) if worst.error else 1.0
        way = f"a step of {_time(_rounded(self.step * share ** (1.0 / order)))}"
        way = f"{named(repeats=True)[0]}, or {way}," if order == 1 and self._repeats() else way
        return f"{way[:1].upper()}{way[1:]} should suffice."

    def _run(self, simulator: Simulator, names: Sequence[str], step: float, stop: float) -> Results:
        return simulator.run(start=self.grid.begin, stop=stop, step=step, record=names)

    def _aliases(
        self, simulator: Simulator, names: Sequence[str], runs: Sequence[Floats], seen: Differences, order: int
    ) -> Floats | str:
        """Return the error that a run with 8 h / 13 reveals, relative to the ranges, or why no such run is possible."""
        every, steps = OTHER_STEPS
        whole = self.grid.n // every * every
        if not whole:
            return f"the run has fewer than {every} steps"
        try:
            stop = self.grid.end if whole == self.grid.n else self.grid.time(whole)
            results = self._run(simulator, names, self.step * every / steps, stop)
        except LostProcessError:
            raise
        except (CosimError, UsageError):
            return f"no step of {_time(self.step * every / steps)} is possible"
        return alias(runs, _columns(results, names), seen.scale, order)

    def _repeats(self) -> bool:
        """Return whether an algorithm that repeats steps can run the system."""
        try:
            check_system(self.checked.system, self.options.get("parameters"), algorithm=named(repeats=True)[0])
        except SspError:
            return False
        return True

    def _cause(self, flat: FlatSystem, at: float | None) -> str:
        """Return a sentence on the loop's spectral radius, if FMUs have derivatives and it grows or decays slowly."""
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
        return f" The loop at {', '.join(opened)} {grows}: its spectral radius is {poles.max():.4g} a step."


def _columns(results: Results, names: Sequence[str]) -> Floats:
    return np.column_stack([results[name] for name in names]).astype(float)


def _time(seconds: float) -> str:
    return f"{1e3 * seconds:.4g} ms" if seconds < 1.0 else f"{seconds:.4g} s"


def _rounded(step: float) -> float:
    """Return the next shorter step of 1, 2 or 5 times a power of ten; 0 for a step of 0."""
    if not 0.0 < step < math.inf:
        return 0.0
    power = 10.0 ** math.floor(math.log10(step) + 1e-9)
    return max(each * power for each in (1.0, 2.0, 5.0) if each * power <= step * (1.0 + 1e-9))
