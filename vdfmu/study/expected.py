"""Recorded results that a run must match, ``--expect reference.csv --within 1e-6``, and the check against them."""

from __future__ import annotations

import math
import os
from collections import defaultdict
from collections.abc import Mapping
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from vdfmu.base.arrays import Floats
from vdfmu.base.errors import UsageError
from vdfmu.base.measure import number
from vdfmu.base.text import amount
from vdfmu.engine.results.recorded import Recorded
from vdfmu.engine.results.results import Results
from vdfmu.engine.results.verdict import FAILED, GOOD, Check
from vdfmu.study.coupling_error import scales

WITHIN = 1e-6
"""Default of the allowed difference, as a fraction of a signal's range."""
_CLOSE = 1e-9
"""Difference of times, relative to the longest, up to which they are equal."""
_LISTED = 10
"""Most differences in the summary."""


class Expected(NamedTuple):
    """Recorded results from a file, and the allowed difference from them as a fraction of each signal's range."""

    path: Path
    within: float
    results: Recorded

    def compare(self, run: Recorded) -> dict[str, Any]:
        """Return the entry ``expected`` of a run's summary: problems, and the largest differences.

        Its ``until_s`` is the end of recorded results that are shorter than the run; the rest of the run is not
        compared.

        The run's values are taken at the times of the recorded rows: reals are interpolated between rows, other kinds
        are held. Of several recorded rows at the same time, such as before and after an event, the last counts.
        """
        pairs, problems = self._pairs(run)
        recorded, file, t = self.results, self.path.name, self.results.time
        close = _CLOSE * float(np.abs(t).max())
        begin, end = float(run.time[0]), float(run.time[-1])
        if t[-1] > end + close:
            problems.append(f"the run ends at t = {end:.6g} s, {file} at t = {t[-1]:.6g} s")
        if t[0] < begin - close:
            problems.append(f"the run begins at t = {begin:.6g} s, {file} at t = {t[0]:.6g} s")
        rows = np.flatnonzero((t >= begin - close) & (t <= end + close) & np.append(np.diff(t) > 0.0, True))
        differences: list[dict[str, Any]] = []
        if pairs and rows.size:
            table = np.column_stack([recorded[name].astype(float) for name in pairs])
            units = [run.units[name] for name in pairs.values()]
            for i, (size, constant) in enumerate(zip(*scales(table, list(pairs.values()), units), strict=True)):
                name = [*pairs.values()][i]
                differences.append(_largest(name, run, t[rows], table[rows, i], float(size), close, bool(constant)))
        differences.sort(key=lambda each: -each["share"])
        beyond = sum(each["share"] > self.within for each in differences)
        shorter = {"until_s": float(t[-1])} if t[-1] < end - close else {}
        return {
            "file": str(self.path),
            "within": self.within,
            "signals": len(pairs),
            "problems": problems,
            "beyond": beyond,
            "differences": differences[: max(1, min(beyond, _LISTED))],
        } | shorter

    def _pairs(self, run: Recorded) -> tuple[dict[str, str], list[str]]:
        """Return recorded names and the corresponding names in the run, and the problems of names and units.

        A name without a component refers to the only component that has it.
        """
        pairs: dict[str, str] = {}
        problems: list[str] = []
        lacking: list[str] = []
        names, inner = set(run.names), defaultdict[str, list[str]](list)
        for name in run.names:
            inner[name.partition(".")[2]].append(name)
        for name in self.results.names:
            fitting = [name] if name in names else inner.get(name, [])
            units = [self.results.units[name], *(run.units[each] for each in fitting[:1])]
            if not fitting:
                lacking.append(name)
            elif len(fitting) > 1:
                problems.append(f"{name} may be {' or '.join(fitting)}: {self.path.name} must name the component")
            elif len(set(units)) > 1 and not {"", "1"} & set(units):
                problems.append(f"{fitting[0]} is in {units[1]}, in {self.path.name} in {units[0]}")
            else:
                pairs[name] = fitting[0]
        if lacking:
            some = f"{lacking[0]} and {len(lacking) - 1} more of" if len(lacking) > 1 else f"{lacking[0]} of"
            verb = "are" if len(lacking) > 1 else "is"
            problems.insert(0, f"{some} {self.path.name} {verb} not in the run; --record '*' records inputs too")
        return pairs, problems


