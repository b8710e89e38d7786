"""What a run was held against, each with pass or fail: from its summary, without a new calculation."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from typing import Any, NamedTuple

from vdfmu.report.sheets import number

_VISIBLE = 1e-3
"""Share of the largest position error from which a difference to the reference shows in tables of three digits."""
_STATISTICS = 0.05
"""Share by which RMS errors of a chaotic loop may differ: finite samples of it differ by up to 2.4 %."""
_ROUNDING = 1e-12
"""Largest difference of the two formulations, as a share of the largest torque: some thousand roundings."""
_PAPER = {
    "rms_position_error_deg": "RMS position error",
    "max_position_error_deg": "Largest position error",
    "rms_torque_compensation_error_nm": "RMS torque compensation error",
}

Summary = Mapping[str, Any]


class Check(NamedTuple):
    """One thing that was checked."""

    name: str
    passed: bool
    text: str


def checks(summary: Summary) -> list[Check]:
    """Return the checks of a run, those for which its summary has the numbers."""
    return list(_checks(summary))


def _checks(summary: Summary) -> Iterator[Check]:
    if "error" in summary:
        yield Check("Ran to its end", False, str(summary["error"]))
    warnings: Sequence[str] | None = summary.get("warnings")
    if warnings is not None:
        yield Check(
            "Gains and step", not warnings, " ".join(warnings) or "no known cause of an unstable sampled loop"
        )
    yield from _reference(summary)
    paper: Summary = summary.get("paper") or {}
    for key, name in _PAPER.items():
        pairs = list(zip(summary.get(key) or (), paper.get(key) or (), strict=False))
        if pairs:
            above = [f"{i + 1}" for i, (ours, theirs) in enumerate(pairs) if not ours <= theirs]
            text = f"above it: joint {', '.join(above)}" if above else f"all of {len(pairs)} joints"
            yield Check(f"{name} at most the paper's", not above, text)
    if summary.get("kind") == "contrast":
        share = max(summary["rms_torque_difference_nmm"]) / (1e3 * max(summary["rms_torque_nm"]))
        text = f"they differ by {share:.1g} of the largest torque; limit {_ROUNDING:g}"
        yield Check("Virtual decomposition equals Newton-Euler", share <= _ROUNDING, text)


def _reference(summary: Summary) -> Iterator[Check]:
    """Yield whether the run equals the sampled reference, whose schedule is the master's."""
    found: Summary | None = (summary.get("reference") or {}).get("sampled")
    errors, units = summary.get("max_position_error_deg"), summary.get("position_units")
    if found is None or "max_position_difference_rad" not in found or not errors or not units:
        return
    if "separation" in summary:
        apart = max(found["rms_position_difference"], found["rms_torque_difference"])
        text = f"a chaotic loop: RMS errors differ by {100 * apart:.2g} %; limit {100 * _STATISTICS:g} %"
        yield Check("Statistics of the scipy reference", apart <= _STATISTICS, text)
        return
    si = {"deg": math.pi / 180.0, "mm": 1e-3}
    limit = _VISIBLE * max(si[unit] * error for error, unit in zip(errors, units, strict=True))
    apart = found["max_position_difference_rad"]
    text = f"positions differ by {number(apart)} rad at most; limit {number(limit)}, what three digits show"
    yield Check(f"Equals the {found['name']} scipy reference", apart <= limit, text)
