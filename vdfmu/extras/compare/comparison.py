"""Compares several runs: which is better, in which measure, by how much, and which settings and results differ."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from html import escape
from pathlib import Path
from typing import Any

from vdfmu.base.errors import SspError
from vdfmu.base.measure import number, quantity
from vdfmu.base.page import table
from vdfmu.engine.package.read import load_ssp
from vdfmu.engine.results.verdict import FAILED, state_of
from vdfmu.study.report.parts import sheet_html, value_of
from vdfmu.study.report.sheets import TRACKING, Sheet, facts, units_of
from vdfmu.study.report.shown_run import ShownRun
from vdfmu.study.run.summary_keys import Summary

_BETTER = {
    "unstable": ("growth of disturbances", -1), "saturated": ("time at a limit", -1),
    "tool_error": ("tool error", -1), "joint_error": ("worst joint", -1), "margin": ("modulus margin", 1),
    "torque": ("peak torque", -1), "depth": ("penetration", 0), "contact": ("contact force", 0),
}  # fmt: skip
"""Key figure to its text, and 1 if more is better, -1 if less is better, else 0."""
_SAME = 0.05
"""Relative difference up to which key figures are the same."""
_DO = "What they do"
"""Heading above the key figures."""
_LISTED = 3
"""Largest number of different settings named in the answer."""


def comparison(names: Sequence[str], runs: Sequence[ShownRun], settings: Sheet) -> Iterator[str]:
    """Yield different settings, key figures and errors of runs; the page adds figures above them."""
    summaries = [run.summary for run in runs]
    two = len(names) == 2
    sheets = [settings, figure_sheet(names, summaries) if two else None, *joint_sheets(names, summaries)]
    parts = [(sheet.title, sheet_html(sheet, sheet.title)) for sheet in sheets if sheet]
    if not two:
        figures = sortable(("run",), [[escape(name)] for name in names], summaries)
        parts.insert(1, (_DO, f'<div class="wide">{figures}</div>'))
    tables = "".join(f"<div><h3>{escape(title)}</h3>{html}</div>" for title, html in parts)
    yield f'<section id="comparison" class="card"><h2>Compared</h2><div class="tables">{tables}</div></section>'


def answer(names: Sequence[str], runs: Sequence[ShownRun], settings: Sheet) -> str:
    """Return a sentence on which run is better, in which measure, by how much, and which settings differ."""
    summaries = [run.summary for run in runs]
    wins: dict[str, list[str]] = {}
    for key, (words, sign) in _BETTER.items():
        figures_by_run = {
            name: figures[key]
            for name, s in zip(names, summaries, strict=True)
            if key in (figures := s.get("key_figures") or {}) and state_of(s) != FAILED
        }
        if not sign or len(figures_by_run) < 2 or len({figure.get("unit") for figure in figures_by_run.values()}) > 1:
            continue
        *_, second, best = sorted(figures_by_run, key=lambda name: sign * figures_by_run[name]["value"])
        values = [figures_by_run[name]["value"] for name in (second, best)]
        if abs(values[1] - values[0]) < _SAME * abs(values[0]) or values[0] == values[1]:
            continue
        changed = change(*values)
        against = f"{value_of(key, figures_by_run[best])} instead of {value_of(key, figures_by_run[second])}"
        wins.setdefault(best, []).append(f"{words} ({', '.join(filter(None, (against, changed)))})")
    failed = [name for name, s in zip(names, summaries, strict=True) if state_of(s) == FAILED]
    than = "better" if len(names) == 2 else "best"
    whole = [name for name in names if name not in failed]
    said = [f"{whole[0]} is better: {failed[0]} failed"] if len(whole) == len(failed) == 1 else []
    said = said or [f"{name} failed" for name in failed]
    said += [f"{name} is {than} in {_listed(texts)}" for name, texts in wins.items()]
    if not said:
        said = ["The runs are equivalent: no key figure differs by 5 % or more"]
    differing = [row[0].partition(" [")[0] for row in settings.rows]
    more = f", and {len(differing) - _LISTED} more" if len(differing) > _LISTED else ""
    differ = f" They differ in {', '.join(differing[:_LISTED])}{more}." if differing else ""
    return f"{'; '.join(said)}.{differ}"


def _listed(texts: Sequence[str]) -> str:
    *front, last = texts
    return f"{', '.join(front)} and {last}" if front else last


def sortable(heads: Sequence[str], rows: Iterable[Sequence[str]], summaries: Sequence[Summary], last: str = "") -> str:
    """Return a table with a row per run, which ``web/sort.js`` sorts; `rows` are the cells in HTML.

    Key figures of the summaries follow the cells or, with `last`, come before the last cell, which has this heading.
    """
    every: list[Summary] = [summary.get("key_figures") or {} for summary in summaries]
    shown = {key: words for key, (words, _) in _BETTER.items() if any(key in figures for figures in every)}

    def cell(key: str, figures: Summary) -> str:
        if (figure := figures.get(key)) is None:
            return ""
        return f'<data value="{figure["value"]!r}">{escape(value_of(key, figure))}</data>'

    front = len(heads)
    cells = [
        [*row[:front], *(cell(key, figures) for key in shown), *row[front:]]
        for row, figures in zip(rows, every, strict=True)
    ]
    columns = (*heads, *shown.values(), *([last] if last else []))
    return table(columns, cells, [""] * len(columns)).replace("<table>", '<table class="sortable">', 1)


def figure_sheet(names: Sequence[str], summaries: Sequence[Summary]) -> Sheet | None:
    """Return the key figures that both runs have, with the change."""
    every: list[Summary] = [summary.get("key_figures") or {} for summary in summaries]
    rows: list[tuple[str, ...]] = []
    for key, (words, _) in _BETTER.items():
        both = [figures[key] for figures in every if key in figures]
        if len(both) == len(every):
            cells = [value_of(key, figure) for figure in both]
            rows.append((words.capitalize(), *cells, change(*(figure["value"] for figure in both))))
    return Sheet(_DO, ("Key figure", *names, "change"), rows, []) if rows else None


_MEASURED = (
    "Package",
    "Steps",
    "Wall time",
    "Real-time factor",
    "Pace",
    "Machine",
    "Communication",
    "Coupling energy error",
    "Chaotic loop",
    "No reference",
    "Parameters",
)
"""Facts that are results, or that are compared value by value instead."""
_SHOWN = 6
"""Most elements of an array that are listed."""
_MISSING = "-"
Values = Mapping[str, Mapping[str, tuple[Any, str]]]
"""Array, ``component.name``, to its elements: value and unit of measurement."""


def difference_sheet(names: Sequence[str], runs: Sequence[ShownRun]) -> Sheet:
    """Return the settings in which runs differ: facts, and values in their packages or in ``--set``."""
    summaries = [run.summary for run in runs]
    tables = [
        {name: text for name, text in facts(summary) if name not in _MEASURED}
        | {f"Plant, {key}": f"× {factor}" for key, factor in (summary.get("plant_factors") or {}).items()}
        | {"vdfmu": str(summary.get("vdfmu", ""))}
        for summary in summaries
    ]
    rows = _compared(tables, _MISSING)
    values = [_package_values(run.package) for run in runs]
    notes: list[str] = []
    if None not in values:
        rows += _value_rows([each or {} for each in values])
    else:
        rows += _compared([summary.get("parameters") or {} for summary in summaries], "as in the scenario")
        notes.append("A package is missing, so only values of --set are compared.")
    differing = [row for row in rows if len(set(row[1:-1])) > 1]
    if not differing:
        return Sheet("What differs", ("",), [], ["The settings of the runs are the same."])
    if not any(row[-1] for row in differing):
        return Sheet("What differs", ("", *names), [row[:-1] for row in differing], notes)
    return Sheet("What differs", ("", *names, "change"), differing, notes)


def _compared(tables: Sequence[Mapping[str, Any]], missing: str) -> list[tuple[str, ...]]:
    """Return a row for each key of tables, without changes."""
    keys = dict.fromkeys(key for table in tables for key in table)
    return [(key, *(str(table.get(key, missing)) for table in tables), "") for key in keys]


def joint_sheets(names: Sequence[str], summaries: Sequence[Summary]) -> list[Sheet]:
    """Return a table for each error that several runs have, joint by joint; for two runs with the change."""
    made: list[Sheet] = []
    for heading, key, unit_key in TRACKING:
        runs = [
            (name, summary[key], units_of(summary, unit_key, len(summary[key])))
            for name, summary in zip(names, summaries, strict=True)
            if summary.get(key)
        ]
        if len(runs) < 2:
            continue
        two = len(runs) == 2
        rows: list[tuple[str, ...]] = []
        for i in range(max(len(values) for _, values, _ in runs)):
            cells = [quantity(values[i], units[i]) if i < len(values) else _MISSING for _, values, units in runs]
            pair = [values[i] if i < len(values) else None for _, values, _ in runs]
            rows.append((str(i + 1), *cells, *([change(*pair)] if two else [])))
        columns = ("Joint", *(name for name, _, _ in runs), *(["change"] if two else []))
        made.append(Sheet(heading.replace("\n", " "), columns, rows, []))
    return made


def change(before: float | None, after: float | None) -> str:
    """Return the factor by which a number changed; empty without two numbers."""
    if not before or after is None:
        return ""
    return "none" if after == before else f"× {number(after / before)}"


def _package_values(path: Path) -> Values | None:
    """Return the values bound in a package, by array and element; None without a package."""
    try:
        components = load_ssp(path).components if path.is_file() else None
    except SspError:
        return None
    if components is None:
        return None
    values: dict[str, dict[str, tuple[Any, str]]] = {}
    for component in components:
        for bound in component.parameters:
            array, _, index = bound.name.partition("[")
            unit = bound.unit.name if bound.unit else ""
            values.setdefault(f"{component.name}.{array}", {})[index.rstrip("]")] = (bound.value, unit)
    return values


def _value_rows(runs: Sequence[Values]) -> list[tuple[str, ...]]:
    rows: list[tuple[str, ...]] = []
    for key in dict.fromkeys(key for values in runs for key in values):
        arrays = [values.get(key, {}) for values in runs]
        indices = list(dict.fromkeys(index for array in arrays for index in array))
        differing = [i for i in indices if len({repr(array.get(i)) for array in arrays}) > 1]
        if not differing:
            continue
        units = dict.fromkeys(unit for array in arrays for _, unit in array.values() if unit not in ("", "1"))
        shown = indices if len(differing) == len(indices) else differing
        part = "" if shown == indices else f"[{', '.join(shown[:_SHOWN])}]"
        numbers = [[array[i][0] if i in array else None for i in shown] for array in arrays]
        pair = [values[0] for values in numbers if len(set(values)) == 1 and type(values[0]) is float]
        changed = change(*pair) if len(numbers) == len(pair) == 2 else ""
        unit = f" [{next(iter(units))}]" if len(units) == 1 else ""
        rows.append((f"{key}{part}{unit}", *map(_text, numbers), changed))
    return rows


def _text(values: Sequence[Any]) -> str:
    """Return values in a row, or only one if all are the same."""
    flat = [each for value in values for each in (value if isinstance(value, tuple) else (value,))]
    words = [_MISSING if value is None else f"{value:g}" if isinstance(value, float) else str(value) for value in flat]
    if len(set(words)) == 1:
        return words[0]
    return ", ".join(words[:_SHOWN]) + (" …" if len(words) > _SHOWN else "")
