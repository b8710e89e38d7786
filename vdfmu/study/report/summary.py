"""The reader of ``summary.json``, for tables, checks and pages."""

from __future__ import annotations

import json
import math
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

from vdfmu.base.errors import UsageError
from vdfmu.base.text import elided
from vdfmu.engine.results.formats import result_files
from vdfmu.study.report.summary_keys import ANY, FLAG, KEYS, NUMBER, SPRINGS, TEXT, TRACKING, WHOLE, Keyed, List

_TEXTS = {"nan": math.nan, "inf": math.inf, "-inf": -math.inf}
"""Texts in JSON for numbers that are not finite."""
_DIFFERENCES = ("position_difference", "torque_difference")
_NEEDS: Mapping[str, tuple[str, ...]] = {
    "arm": ("types", "ell", "rotation", "offset", "tool_offset", "tool_rotation", "gravity", "shapes"),
    "power_bond": ("residual_energy_j", "residual_energy_abs_j", "exchanged_energy_j"),
    "communication": ("steps", "rejected", "unit_steps", "shortest_step", "longest_step"),
    "separation": ("change", "max_position_difference_rad"),
    "implied_gains": ("K_p_paper", "K_p"),
    "verdict": ("passed", "checks"),
}
"""Keys that a table has together."""
_TOGETHER = (TRACKING, SPRINGS)
"""Keys of which a summary has all or none."""
_SHAPES = {
    "tool_offset": (3,), "gravity": (3,), "tool_rotation": (3, 3), "offset": (-1, 3), "rotation": (-1, 3, 3),
}  # fmt: skip
"""Shapes of the arm's arrays; -1 is the number of joints."""
_KNOWN = {"position_units": ("deg", "mm"), "arm.types": ("revolute", "prismatic")}
"""Texts that a list may hold."""


def read_summary(file: Path) -> dict[str, Any]:
    """Return a summary whose keys have the types of `KEYS`, without keys that are null.

    Raises
    ------
    UsageError
        It cannot be read, or is another table; lists every problem.
    """
    try:
        found = json.loads(file.read_bytes())
    except RecursionError:
        raise UsageError(f"{file}: expected a table of facts, got lists within lists.") from None
    except (OSError, ValueError) as error:
        raise UsageError(
            f"{file.parent}: expected the folder of a run, with summary.json and {' or '.join(result_files())}: "
            f"{getattr(error, 'strerror', None) or elided(str(error))}. 'vdfmu run' writes one."
        ) from None
    lengths: dict[str, int] = {}
    summary, problems = typed(found, {name: key.of for name, key in KEYS.items()}, lengths)
    if not problems:
        problems = [*_missing(summary), *_unequal(summary, lengths)]
    if problems:
        raise UsageError("\n".join(f"{file}: {elided(problem)}. Run it again." for problem in problems[:20]))
    return summary


def typed(
    found: Any, keys: Mapping[str, Any], lengths: dict[str, int] | None = None
) -> tuple[dict[str, Any], list[str]]:
    """Return a table whose keys have these types, without null ones, and its faults.

    Lists over the joints get their `lengths`.
    """
    if not isinstance(found, dict):
        return {}, [f"expected a table of facts, got {_short(found)}"]
    problems: list[str] = []
    return _read(found, keys, "", problems, {} if lengths is None else lengths), problems


def _unequal(summary: Mapping[str, Any], lengths: Mapping[str, int]) -> Iterator[str]:
    """Yield lists over the joints that are of unequal lengths, and unknown texts in them."""
    if len(set(lengths.values())) > 1:
        counts = ", ".join(f"{key} has {count}" for key, count in lengths.items())
        yield f"expected an entry for each joint, got other numbers: {counts}"
    for key, known in _KNOWN.items():
        table, _, last = key.rpartition(".")
        texts = (summary.get(table, {}) if table else summary).get(last, ())
        yield from (f"{key}: expected {' or '.join(known)}, got {_short(t)}" for t in texts if t not in known)


def _missing(summary: Mapping[str, Any]) -> Iterator[str]:
    """Yield keys that are missing or of the wrong size although another key needs them."""
    for keys in _TOGETHER:
        if any(key in summary for key in keys):
            yield from (f"{key}: is missing" for key in keys if key not in summary)
    for key, needs in _NEEDS.items():
        yield from (f"{key}.{need}: is missing" for need in needs if key in summary and need not in summary[key])
    for name, entry in summary.get("limits", {}).items():
        keys = ("torque", "speed", "stop")
        if not all(len(entry.get(key, ())) == len(entry.get("torque", ())) > 0 for key in keys):
            yield f"limits.{name}: expected {', '.join(keys)} with a share for each joint"
    for i, check in enumerate(summary.get("verdict", {}).get("checks", ()), 1):
        yield from (f"verdict.checks[{i}].{k}: is missing" for k in ("name", "passed", "text") if k not in check)
    arm = summary.get("arm", {})
    for key, shape in _SHAPES.items():
        if key in arm and not _has_shape(arm[key], shape):
            yield f"arm.{key}: expected {' x '.join('joints' if k < 0 else str(k) for k in shape)} numbers"
    for name, entry in summary.get("reference", {}).items():
        needs = () if "max_difference" in entry else tuple(
            f"{way}_{what}" for way, what in (("max", "position_difference_rad"), ("max", "torque_difference_nm"))
        )  # fmt: skip
        if "separation" in summary:
            needs = (*needs, *(f"rms_{what}" for what in _DIFFERENCES))
        yield from (f"reference.{name}.{need}: is missing" for need in needs if need not in entry)


def _has_shape(value: Any, shape: tuple[int, ...]) -> bool:
    if not shape:
        return not isinstance(value, list)
    return isinstance(value, list) and shape[0] in (-1, len(value)) and all(_has_shape(v, shape[1:]) for v in value)


def _read(value: Any, of: Any, where: str, problems: list[str], lengths: dict[str, int]) -> Any:
    """Return a value of a type, or note that it is of another."""

    def inner(key: Any, entry: Any, kind: Any) -> Any:
        place = f"{where}[{key + 1}]" if isinstance(key, int) else f"{where}.{key}".lstrip(".")
        return _read(entry, kind, place, problems, lengths)

    if isinstance(of, Mapping | Keyed) and isinstance(value, dict):
        kinds = dict.fromkeys(value, of.of) if isinstance(of, Keyed) else of
        entries = ((key, entry, kinds.get(key, ANY)) for key, entry in value.items())
        return {key: inner(key, entry, kind) for key, entry, kind in entries if entry is not None}
    if isinstance(of, List) and isinstance(value, list):
        if of.joints:
            lengths[where] = len(value)
        return [inner(i, entry, of.of) for i, entry in enumerate(value)]
    if of is NUMBER and isinstance(value, str) and value in _TEXTS:
        return _TEXTS[value]
    good = {
        NUMBER: isinstance(value, int | float) and not isinstance(value, bool) and abs(value) < 1e300,
        WHOLE: isinstance(value, int) and not isinstance(value, bool) and 0 <= value < 2**53,
        TEXT: isinstance(value, str), FLAG: isinstance(value, bool), ANY: True,
    }  # fmt: skip
    if not (isinstance(of, str) and good[of]):
        kind = "a list" if isinstance(of, List) else "a table" if not isinstance(of, str) else of
        problems.append(f"{where}: expected {kind}, got {_short(value)}")
    return value


def _short(value: Any) -> str:
    text = json.dumps(value)
    return text if len(text) <= 60 else f"{text[:60]}..."
