"""Parts of the page of runs that are HTML before any script runs: checks, numbers, tables, facts, differences."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from hashlib import sha256
from html import escape
from pathlib import Path
from typing import Any

from vdfmu.base.errors import SspError
from vdfmu.base.measure import number, quantity
from vdfmu.base.page import table
from vdfmu.engine.package.read import load_ssp
from vdfmu.engine.results.verdict import GOOD, checks_line, checks_of, state_of
from vdfmu.study.report.headline import Tile
from vdfmu.study.report.sheets import TRACKING, Sheet, facts, sheets, units_of
from vdfmu.study.report.shown_run import ShownRun
from vdfmu.study.run.summary_keys import Summary


def checks(names: Sequence[str], runs: Sequence[ShownRun]) -> Iterator[str]:
    """Yield the checks of each run in a line that opens, and is open unless all are good."""
    for name, run in zip(names, runs, strict=True):
        found = checks_of(run.summary)
        if found:
            rows = "".join(
                f'<li class="{one.state}"><b>{one.state}</b> {escape(one.name)} <small>{escape(one.text)}</small></li>'
                for one in found
            )
            title = ("" if len(runs) == 1 else f"{escape(name)}: ") + checks_line(run.summary)
            state = state_of(run.summary)
            shown = "" if state == GOOD else " open"
            yield f'<details class="checks {state}"{shown}><summary>{title}</summary><ul>{rows}</ul></details>'


def tiles(tiles: Iterable[Tile]) -> Iterator[str]:
    """Yield the numbers of the first screen, as buttons that go to their times and figures."""
    buttons = "".join(
        f'<button type="button" class="tile" data-figure="{tile.figure}"'
        f"{'' if tile.at is None else f' data-time={tile.at!r}'}><span>{escape(tile.name)}</span> "
        f"<b>{escape(tile.value)}</b> <small>{escape(tile.note)}</small></button>"
        for tile in tiles
    )
    if buttons:
        yield f'<section class="tiles" aria-label="Numbers of the run">{buttons}</section>'


def marks(summary: Mapping[str, Any]) -> list[dict[str, Any]]:
    """Return the times that the line of time of a run marks, with what is there."""
    figures: Mapping[str, Any] = summary.get("key_figures") or {}
    words = {"tool_error": "largest tool error", "unstable": "unstable from here"}
    return [{"time": figures[key]["at_s"], "words": text, "bad": key == "unstable"} for key, text in words.items()
            if key in figures]  # fmt: skip


def tables(names: Sequence[str], runs: Sequence[ShownRun]) -> Iterator[str]:
    """Yield the tables of each run."""
    shown: list[tuple[str, Sheet]] = []
    for name, run in zip(names, runs, strict=True):
        shown += [(f"{name}: " if len(runs) > 1 else "", sheet) for sheet in sheets(run.summary, fit=True)]
    for before, sheet in shown:
        title = before + sheet.title
        yield f'<section class="card"><h2>{escape(title)}</h2>{_sheet(sheet, title)}</section>'


def comparison(names: Sequence[str], runs: Sequence[ShownRun]) -> Iterator[str]:
    """Yield what differs in the settings of runs, and in what they did; the page adds largest values and figures."""
    summaries = [run.summary for run in runs]
    settings = difference_sheet(names, summaries, [run.package for run in runs])
    yield f'<section class="card differs"><h2>{settings.title}</h2>{_sheet(settings, settings.title)}</section>'
    each = joint_sheets(names, summaries)
    tables = "".join(f"<div><h3>{escape(one.title)}</h3>{_sheet(one, one.title)}</div>" for one in each)
    yield f'<section id="comparison" class="card"><h2>What it does</h2><div class="tables">{tables}</div></section>'


def _sheet(sheet: Sheet, title: str) -> str:
    heads = [escape(head).replace("\n", "<br>") for head in sheet.columns]
    notes = "".join(f"<p class=note>{escape(note)}</p>" for note in sheet.notes)
    made = f'<div class="wide">{_table(heads, sheet.rows, title)}</div>' if sheet.rows else ""
    return f"{made}{notes}"


def facts_table(names: Sequence[str], runs: Sequence[ShownRun]) -> Iterator[str]:
    """Yield what was run, a column a run."""
    yield '<section class="card" id="facts"><h2>What was run</h2>'
    columns = [dict(_facts_of(run)) for run in runs]
    rows = [(key, *(column.get(key, "") for column in columns)) for key in dict.fromkeys(k for c in columns for k in c)]
    heads = ("", *(map(escape, names) if len(runs) > 1 else [""]))
    yield f'<div class="wide facts">{_table(heads, rows, "What was run")}</div></section>'


def _facts_of(run: ShownRun) -> list[tuple[str, str]]:
    summary = run.summary
    found = [*facts(summary), *([("Date", summary["date"])] if "date" in summary else [])]
    if run.package.is_file():
        found.append(("system.ssp, SHA-256", sha256(run.package.read_bytes()).hexdigest()[:16]))
    if "scenario" in summary and "settings" in summary and not summary["settings"]:
        found.append(("Settings", "none: all values are those of the scenario"))
    for key, factor in (summary.get("plant_factors") or {}).items():
        found.append((f"Plant, {key}", f"times {factor}, unlike the model of the feedforward"))
    if "scenario" in summary and "plant" in (summary.get("order") or ()):
        found.append(("Solver", "Rodas4 in the plant, order 4, with error control"))
    versions = {"vdfmu": summary.get("vdfmu"), **(summary.get("versions") or {})}
    return [*found, ("Versions", ", ".join(f"{name} {version}" for name, version in versions.items()))]


def _table(heads: Sequence[str], rows: Iterable[Sequence[str]], caption: str) -> str:
    made = table(heads, ([escape(cell) for cell in row] for row in rows), ("name", *[""] * (len(heads) - 1)))
    return made.replace("<table>", f'<table>\n<caption class="hidden">{escape(caption)}</caption>', 1)


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
