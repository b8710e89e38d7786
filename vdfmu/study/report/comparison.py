"""Two or more runs side by side: what differs in their settings, and in their errors joint by joint."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from vdfmu.base.errors import SspError
from vdfmu.base.quantity import quantity
from vdfmu.engine.package.read import load_ssp
from vdfmu.study.report.sheets import TRACKING, Sheet, Summary, facts, number, units_of

_MEASURED = (
    "Package", "Steps", "Wall time", "Real-time factor", "Pace", "Machine", "Communication", "Energy residual",
    "Chaotic loop", "No reference", "Settings",
)  # fmt: skip
"""Facts that are results, or that are given value by value."""
_SHOWN = 6
"""Most elements of an array that are listed."""
_MISSING = "-"
Values = Mapping[str, Mapping[str, tuple[Any, str]]]
"""Array, ``component.name``, to its elements: value and unit of measurement."""


def difference_sheet(names: Sequence[str], summaries: Sequence[Summary], packages: Sequence[Path]) -> Sheet:
    """Return the settings in which runs differ: facts of the runs, and values of their packages, or of ``--set``."""
    about = [{name: text for name, text in facts(one) if name not in _MEASURED} for one in summaries]
    for one, found in zip(summaries, about, strict=True):
        found |= {f"Plant, {key}": f"× {factor}" for key, factor in (one.get("plant_factors") or {}).items()}
        found |= {"vdfmu": str(one.get("vdfmu", ""))}
    rows = [
        (key, *(found.get(key, _MISSING) for found in about), "")
        for key in dict.fromkeys(key for found in about for key in found)
    ]
    values = [_package_values(path) for path in packages]
    notes: list[str] = []
    if all(found is not None for found in values):
        rows += _value_rows([found or {} for found in values])
    else:
        settings = [{**(one.get("settings") or {})} for one in summaries]
        rows += [
            (key, *(str(own.get(key, "as in the scenario")) for own in settings), "")
            for key in dict.fromkeys(key for own in settings for key in own)
        ]
        notes.append("A package is missing, so only what --set changed is compared.")
    differing = [row for row in rows if len(set(row[1:-1])) > 1]
    if not differing:
        return Sheet("What differs", ("",), [], ["The settings of the runs are the same."])
    if not any(row[-1] for row in differing):
        return Sheet("What differs", ("", *names), [row[:-1] for row in differing], notes)
    return Sheet("What differs", ("", *names, "change"), differing, notes)


def joint_sheets(names: Sequence[str], summaries: Sequence[Summary]) -> list[Sheet]:
    """Return a table for each error that several runs have, joint by joint; of two runs with the change."""
    made: list[Sheet] = []
    for heading, key, unit_key in TRACKING:
        runs = [(name, one[key], units_of(one, unit_key, len(one[key])))
                for name, one in zip(names, summaries, strict=True) if one.get(key)]  # fmt: skip
        if len(runs) < 2:
            continue
        columns = ("Joint", *(name for name, _, _ in runs), *(["change"] if len(runs) == 2 else []))
        rows: list[tuple[str, ...]] = []
        for i in range(max(len(values) for _, values, _ in runs)):
            own = [values[i] if i < len(values) else None for _, values, _ in runs]
            cells = [
                _MISSING if value is None else quantity(value, run[2][i]) for value, run in zip(own, runs, strict=True)
            ]
            rows.append((str(i + 1), *cells, *([change(*own)] if len(runs) == 2 else [])))
        made.append(Sheet(heading.replace("\n", " "), columns, rows, []))
    return made


def change(before: float | None, after: float | None) -> str:
    """Return how a number changed: in per cent, beyond a factor of 2 as a factor; empty without two numbers."""
    if not before or after is None:
        return ""
    ratio = after / before
    if abs(ratio - 1.0) < 5e-4:
        return "none" if ratio == 1.0 else "< 0.1 %"
    return f"× {number(ratio)}" if not 0.5 < ratio < 2.0 else f"{100.0 * (ratio - 1.0):+.2g} %".replace("-", "\u2212")


def _package_values(path: Path) -> Values | None:
    """Return the values that the bindings of a package give, by array and element; None without a package."""
    try:
        system = load_ssp(path) if path.is_file() else None
    except SspError:
        system = None
    if system is None:
        return None
    found: dict[str, dict[str, tuple[Any, str]]] = {}
    for component in system.components:
        for bound in component.parameters:
            array, _, index = bound.name.partition("[")
            unit = bound.unit.name if bound.unit else ""
            found.setdefault(f"{component.name}.{array}", {})[index.rstrip("]")] = (bound.value, unit)
    return found


def _value_rows(values: Sequence[Values]) -> list[tuple[str, ...]]:
    rows: list[tuple[str, ...]] = []
    for key in dict.fromkeys(key for found in values for key in found):
        own = [found.get(key, {}) for found in values]
        indices = list(dict.fromkeys(index for found in own for index in found))
        differing = [i for i in indices if len({repr(found.get(i)) for found in own}) > 1]
        if not differing:
            continue
        units = dict.fromkeys(unit for found in own for _, unit in found.values() if unit not in ("", "1"))
        shown = indices if len(differing) == len(indices) else differing
        part = "" if shown == indices else f"[{', '.join(shown[:_SHOWN])}]"
        texts = [_text([found[i][0] if i in found else None for i in shown]) for found in own]
        numbers = [{found[i][0] if i in found else None for i in differing} for found in own]
        one = len(own) == 2 and all(len(each) == 1 for each in numbers)
        pair = [next(iter(each)) for each in numbers] if one else []
        changed = change(*pair) if pair and all(type(value) is float for value in pair) else ""
        rows.append((f"{key}{part}{f' [{next(iter(units))}]' if len(units) == 1 else ''}", *texts, changed))
    return rows


def _text(values: Sequence[Any]) -> str:
    """Return values in a row, or the one that all have."""
    flat = [each for value in values for each in (value if isinstance(value, tuple) else (value,))]
    words = [_MISSING if value is None else f"{value:g}" if isinstance(value, float) else str(value) for value in flat]
    if len(set(words)) == 1:
        return words[0]
    return ", ".join(words[:_SHOWN]) + (" …" if len(words) > _SHOWN else "")
