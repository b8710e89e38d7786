"""Parts of the page of runs in HTML: checks, key figures, tables and facts."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from html import escape
from typing import Any, NamedTuple

from vdfmu.base.errors import VdfmuError
from vdfmu.base.files import digest_of
from vdfmu.base.measure import number, quantity
from vdfmu.base.page import table
from vdfmu.base.text import amount
from vdfmu.engine.package.read import load_ssp
from vdfmu.engine.plan.check import check_system
from vdfmu.engine.results.verdict import GOOD, checks_line, checks_of, state_of
from vdfmu.study.report.sheets import Sheet, facts, sheets, units_of
from vdfmu.study.report.shown_run import ShownRun
from vdfmu.study.run.summary_keys import Summary


def checks(names: Sequence[str], runs: Sequence[ShownRun]) -> Iterator[str]:
    """Yield the checks of each run in a line that can be opened; it is open unless all are good."""
    for k, (name, run) in enumerate(zip(names, runs, strict=True)):
        rows = "".join(
            f'<li class="{check.state.replace(" ", "-")}"><b>{check.state}</b> {escape(check.text)} '
            f"<small>{escape(check.source)}</small></li>"
            for check in checks_of(run.summary)
        )
        if rows:
            title = ("" if len(runs) == 1 else f"{escape(name)}: ") + checks_line(run.summary)
            state = state_of(run.summary)
            shown = "" if state == GOOD or len(runs) > 1 else " open"  # of several runs, figures come first
            yield (
                f'<details class="checks {state}" data-run="{k}"{shown}><summary>{title}</summary>'
                f"<ul>{rows}</ul></details>"
            )


class Tile(NamedTuple):
    """A key figure on the first screen."""

    name: str
    value: str
    note: str
    figure: str
    """Key of the figure that shows it, or a prefix of the key."""
    measure: str
    """Measure of a simulated run that replaces the value, see ``web/outcome.js``, and its signal if it is not the
    figure's; empty without such a measure."""
    number: float
    """Value as a number, in the unit of the key figure or the figure."""
    at: float | None = None
    """Time of the value [s]."""


def page_title(name: str, summary: Summary) -> str:
    """Return the title of the page of a run: ``tracking: tool error 2.89 µm, 6 joints``."""
    joints = summary.get("joints")
    facts = [f"{tile.name.lower()} {tile.value}" for tile in tiles_of(summary)[:1]]
    facts = ["unstable"] if "unstable" in (summary.get("key_figures") or {}) else facts
    facts += [amount(joints, "joint")] if joints else []
    return f"{name}: {', '.join(facts)}" if facts else name


MOST_TILES = 4
_TILES = {
    "unstable": ("Disturbances grow", "a step, {place}, since {time}", "tracking", ""),
    "saturated": ("Time at a limit", "{place}, since {time}", "torque", "key saturated"),
    "contact": ("Contact force", "at the tool, since {time}", "plant.F_e.N", "key contact"),
    "depth": ("Penetration", "at {time}", "{component}.", "highest {place}"),
    "power": ("Power at a cutting point", "joint {joint} at {time}", "power", "largest"),
    "cut": ("Torque at a cutting point", "joint {joint} at {time}", "force", "largest"),
    "tool_error": ("Tool error", "at {time}", "tool", "key tool_error"),
    "joint_error": ("Worst joint", "joint {joint} at {time}", "tracking", "key joint_error"),
    "margin": ("Modulus margin", "{place} at {time}", "torque", "key margin"),
    "torque": ("Peak torque", "joint {joint} at {time}", "torque", "largest"),
}
"""For each key figure the name, note, figure and measure of its tile; only the first ones are shown."""
_VALUES: Mapping[str, Callable[[float], str]] = {
    "tool_error": lambda value: quantity(value, "m"),
    "saturated": lambda value: f"{number(100.0 * value)} %",
    "margin": lambda value: number(value, 2) if value else "none",
    "unstable": lambda value: f"× {number(value)}",
}
"""Key figure without a unit to the text of its value."""


def value_of(key: str, figure: Summary) -> str:
    """Return the text of a key figure's value."""
    return _VALUES[key](figure["value"]) if key in _VALUES else quantity(figure["value"], figure.get("unit", ""))


def tiles_of(summary: Summary) -> list[Tile]:
    """Return the tiles of a summary: first faults, then figures of its components, then figures of every arm."""
    figures: Summary = summary.get("key_figures") or {}
    tiles: list[Tile] = []
    for key, (name, form, shown, measure) in _TILES.items():
        if key == "tool_error":
            tiles += _estimate_tiles(summary)
        resting = key.endswith("_error") and figures.get("path", {}).get("rest")
        if (figure := figures.get(key)) is None or resting:
            continue
        component = figure.get("place", "").partition(".")[0]
        form, shown, measure = (
            text.format_map({**figure, "time": f"{figure['at_s']:.3g} s", "component": component})
            for text in (form, shown, measure)
        )
        note = form
        name = name.replace("torque", "force").replace("Torque", "Force") if figure.get("unit") == "N" else name
        if figure.get("limit"):
            note = f"{100 * figure['value'] / figure['limit']:.3g} % of its limit, {note}"
        tiles.append(Tile(name, value_of(key, figure), note, shown, measure, figure["value"], figure["at_s"]))
    return tiles[:MOST_TILES]


