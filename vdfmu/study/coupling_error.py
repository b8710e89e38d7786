"""The coupling error, estimated from runs with the steps h, h/2 and h/4; the verdict, or why there is none.

``d1`` is the largest difference of the first two runs at common times, ``d2`` that of the last two, both relative to
each signal's range, and ``q = d2 / d1``. A master of order p has an error of ``e = d1 / (1 - 2**-p)`` if q is near
``2**-p``. Errors inside FMUs are the same in all runs and cannot be seen.

The bands of q and the margin of 1.5 come from random systems, see ``benchmarks/judge.py``.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np

from vdfmu.base.arrays import Floats

MARGIN = 1.5
"""Safety factor on the estimate; without it, 6 of 638 systems with an error above the limit were judged right."""
BANDS = {1: (0.35, 0.65), 2: (0.0, 0.40)}
"""Range of q in which a master shows its order, or a higher one.

The first step of `extrapolated` holds its inputs. With feedthrough this causes an error only at the first point of the
longest step, which d2 does not contain, so q falls to 0.002, and the error is d1. With a limit of 0.15, 8 % of the
right runs were not called right."""
_SMALL = 20
"""Differences below the requested error divided by this need not show the order, because they come from rounding and
solvers."""
_FLOOR = 1e-6
"""Relative error of solvers. A signal whose range is smaller relative to its value is constant; an element of a vector
whose range is smaller relative to the vector's largest is compared with the largest."""
_ROUNDING = 1e-9
"""A range below this fraction of the largest value with the same unit of measurement is rounding."""
_BEND = 1e-4
"""Smallest change of slope that is an event, as a change per step."""
_JUMP, _JUMPS = 3.0, (1e-3, 0.5)
"""A jump is a change in a step of more than this factor times the changes before and after it. Relative to the signal's
range, changes below the first limit are ignored, and changes above the second always count."""
RIGHT, WRONG, OPEN = "right", "not right", "not decided"
OTHER_STEPS = 8, 13
"""Eight steps h equal thirteen steps of the run that looks for aliases. A tone or PWM with whole periods in h, h/2 and
h/4 has whole periods in 8 h / 13 only at frequencies of 52 / h and more; with 5 h / 8 it would be 8 / h."""


class Differences(NamedTuple):
    """The differences of three runs, signal by signal."""

    d1: Floats
    """Difference of the first two, relative to the signal's range."""
    d2: Floats
    """Difference of the last two."""
    row: Any
    """Row of the largest difference of the first two."""
    jumps: Any
    """Number of jumps."""
    late: float
    """Error that all runs may share because they see an event late, by up to a step of the last run."""
    scale: Floats
    """The signal's range, or its value if it is constant; infinite if it is 0."""
    constant: Any
    """Whether it is constant."""

    def of(self, chosen: Any) -> Differences:
        """Return the differences of some signals."""
        d1, d2, row, jumps, late, scale, constant = self
        return Differences(d1[chosen], d2[chosen], row[chosen], jumps[chosen], late, scale[chosen], constant[chosen])


def differences(
    runs: Sequence[Floats],
    names: Sequence[str],
    sampled: Collection[str] = (),
    units: Sequence[str] = (),
    read: Any = None,
) -> Differences:
    """Return the differences of runs with the steps h, h/2 and h/4: arrays (rows, signals).

    `units` are units of measurement; `read` tells which signals other components read, by default all.

    Events are jumps of signals that are read, and bends of those without jumps. Events at samples of the components in
    `sampled` have declared times. Others may be between rows; then the last run sees them late by up to its step, and
    the other runs at least as late. If all are equally late, no difference shows it, although a signal may change in
    this time by as much as its largest change in a step.
    """
    first, half, quarter = at_common_times(runs)
    scale, constant = scales(runs[2], names, units)
    scale = np.where(scale > 0.0, scale, np.inf)
    read = np.ones(len(names), bool) if read is None else read
    change: Any = np.abs(np.diff(runs[2], axis=0)) / scale
    jumping = change[1:-1] > np.clip(_JUMP * np.maximum(change[:-2], change[2:]), *_JUMPS)
    bend = np.abs(np.diff(runs[2], 2, axis=0)) / scale
    bending = bend[1:-1] > np.maximum(_JUMP * np.maximum(bend[:-2], bend[2:]), _BEND)
    smooth, timed = ~jumping.any(axis=0), np.isin([name.partition(".")[0] for name in names], [*sampled])
    events: Any = jumping[:, read & ~timed].any(axis=1)
    events[:-1] |= bending[:, read & ~timed & smooth].any(axis=1)
    sample: Any = (change[:, timed] > 0.0).any(axis=1)
    count = int((events & ~(sample[:-2] | sample[1:-1] | sample[2:])).sum())
    late = count * change[1:-1, smooth].max(initial=0.0 if smooth.any() else 1.0) if count else 0.0
    far, near = np.abs(first - half), np.abs(half - quarter)
    return Differences(
        far.max(axis=0) / scale,
        near.max(axis=0) / scale,
        far.argmax(axis=0),
        jumping.sum(axis=0),
        float(late),
        scale,
        constant,
    )


