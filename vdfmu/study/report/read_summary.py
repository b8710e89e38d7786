"""The reader of ``summary.json``, for tables, checks and pages."""

from __future__ import annotations

import json
import math
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

from vdfmu.base.errors import UsageError
from vdfmu.base.text import elided
from vdfmu.base.version import format_problem
from vdfmu.engine.results.formats import result_files
from vdfmu.study.report.summary_keys import ANY, FLAG, KEYS, NUMBER, TEXT, TOGETHER, WHOLE, Keyed, List, Record

_TEXTS = {"nan": math.nan, "inf": math.inf, "-inf": -math.inf}
"""Texts in JSON for numbers that are not finite."""


def read_summary(file: Path) -> dict[str, Any]:
    """Return a summary whose keys have the types of `KEYS`, without keys that are null.

    UsageError with every problem if it cannot be read, or is another table.
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
    if isinstance(found, dict) and (problem := format_problem(found.get("format", 1))):
        raise UsageError(f"{file}: {problem}")
    lengths: dict[str, int] = {}
    summary, problems = typed(found, {name: key.of for name, key in KEYS.items()}, lengths)
    if not problems:
        problems = list(_contradictions(summary, lengths))
    if problems:
        raise UsageError("\n".join(f"{file}: {elided(problem)}. Run it again." for problem in problems[:20]))
    return summary


def typed(found: Any, of: Any, lengths: dict[str, int] | None = None) -> tuple[dict[str, Any], list[str]]:
    """Return a table of a type, see `Key`, without null keys, and its faults; note `lengths` of lists over joints."""
    if not isinstance(found, dict):
        return {}, [f"expected a table of facts, got {_short(found)}"]
    problems: list[str] = []
    return _read(found, of, "", problems, {} if lengths is None else lengths), problems


def _contradictions(summary: Mapping[str, Any], lengths: Mapping[str, int]) -> Iterator[str]:
    """Yield lists that are of unequal lengths, and keys that are missing although others need them."""
    if len(set(lengths.values())) > 1:
        counts = ", ".join(f"{key} has {count}" for key, count in lengths.items())
        yield f"expected an entry for each joint, got other numbers: {counts}"
    for keys in TOGETHER:
        if any(key in summary for key in keys):
            yield from (f"{key}: is missing" for key in keys if key not in summary)
    for k, arm in enumerate(summary.get("scene", {}).get("arms", []), 1):
        of_joints = {key: len(arm[key]) for key in ("types", "ell", "rotation", "offset")}
        of_signals = {key: len(each) for key, each in arm["signals"].items() if "." in key}
        sizes = of_joints | of_signals
        if len(set(sizes.values())) > 1:
            yield f"scene.arms[{k}]: expected an entry for each joint, got {sizes}"
        for key, size in {"base": 12, "F_e": 6, "F_S": 6}.items():
            if len(arm["signals"].get(key, [None] * size)) != size:
                yield f"scene.arms[{k}].signals.{key}: expected {size} signals"
    for name, shares in summary.get("limits", {}).items():
        sizes = {len(each) for each in shares.values() if isinstance(each, list)}
        if len(sizes) > 1 or 0 in sizes:
            yield f"limits.{name}: expected {', '.join(shares)} with a share for each joint"
    for name, entry in summary.get("reference", {}).items():
        needs = [f"max_{what}" for what in ("position_difference_rad", "torque_difference_nm")]
        needs = [] if "max_difference" in entry else needs
        if "separation" in summary:
            needs += ["rms_position_difference", "rms_torque_difference"]
        yield from (f"reference.{name}.{need}: is missing" for need in needs if need not in entry)


def _read(value: Any, of: Any, where: str, problems: list[str], lengths: dict[str, int]) -> Any:
    """Return a value of a type, or note that it is of another."""

    def inner(key: Any, entry: Any, kind: Any) -> Any:
        place = f"{where}[{key + 1}]" if isinstance(key, int) else f"{where}.{key}".lstrip(".")
        return _read(entry, kind, place, problems, lengths)

    if isinstance(of, Mapping | Keyed | Record) and isinstance(value, dict):
        entries = {key: entry for key, entry in value.items() if entry is not None}
        if isinstance(of, Record):
            missing = [key for key in of.of if key not in entries]
            problems += [f"{f'{where}.{key}'.lstrip('.')}: is missing" for key in missing]
            of = {**of.of, **of.also}
        kinds = dict.fromkeys(entries, of.of) if isinstance(of, Keyed) else of
        return {key: inner(key, entry, kinds.get(key, ANY)) for key, entry in entries.items()}
    if isinstance(of, List) and isinstance(value, list):
        if of.joints:
            lengths[where] = len(value)
        if of.size not in (None, len(value)):
            problems.append(f"{where}: expected {of.size} entries, got {len(value)}")
        return [inner(i, entry, of.of) for i, entry in enumerate(value)]
    if of is NUMBER and isinstance(value, str) and value in _TEXTS:
        return _TEXTS[value]
    good = {
        NUMBER: isinstance(value, int | float) and not isinstance(value, bool) and abs(value) < 1e300,
        WHOLE: isinstance(value, int) and not isinstance(value, bool) and 0 <= value < 2**53,
        TEXT: isinstance(value, str), FLAG: isinstance(value, bool), ANY: True,
    }  # fmt: skip
    if not (value in of if isinstance(of, tuple) else isinstance(of, str) and good[of]):
        kind = "a list" if isinstance(of, List) else of if isinstance(of, str) else "a table"
        kind = " or ".join(of) if isinstance(of, tuple) else kind
        problems.append(f"{where}: expected {kind}, got {_short(value)}")
    return value


def _short(value: Any) -> str:
    text = json.dumps(value)
    return text if len(text) <= 60 else f"{text[:60]}..."
