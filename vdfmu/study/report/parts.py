"""Parts of the page of runs that are HTML before any script runs: checks, numbers, tables, facts."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from hashlib import sha256
from html import escape
from typing import Any

from vdfmu.base.page import table
from vdfmu.engine.results.verdict import checks_of, not_checked
from vdfmu.study.report.comparison import difference_sheet, joint_sheets
from vdfmu.study.report.headline import Tile, checks_line
from vdfmu.study.report.sheets import Sheet, facts, sheets
from vdfmu.study.report.shown_run import ShownRun


def checks(names: Sequence[str], runs: Sequence[ShownRun]) -> Iterator[str]:
    """Yield the checks of each run in a line that opens, and is open where one failed."""
    for name, run in zip(names, runs, strict=True):
        found = checks_of(run.summary)
        if found:
            rows = "".join(
                f'<li class="{"pass" if one.passed else "fail"}"><b>{"pass" if one.passed else "fail"}</b> '
                f"{escape(one.name)} <small>{escape(one.text)}</small></li>"
                for one in found
            )
            rows += "".join(f"<li>not checked <small>{escape(text)}</small></li>" for text in not_checked(run.summary))
            title = ("" if len(runs) == 1 else f"{escape(name)}: ") + checks_line(run.summary)
            shown = "" if all(one.passed for one in found) else " open"
            yield f'<details class="checks"{shown}><summary>{title}</summary><ul>{rows}</ul></details>'


def tiles(tiles: Sequence[Tile]) -> Iterator[str]:
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