def at_common_times(runs: Sequence[Floats]) -> list[Floats]:
    """Return the rows of runs with the steps h, h/2, h/4 at common times; a component may have ended a run."""
    least = min(len(run[:: 2**k]) for k, run in enumerate(runs))
    return [run[:: 2**k][:least] for k, run in enumerate(runs)]


def scales(run: Floats, names: Sequence[str], units: Sequence[str]) -> tuple[Floats, Any]:
    """Return the range of each signal, or the value of a constant signal, and whether it is constant.

    `run` is (rows, signals); the scale of a signal that is always 0 is 0.
    """
    size, swing = np.abs(run).max(axis=0), np.ptp(run, axis=0)
    vectors = np.array([name.partition("[")[0] for name in names])
    scale = np.maximum(swing, [_FLOOR * swing[vectors == vector].max() for vector in vectors])
    if len(units):
        alike = np.asarray(units)
        rounding = [_ROUNDING * size[alike == unit].max() if unit not in ("", "1") else 0.0 for unit in units]
        scale = np.maximum(scale, rounding)
    constant = swing <= _FLOOR * size
    return np.where(constant, np.maximum(size, scale), scale), constant


def error_of(d1: Any, order: int) -> Any:
    """Return the estimated error for a difference of a master of an order, 1 or 2."""
    return d1 / (1.0 - 0.5**order)


def verdict_of(seen: Differences, order: int, wanted: float) -> str:
    """Return the verdict on the largest differences of all signals."""
    largest, second, (low, high) = float(seen.d1.max()), float(seen.d2.max()), BANDS[order]
    worst, regular = error_of(largest, order), largest > 0.0 and low < second / largest < high
    small = max(largest, second) < wanted / _SMALL
    if MARGIN * max(worst, seen.late) <= wanted and (regular or small):
        return RIGHT
    return WRONG if regular and worst > MARGIN * wanted else OPEN


def verdict_on_all(seen: Differences, read: Any, order: int, wanted: float, exact: bool) -> tuple[str, Any]:
    """Return the verdict, and the signals behind it: those that components read or, if these are right, the rest.

    If `exact`, all signals are exchanged at declared samples, which are the same in all runs, so that all differences
    come from solvers. Then only signals that are read count.
    """
    if exact:
        largest = float(np.maximum(seen.d1, seen.d2)[read].max())
        return RIGHT if MARGIN * error_of(largest, order) <= wanted else OPEN, read
    verdict = verdict_of(seen.of(read), order, wanted)
    if verdict != RIGHT or read.all():
        return verdict, read
    verdict = verdict_of(seen.of(~read), order, wanted)
    return verdict, read if verdict == RIGHT else ~read


def alias(runs: Sequence[Floats], other: Floats, scale: Floats, order: int) -> Floats:
    """Return the deviation of a run with the step 8 h / 13 from the other runs' prediction, relative to `scale`.

    Errors of order p are ``C h**p``, so this run lies between those with h and h/2. Signals faster than the steps do
    not, because they alias to another frequency.
    """
    every, steps = OTHER_STEPS
    share = ((every / steps) ** order - 0.5**order) / (1.0 - 0.5**order)
    first, half, _ = (run[::every] for run in at_common_times(runs))
    there = other[::steps]
    n = min(len(first), len(there))
    return np.abs(there[:n] - half[:n] - share * (first[:n] - half[:n])).max(axis=0) / scale


class Kind(NamedTuple):
    """Reason for no verdict: the cause, with a placeholder for the signal, then the consequence and the fix."""

    met: str
    way: str


