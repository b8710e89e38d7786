"""``report.html``: one run, or several side by side, as one file that needs no other file and no network.

Tables, checks and the diagram are HTML from here; moving parts are drawn by ``web/*.js`` from the numbers of
:mod:`vdfmu.study.report.content`. The modules are one script in the page: names are unique among them, and the
lines of ``import`` and the words ``export`` are removed.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator, Mapping, Sequence
from functools import lru_cache
from hashlib import sha256
from html import escape
from pathlib import Path
from typing import Any, NamedTuple
from urllib.parse import quote

from vdfmu.base.errors import UsageError
from vdfmu.base.files import write_whole
from vdfmu.base.json_text import to_json
from vdfmu.base.palette import style_sheet
from vdfmu.compiler.fmu.native import THIRD_PARTY
from vdfmu.compiler.fmu.page import page, table
from vdfmu.engine.results.formats import result_files
from vdfmu.engine.results.results import Results
from vdfmu.engine.results.verdict import checks_of, not_checked
from vdfmu.study.report.command import run_command
from vdfmu.study.report.comparison import difference_sheet, joint_sheets
from vdfmu.study.report.content import content_of
from vdfmu.study.report.headline import Tile, checks_line, headline, page_title
from vdfmu.study.report.sheets import Sheet, facts, sheets
from vdfmu.study.report.simulation import compressed, simulation_of
from vdfmu.study.report.summary import read_summary
from vdfmu.study.report.wired import wired_arm
from vdfmu.system.package.drawing import system_diagram

NAME = "report.html"
_WEB = Path(__file__).parent / "web"
MODULES = (
    "packed.js", "vendor.js", "state.js", "data.js", "numbers.js", "labels.js", "heat.js", "save.js", "chart.js",
    "figures.js", "arm.js", "world.js", "puppet.js", "scene.js", "timeline.js", "player.js", "system.js", "worker.js",
    "knob.js", "budget.js", "simulation.js", "comparison.js", "lab_plots.js", "lab.js", "share.js", "live.js",
    "main.js",
)  # fmt: skip
"""In an order in which each comes after the modules that it imports."""
LAB = ("data.js", "lab_plots.js", "lab.js", "lab_main.js")
"""Modules of the page of a study that simulates nothing."""
GALLERY = ("gallery.js",)
"""Modules of the page of a folder of runs."""
WORKER = ("packed.js", "fmu.js", "master.js")
"""Modules of the worker that simulates, which the page holds as text."""
LIVE = "live.js"
"""Module that hears what the server of a page says."""
ROBOT = (
    "packed.js", "vendor.js", "data.js", "numbers.js", "arm.js", "world.js", "puppet.js", "scene.js", LIVE, "robot.js",
)  # fmt: skip
"""Modules of the page of a robot."""
_VENDOR = ("three_uplot.min.js", "uplot.min.css")

_POLICY = (
    "<meta http-equiv=\"Content-Security-Policy\" content=\"default-src 'none'; script-src 'unsafe-inline' "
    "'wasm-unsafe-eval'; worker-src blob:; style-src 'unsafe-inline'; img-src data:\">"
)
"""Makes a browser refuse every request to a network; WebAssembly runs, and so do workers made by the page."""

_ALONE = (
    "body { max-width: none; padding: 0 } main > :not(.bench, noscript) { display: none } .bench .side { display: none "
    "!important } .bench { display: block !important; margin: 0 } .bench #arm { display: block !important; margin: 0; "
    "position: static; height: auto } .bench .stage { position: static; margin: 0 } .bench .canvas { height: 42vh } "
    "@media (min-width: 560px) { .bench .canvas { height: 58vh } .bench #arm { display: grid !important; grid: "
    "'s r' 't t' 'b b' / minmax(0, 1fr) 16rem; gap: 0 1.2rem } .stage { grid-area: s } .transport { grid-area: t } "
    "#arm > .bar { grid-area: b } .bench .readout { grid-area: r; align-self: center; max-height: none } }"
)
"""Style of a page with the arm alone."""
_ICON = (
    '<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 32 32"><rect width="32" height="32" rx="7" fill="#0b63c4"/>'
    '<path d="M8 26V14l9-7 8 8" fill="none" stroke="#fff" stroke-width="4" stroke-linejoin="round"/>'
    '<g fill="#f2b632"><circle cx="8" cy="14" r="3"/><circle cx="17" cy="7" r="3"/></g></svg>'
)
"""Icon of the page: an arm."""


class ShownRun(NamedTuple):
    """A run that a page shows."""

    name: str
    results: Results
    summary: Mapping[str, Any]
    package: Path
    """Its ``system.ssp``; a missing one has no diagram."""


class StudyPart(NamedTuple):
    """What the page of a study shows, above the run of its scenario, if it has one."""

    title: str
    about: str
    body: str
    content: Mapping[str, Any]
    """For ``web/lab.js``."""


def study_page(study: StudyPart) -> bytes:
    """Return the page of a study that simulates nothing."""
    inert = to_json({"runs": [], "study": study.content}, indent=None).replace("<", "\\u003c")
    body = (
        f'{study.body}<script id="data" type="application/json">{inert}</script>'
        f'<script type="module">\n{script(LAB)}\n</script>'
    )
    return page(study.title, study.about, body, 84, f'{look()}<link rel="icon" href="data:,">')


def newest_run(folder: Path) -> Path:
    """Return the folder of the newest run in a folder; UsageError if there is none."""
    found = sorted(folder.glob("*/summary.json"), key=lambda path: path.stat().st_mtime)
    if not found:
        raise UsageError(f"{folder}: has no results of a run. Say where they are, or run one: 'vdfmu run tracking'.")
    return found[-1].parent


def read_run(folder: Path) -> ShownRun:
    """Return the run whose results are in a folder; UsageError if it has none."""
    tables = [folder / name for name in result_files(folder)]
    table = next((file for file in reversed(tables) if file.exists()), tables[0])
    for file in (folder / "summary.json", table):
        if file.exists() and not file.is_file():
            raise UsageError(f"{file}: expected a file, got a folder, a pipe or a device, which may never end.")
    summary = read_summary(folder / "summary.json")
    results = Results.read(table)
    if not len(results):
        raise UsageError(f"{folder}: the results have no rows, so there is nothing to show.")
    package = folder / "system.ssp"
    return ShownRun(
        folder.resolve().name, results, summary, package if package.exists() else Path(summary.get("package", ""))
    )


def write_report(runs: Sequence[ShownRun], path: Path, *, simulate: bool = False) -> Path:
    """Write the page of one run or of several; `simulate`: it can run them again, by units compiled for it."""
    write_whole(path, [report_page(runs, simulate=simulate)])
    return path


def report_page(
    runs: Sequence[ShownRun],
    *,
    simulate: bool = False,
    arm_alone: bool = False,
    study: StudyPart | None = None,
    live: Mapping[str, Any] | None = None,
) -> bytes:
    """Return the page of one run or of several, or of their arms alone; for `simulate` see :func:`write_report`.

    `study`: what a page of a study has above the run of its scenario. `live`: of a run that has only begun, ``names``
    of the signals of the rows that the page will be sent, and its times ``start`` and ``stop`` [s]; empty for a run
    that has ended and is not judged.
    """
    names = _names(runs)
    runs = [
        run if "arm" in run.summary else run._replace(summary=dict(run.summary) | wired_arm(run.results, run.package))
        for run in runs
    ]
    binaries: dict[str, str] = {}
    parts = [
        {
            "name": name,
            **content_of(run.results, run.summary),
            "simulation": simulation_of(run.results, run.summary, run.package, binaries if simulate else None),
            "command": run_command(run.summary),
            "marks": _marks(run.summary),
        }
        for name, run in zip(names, runs, strict=True)
    ]
    if arm_alone:
        parts = [part | {"figures": [], "signals": [], "simulation": None} for part in parts]
    if live is not None:
        parts = [part | {"simulation": None, "command": ""} | ({"signals": []} if live else {}) for part in parts]
    data = {"runs": parts} | ({"binaries": binaries} if binaries else {})
    data |= ({"study": study.content} if study else {}) | ({"live": live} if live else {})
    inert = to_json(data, indent=None).replace("<", "\\u003c")  # nothing in it ends the script that contains it
    held = ({signal.name for signal in run.results.signals if signal.late} for run in runs)
    diagram = next(filter(None, (system_diagram(run.package, own) for run, own in zip(runs, held, strict=True))), "")
    summaries = [run.summary for run in runs]
    each = [f"robot {s['robot']}" if "robot" in s else f"system {s.get('system', '')}" for s in summaries]
    about = "; ".join(dict.fromkeys(each))
    verdicts = [headline(one) for one in summaries]
    body = "\n".join(
        [
            *([study.body] if study else ()),
            *_checks(names, runs),
            '<a class="skip" href="#figures">Skip to the figures</a>',
            *(_comparison(names, runs) if len(runs) > 1 and not arm_alone else ()),
            '<div class="bench"><section id="arm" class="card" hidden aria-label="The arm in 3D"></section>',
            '<div class="side">',
            *(_tiles(verdicts[0].tiles) if len(runs) == 1 else ()),
            '<section id="simulate" class="card" hidden aria-label="Simulate"></section>',
            '<section id="figures" class="card" hidden aria-label="Figures"></section></div></div>',
            f'<section id="system" class="card" hidden><h2>System</h2><div class="wide">{diagram}</div></section>',
            *_tables(names, runs),
            *_facts(names, runs),
            "<noscript><p>Figures and the arm are drawn by a script, which this browser does not run.</p></noscript>",
            f'<script id="data" type="application/json">{inert}</script>',
            *([f'<script type="text/plain" id="worker">{script(WORKER)}</script>'] if binaries else []),
            libraries(),
            f'<script type="module">\n{script()}\n</script>',
        ]
    )
    told = [(f"{name}: " if len(runs) > 1 else "", one) for name, one in zip(names, verdicts, strict=True) if one.text]
    lead = "".join(
        f'<p class="verdict{"" if one.passed else " fail"}">{escape(before + one.text)}</p>\n' for before, one in told
    )
    description = escape("; ".join(before + one.text for before, one in told) or about)
    head = (
        f'<meta name="description" content="{description}"><link rel="icon" href="data:image/svg+xml,{quote(_ICON)}">'
        f"{look()}<style>{_text(_VENDOR[1])}{_ALONE if arm_alone else ''}</style>"
    )
    count, version = "one run" if len(runs) == 1 else f"{len(runs)} runs", summaries[0].get("vdfmu", "")
    if study:
        return page(study.title, study.about, body, 84, head)
    made = f" on {summaries[0]['date'][:10]}" if len(runs) == 1 and "date" in summaries[0] else ""
    what = f"{about[0].upper()}{about[1:]}, {count} of vdfmu {version}{made}".strip()
    tab = page_title(names[0], summaries[0]) if len(runs) == 1 else ""
    return page(", ".join(names), what, body, 92, head, tab=tab, lead=lead)


def look() -> str:
    """Return the content of a page's head: its style, light or dark, and the policy that forbids network requests."""
    return f"{_POLICY}<style>{style_sheet()}{_text('report.css')}</style>"