def _estimate_tiles(summary: Summary) -> Iterator[Tile]:
    """Yield the RMS error of each estimate, for the joint with the largest."""
    for each in summary.get("scene", {}).get("estimates", []):
        errors: Sequence[float] = summary.get(f"rms_{each['group']}_error_nm") or []
        if errors:
            worst = max(range(len(errors)), key=errors.__getitem__)
            unit = units_of(summary, "torque_units", len(errors))[worst]
            name, note = each["words"].partition(",")[0], f"RMS error, joint {worst + 1}"
            figure = f"estimate.{each['component']}.{each['group']}"
            yield Tile(name, quantity(errors[worst], unit), note, figure, "apart", errors[worst])


def tiles(summary: Summary) -> Iterator[str]:
    """Yield the key figures as buttons that lead to their times and figures."""
    buttons = "".join(
        f'<button type="button" class="tile" data-figure="{tile.figure}" data-measure="{tile.measure}" '
        f'data-value="{tile.number!r}"'
        f"{'' if tile.at is None else f' data-time={tile.at!r}'}><span>{escape(tile.name)}</span> "
        f"<b>{escape(tile.value)}</b> <small>{escape(tile.note)}</small></button>"
        for tile in tiles_of(summary)
    )
    if buttons:
        yield f'<section class="tiles" aria-label="Numbers of the run">{buttons}</section>'


def marks(summary: Mapping[str, Any]) -> list[dict[str, Any]]:
    """Return the marks of the timeline with their texts."""
    figures: Mapping[str, Any] = summary.get("key_figures") or {}
    words = {"tool_error": "largest tool error", "contact": "first contact", "unstable": "unstable from here"}
    return [
        {"time": figures[key]["at_s"], "words": text, "bad": key == "unstable"}
        for key, text in words.items()
        if key in figures
    ]


def events(summary: Mapping[str, Any]) -> list[tuple[str, list[float]]]:
    """Return the names and times [s] of the events that figures mark."""
    listed: Mapping[str, Any] = summary.get("events") or {}
    return [(name, [float(f"{time:.9g}") for time in fact["times"]]) for name, fact in listed.items()]


def tables(names: Sequence[str], runs: Sequence[ShownRun]) -> Iterator[str]:
    """Yield the tables of each run."""
    for name, run in zip(names, runs, strict=True):
        for sheet in sheets(run.summary, fit=True):
            title = (f"{name}: " if len(runs) > 1 else "") + sheet.title
            yield f'<section class="card"><h2>{escape(title)}</h2>{sheet_html(sheet, title)}</section>'


def sheet_html(sheet: Sheet, title: str) -> str:
    """Return a table in HTML with its notes."""
    heads = [escape(head).replace("\n", "<br>") for head in sheet.columns]
    notes = "".join(f"<p class=note>{escape(note)}</p>" for note in sheet.notes)
    return (f'<div class="wide">{_table(heads, sheet.rows, title)}</div>' if sheet.rows else "") + notes


def facts_table(names: Sequence[str], runs: Sequence[ShownRun]) -> Iterator[str]:
    """Yield the facts of runs, one column per run."""
    yield '<section class="card" id="facts"><h2>What was run</h2>'
    columns = [dict(_facts_of(run)) for run in runs]
    keys = dict.fromkeys(key for column in columns for key in column)
    rows = [(key, *(column.get(key, "").replace("\n", "; ") for column in columns)) for key in keys]
    heads = ("", *(map(escape, names) if len(runs) > 1 else [""]))
    yield f'<div class="wide facts">{_table(heads, rows, "What was run")}</div></section>'


def components_table(run: ShownRun) -> Iterator[str]:
    """Yield the kinds of a package's FMUs, for the run of a package from any tool."""
    if "scenario" in run.summary or not run.package.is_file():
        return
    try:
        descriptions = check_system(load_ssp(run.package), algorithm=run.summary.get("algorithm")).descriptions
    except VdfmuError:  # the package has changed since the run
        return
    rows: list[tuple[str, ...]] = []
    for name, each in descriptions.items():
        kind = "model exchange" if each.exchange else "co-simulation"
        states, indicators = each.sizes
        events = f", {indicators} event indicator{'s' * (indicators > 1)}" if indicators else ""
        step = quantity(each.step, "s") if each.step else ""
        rows.append((name, f"FMI {each.version.name}, {kind}", each.tool, f"{states}{events}", step))
    heads = ("Component", "FMU", "Made by", "Continuous states", "Default step")
    made = table(heads, ([escape(cell) for cell in row] for row in rows), ("name", "name", "name", "", ""))
    yield f'<section class="card"><h2>Components</h2><div class="wide facts">{made}</div></section>'


def _facts_of(run: ShownRun) -> Iterator[tuple[str, str]]:
    summary = run.summary
    yield from facts(summary)
    if "date" in summary:
        yield "Date", summary["date"]
    if run.package.is_file():
        yield "system.ssp, SHA-256", digest_of(run.package)[:16]
    if "scenario" in summary and "parameters" in summary and not summary["parameters"]:
        yield "Parameters", "none: all values are from the scenario"
    for key, factor in (summary.get("plant_factors") or {}).items():
        yield f"Plant, {key}", f"times {factor}, unlike the model of the feedforward"
    if "scenario" in summary and "plant" in (summary.get("order") or ()):
        yield "Solver", "Rodas4 in the plant, order 4, with error control"
    versions = {"vdfmu": summary.get("vdfmu"), **(summary.get("versions") or {})}
    yield "Versions", ", ".join(f"{name} {version}" for name, version in versions.items())


def _table(heads: Sequence[str], rows: Iterable[Sequence[str]], caption: str) -> str:
    made = table(heads, ([escape(cell) for cell in row] for row in rows), ("name", *[""] * (len(heads) - 1)))
    return made.replace("<table>", f'<table>\n<caption class="hidden">{escape(caption)}</caption>', 1)