KINDS: Mapping[str, Kind] = {
    "growth": Kind(
        "{signal} grows without bound",
        "Every difference grows with it. Stabilise the loop, or judge the time before it grows (--stop)",
    ),
    "chaos": Kind(
        "runs of {signal} diverge, as in chaos",
        "Their final difference is as large as the range of the signal. Judge the time before they diverge (--stop), "
        "or compare statistics",
    ),
    "bistable": Kind(
        "{signal} ends in a different state with a different step",
        "Judge the time before the runs separate (--stop), or start farther from the boundary between the states",
    ),
    "quantised": Kind(
        "{signal} is quantised at the communication points",
        "The times of its changes depend on the step. Declare the period at which it is sampled, or judge the system "
        "without the quantiser",
    ),
    "jumps": Kind(
        "{signal} jumps at communication points",
        "A jump that is one step late is wrong by its full height, however short the step is. Declare the period at "
        "which it jumps, or replace the switch by a smooth one",
    ),
    "bends": Kind(
        "{signal} bends at an event", "An event is only passed on at the next communication point. Use a shorter step"
    ),
    "delay": Kind(
        "{signal} is delayed by a whole number of steps",
        "Halving the step does not halve the error of this delay. Choose a step that divides the delay",
    ),
    "fast": Kind(
        "{signal} changes as fast as the steps",
        "It is noise that is drawn in each step, or a signal that is faster than the steps. Declare the period at "
        "which it is drawn, or choose a step that resolves it",
    ),
    "alias": Kind(
        "{signal} contains an alias of a faster signal",
        "A run with 8/13 of the step differs from the value that the other runs predict. Choose a step that resolves "
        "the faster signal, or filter it inside its component",
    ),
    "solver": Kind(
        "solvers inside the FMUs determine the error of {signal}",
        "All signals are exchanged at declared samples, the same in all runs. Choose a smaller tolerance (--tolerance)",
    ),
    "coarse": Kind(
        "the step is too long for {signal}",
        "Halving it twice does not show the order of the algorithm. Use a shorter step",
    ),
}
"""Kinds of systems without a verdict, in addition to errors near the limit, failed runs and an undeclared period."""
_LEVELS = 0.25
"""A signal with fewer distinct values than this fraction of its rows is quantised; with up to three values it
switches."""
_APART = 0.3
"""Difference of diverged runs as a fraction of the range."""
_BLOWN = 4.0
"""Growth between successive quarters of a run, in its last three: a line grows by at most 2, then 1.5."""


def kind_of(runs: Sequence[Floats], seen: Differences, deciding: Any, sampled: Any) -> tuple[str, int]:
    """Return which of `KINDS` applies, and the index of the signal, one of the `deciding` ones.

    `sampled` are signals with declared samples, which may have few values and jump.
    """
    first, half, quarter = at_common_times(runs)
    worst = int(np.argmax(np.where(deciding, np.maximum(seen.d1, seen.d2), -1.0)))
    free = deciding & ~sampled
    part = max(1, len(quarter) // 4)
    peaks = [float(np.abs(quarter[k * part : (k + 1) * part, worst]).max(initial=0.0)) for k in range(1, 4)]
    if peaks[2] > _BLOWN * peaks[1] > _BLOWN**2 * peaks[0] > 0.0:
        return "growth", worst
    jumping = np.flatnonzero((seen.jumps > 0) & free)
    for i in np.flatnonzero(free & ~seen.constant):
        if kind := _levels(runs[2][:, i]):
            return kind, int(i)
    if _rough(runs[2][:, worst]):
        return "fast", worst
    far, near = np.abs(first - half)[:, worst], np.abs(half - quarter)[:, worst]
    scale = seen.scale[worst]
    if far.max() > _APART * scale and near.max() > _APART * scale:
        small = max(far[:part].max(), near[:part].max()) < 0.1 * max(far.max(), near.max())
        settled = np.ptp(quarter[-part:, worst]) < 0.1 * scale
        if small:
            return ("bistable" if settled else "chaos"), worst
    if len(jumping):
        return "jumps", int(jumping[np.argmax(seen.jumps[jumping])])
    if _shifted(half[:, worst], quarter[:, worst]):
        return "delay", worst
    return ("bends" if seen.late > max(seen.d1.max(), seen.d2.max()) else "coarse"), worst


def _levels(values: Floats) -> str:
    """Return the kind of a signal that has few values: up to three, or few that mostly last for some rows; else ""."""
    counts = np.unique(values, return_counts=True)[1]
    if 2 <= len(counts) <= 3:
        return "jumps"
    return "quantised" if len(counts) < _LEVELS * len(values) and (counts > 1).mean() > 0.5 else ""


def _rough(values: Floats) -> bool:
    """Return whether a signal changes direction at more than half of its rows; white noise does at two thirds."""
    slopes = np.diff(values)
    return len(slopes) > 8 and bool((slopes[1:] * slopes[:-1] < 0.0).mean() > 0.5)


def _shifted(values: Floats, later: Floats) -> bool:
    """Return whether a shift in time explains nine tenths of the squared difference between two runs of a signal."""
    slope, off = np.gradient(later), values - later
    if not slope.any() or not off.any():
        return False
    rest = off - slope * (off @ slope) / (slope @ slope)
    return bool(rest @ rest < 0.1 * (off @ off))