@lru_cache
def libraries() -> str:
    """Return the libraries, compressed, below their licences."""
    text = _text(_VENDOR[0])
    units = THIRD_PARTY.replace("libraries in binaries/", "units that a page simulates")
    licences = "\n".join([*re.findall(r"/\*!(.*?)\*/", text, re.DOTALL), units])
    packed = compressed(text.encode())
    return f'<!--\n{licences}-->\n<script type="text/plain" id="vendor">{packed}</script>'


def script(modules: Sequence[str] = MODULES) -> str:
    """Return modules of the page as one script."""
    lines = (line for name in modules for line in _text(name).splitlines() if not line.startswith("import "))
    return "\n".join(re.sub("^export ", "", line) for line in lines)


def _text(name: str) -> str:
    return (_WEB / name).read_text(encoding="utf-8")


def _names(runs: Sequence[ShownRun]) -> list[str]:
    """Return the scenarios, or, where two are the same, the folders; the same folder name gets a number."""
    names = [str(run.summary.get("scenario") or run.summary.get("system") or run.name) for run in runs]
    if len(set(names)) < len(names):
        names = [run.name for run in runs]
    return [f"{name} ({names[: i + 1].count(name)})" if names.count(name) > 1 else name for i, name in enumerate(names)]


def _checks(names: Sequence[str], runs: Sequence[ShownRun]) -> Iterator[str]:
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