def read_expected(path: str | os.PathLike[str] | None, within: float | None) -> Expected | None:
    """Return the recorded results that a run must match; None without a path.

    UsageError for a file that cannot be read or has no numbers to compare, and for inconsistent values.
    """
    if within is not None and not 0.0 <= within < math.inf:
        raise UsageError(f"within: must be 0 or a positive fraction of a signal's range, got {within:g}.")
    if path is None:
        if within is not None:
            raise UsageError("within: needs expect, the file of the recorded results. Give both.")
        return None
    results = Results.read(Path(path))
    if not results.names or not len(results):
        raise UsageError(f"{path}: must have a signal and a row to compare a run with, got none.")
    if (np.diff(results.time) < 0.0).any():
        raise UsageError(f"{path}: must have rows in the order of their times.")
    columns = {"time": results.time} | {name: results[name] for name in results.names}
    if wrong := [name for name, column in columns.items() if not np.isfinite(column).all()]:
        raise UsageError(f"{path}: {wrong[0]} must be finite numbers to compare a run with.")
    return Expected(Path(path), WITHIN if within is None else within, results)


def _largest(
    name: str, run: Recorded, t: Floats, expected: Floats, size: float, close: float, constant: bool
) -> dict[str, Any]:
    """Return the largest difference of a signal from its `expected` values at times `t`, and its fraction of `size`."""
    values: NDArray[Any] = run[name].astype(float)
    before = np.searchsorted(run.time, t + close, "right") - 1
    if run.kinds[name] == "real":
        same = np.abs(run.time[before] - t) <= close
        values = np.where(same, values[before], np.interp(t, run.time, values))
    else:
        values = values[before]
    apart = np.abs(values - expected)
    apart[np.isnan(apart)] = math.inf
    row = int(np.argmax(apart))
    largest = float(apart[row])
    share = largest / size if size > 0.0 else math.inf if largest > 0.0 else 0.0
    return {
        "signal": name,
        "share": share,
        "at_s": float(t[row]),
        "value": float(values[row]),
        "expected": float(expected[row]),
        "constant": constant,
    }


def expected_check(entry: Mapping[str, Any]) -> Check:
    """Return the check of a run against recorded results, from the entry ``expected`` of its summary."""
    file, within, signals = Path(entry["file"]).name, entry["within"], entry["signals"]
    problems, beyond = entry["problems"], entry["beyond"]
    allowed = f"{number(100.0 * within)} %"
    worst = next(iter(entry["differences"]), None)
    share = math.nan if worst is None else worst["share"]
    sentences = [*problems]
    if worst is not None and beyond:
        scale = "value" if worst["constant"] else "range"
        by = f"by {number(100.0 * share)} % of its {scale} at t = {worst['at_s']:.6g} s (allowed {allowed})"
        if math.isinf(share):
            by = f"at t = {worst['at_s']:.6g} s: {number(worst['value'])}, expected {number(worst['expected'])}"
        sentences.append(f"{worst['signal']} differs from {file} {by}")
    if beyond > 1:
        sentences.append(f"{beyond - 1} more of {signals} signals differ")
    many = amount(signals, "signal")
    until = f", up to t = {entry['until_s']:.6g} s, where {file} ends" if "until_s" in entry else ""
    equal = f"equals {file} in {many} to {number(100.0 * share)} % of the range (allowed {allowed}){until}"
    first, *rest = sentences or [equal]
    state = FAILED if sentences else GOOD
    return Check("expected", "Recorded results", state, first, "; ".join(rest), share, within, "the option within")