def _tiles(tiles: Sequence[Tile]) -> Iterator[str]:
    """Yield the numbers of the first screen, as buttons that go to their times and figures."""
    buttons = "".join(
        f'<button type="button" class="tile" data-figure="{tile.figure}"'
        f"{'' if tile.at is None else f' data-time={tile.at!r}'}><span>{escape(tile.name)}</span> "
        f"<b>{escape(tile.value)}</b> <small>{escape(tile.note)}</small></button>"
        for tile in tiles
    )
    if buttons:
        yield f'<section class="tiles" aria-label="Numbers of the run">{buttons}</section>'


def _marks(summary: Mapping[str, Any]) -> list[dict[str, Any]]:
    """Return the times that the line of time of a run marks, with what is there."""
    figures: Mapping[str, Any] = summary.get("key_figures") or {}
    words = {"tool_error": "largest tool error", "unstable": "unstable from here"}
    return [{"time": figures[key]["at_s"], "words": text, "bad": key == "unstable"} for key, text in words.items()
            if key in figures]  # fmt: skip


def _tables(names: Sequence[str], runs: Sequence[ShownRun]) -> Iterator[str]:
    shown: list[tuple[str, Sheet]] = []
    for name, run in zip(names, runs, strict=True):
        shown += [(f"{name}: " if len(runs) > 1 else "", sheet) for sheet in sheets(run.summary)]
    for before, sheet in shown:
        title = before + sheet.title
        yield f'<section class="card"><h2>{escape(title)}</h2>{_sheet(sheet, title)}</section>'


def _comparison(names: Sequence[str], runs: Sequence[ShownRun]) -> Iterator[str]:
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


def _facts(names: Sequence[str], runs: Sequence[ShownRun]) -> Iterator[str]:
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
