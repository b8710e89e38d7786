"""``report.html``: one run, or several side by side, as one file that needs no other file and no network.

Tables, checks and the diagram are HTML from here; moving parts are drawn by ``web/*.js`` from the numbers of
:mod:`vdfmu.study.report.content`. The modules are one script in the page: names are unique among them, and the
lines of ``import`` and the words ``export`` are removed.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator, Mapping, Sequence
from functools import lru_cache
from html import escape
from pathlib import Path
from typing import Any, NamedTuple

from vdfmu.base.errors import UsageError
from vdfmu.base.files import write_whole
from vdfmu.base.json_text import to_json
from vdfmu.compiler.fmu.native import THIRD_PARTY
from vdfmu.compiler.fmu.page import page, table
from vdfmu.engine.results.formats import result_files
from vdfmu.engine.results.results import Results
from vdfmu.engine.results.verdict import checks_of, not_checked
from vdfmu.study.report.comparison import difference_sheet, joint_sheets
from vdfmu.study.report.content import content_of
from vdfmu.study.report.sheets import Sheet, facts, sheets
from vdfmu.study.report.simulation import compressed, simulation_of
from vdfmu.study.report.summary import read_summary
from vdfmu.study.report.wired import wired_arm
from vdfmu.system.package.drawing import system_diagram

NAME = "report.html"
_WEB = Path(__file__).parent / "web"
MODULES = (
    "packed.js", "vendor.js", "data.js", "chart.js", "figures.js", "arm.js", "player.js", "system.js", "worker.js",
    "simulation.js", "comparison.js", "lab_plots.js", "lab.js", "main.js",
)  # fmt: skip
"""In an order in which each comes after the modules that it imports."""
LAB = ("data.js", "lab_plots.js", "lab.js", "lab_main.js")
"""Modules of the page of a study that simulates nothing."""
GALLERY = ("gallery.js",)
"""Modules of the page of a folder of runs."""
WORKER = ("packed.js", "fmu.js", "master.js")
"""Modules of the worker that simulates, which the page holds as text."""
_VENDOR = ("three_uplot.min.js", "uplot.min.css")

_POLICY = (
    "<meta http-equiv=\"Content-Security-Policy\" content=\"default-src 'none'; script-src 'unsafe-inline' "
    "'wasm-unsafe-eval'; worker-src blob:; style-src 'unsafe-inline'; img-src data:\">"
)
"""Makes a browser refuse every request to a network; WebAssembly runs, and so do workers made by the page."""

_ALONE = (
    "body { max-width: none; padding: 0 } body > :not(#arm, noscript) { display: none } #arm { margin: 0 } "
    "@media (min-width: 560px) { .stage { grid-template-columns: minmax(0, 1fr) 16rem } .canvas { height: 58vh } }"
)
"""Style of a page with the arm alone."""


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
    tables = [folder / name for name in result_files()]
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
    runs: Sequence[ShownRun], *, simulate: bool = False, arm_alone: bool = False, study: StudyPart | None = None
) -> bytes:
    """Return the page of one run or of several, or of their arms alone; for `simulate` see :func:`write_report`.

    `study`: what a page of a study has above the run of its scenario.
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
        }
        for name, run in zip(names, runs, strict=True)
    ]
    if arm_alone:
        parts = [part | {"figures": [], "signals": [], "simulation": None} for part in parts]
    data = {"runs": parts} | ({"binaries": binaries} if binaries else {})
    data |= {"study": study.content} if study else {}
    inert = to_json(data, indent=None).replace("<", "\\u003c")  # nothing in it ends the script that contains it
    held = ({signal.name for signal in run.results.signals if signal.late} for run in runs)
    diagram = next(filter(None, (system_diagram(run.package, own) for run, own in zip(runs, held, strict=True))), "")
    summaries = [run.summary for run in runs]
    each = [f"robot {s['robot']}" if "robot" in s else f"system {s.get('system', '')}" for s in summaries]
    about = "; ".join(dict.fromkeys(each))
    body = "\n".join(
        [
            *([study.body] if study else ()),
            *_checks(names, runs),
            *(_comparison(names, runs) if len(runs) > 1 and not arm_alone else ()),
            '<section id="arm" class="card" hidden aria-label="The arm in 3D"></section>',
            '<section id="simulate" class="card" hidden aria-label="Simulate"></section>',
            '<section id="figures" class="card" hidden aria-label="Figures"></section>',
            f'<section id="system" class="card" hidden><h2>System</h2><div class="wide">{diagram}</div></section>',
            *_tables(names, runs),
            *_facts(names, runs),
            "<noscript><p>Figures and the arm are drawn by a script, which this browser does not run.</p></noscript>",
            f'<script id="data" type="application/json">{inert}</script>',
            *([f'<script type="text/plain" id="worker">{script(WORKER)}</script>'] if binaries else []),
            _libraries(),
            f'<script type="module">\n{script()}\n</script>',
        ]
    )
    head = f'{look()}<link rel="icon" href="data:,"><style>{_text(_VENDOR[1])}{_ALONE if arm_alone else ""}</style>'
    count, version = "one run" if len(runs) == 1 else f"{len(runs)} runs", summaries[0].get("vdfmu", "")
    what = f"{about[0].upper()}{about[1:]}, {count} of vdfmu {version}".strip()
    if study:
        return page(study.title, study.about, body, 84, head)
    return page(", ".join(names), what, body, 84, head)


def look() -> str:
    """Return the content of a page's head: its style, light or dark, and the policy that forbids network requests."""
    return f"{_POLICY}<style>{_text('report.css')}</style>"


@lru_cache
def _libraries() -> str:
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
    for name, run in zip(names, runs, strict=True):
        found = checks_of(run.summary)
        if found:
            rows = "".join(
                f'<li class="{"pass" if one.passed else "fail"}"><b>{"pass" if one.passed else "fail"}</b> '
                f"{escape(one.name)} <small>{escape(one.text)}</small></li>"
                for one in found
            )
            rows += "".join(f"<li>not checked <small>{escape(text)}</small></li>" for text in not_checked(run.summary))
            title = "Checks" if len(runs) == 1 else f"Checks of {escape(name)}"
            shown = "" if len(runs) > 1 else ' class="hidden"'
            yield f'<section class="checks"><h2{shown}>{title}</h2><ul>{rows}</ul></section>'


def _tables(names: Sequence[str], runs: Sequence[ShownRun]) -> Iterator[str]:
    shown: list[tuple[str, Sheet]] = []
    for name, run in zip(names, runs, strict=True):
        shown += [(f"{name}: " if len(runs) > 1 else "", sheet) for sheet in sheets(run.summary)]
    for before, sheet in shown:
        yield f'<section class="card"><h2>{escape(before + sheet.title)}</h2>{_sheet(sheet)}</section>'


def _comparison(names: Sequence[str], runs: Sequence[ShownRun]) -> Iterator[str]:
    """Yield what differs in the settings of runs, and in what they did; the page adds largest values and figures."""
    summaries = [run.summary for run in runs]
    settings = difference_sheet(names, summaries, [run.package for run in runs])
    yield f'<section class="card differs"><h2>{settings.title}</h2>{_sheet(settings)}</section>'
    tables = "".join(f"<div><h3>{escape(one.title)}</h3>{_sheet(one)}</div>" for one in joint_sheets(names, summaries))
    yield f'<section id="comparison" class="card"><h2>What it does</h2><div class="tables">{tables}</div></section>'


def _sheet(sheet: Sheet) -> str:
    heads = [escape(head).replace("\n", "<br>") for head in sheet.columns]
    notes = "".join(f"<p class=note>{escape(note)}</p>" for note in sheet.notes)
    made = f'<div class="wide">{_table(heads, sheet.rows)}</div>' if sheet.rows else ""
    return f"{made}{notes}"


def _facts(names: Sequence[str], runs: Sequence[ShownRun]) -> Iterator[str]:
    yield '<section class="card"><h2>What was run</h2>'
    columns = [dict(_facts_of(run.summary)) for run in runs]
    rows = [(key, *(column.get(key, "") for column in columns)) for key in dict.fromkeys(k for c in columns for k in c)]
    heads = ("", *(map(escape, names) if len(runs) > 1 else [""]))
    yield f'<div class="wide facts">{_table(heads, rows)}</div></section>'


def _facts_of(summary: Mapping[str, Any]) -> list[tuple[str, str]]:
    found = facts(summary)
    if "scenario" in summary and "settings" in summary and not summary["settings"]:
        found.append(("Settings", "none: all values are those of the scenario"))
    for key, factor in (summary.get("plant_factors") or {}).items():
        found.append((f"Plant, {key}", f"times {factor}, unlike the model of the feedforward"))
    if "scenario" in summary and "plant" in (summary.get("order") or ()):
        found.append(("Solver", "Rodas4 in the plant, order 4, with error control"))
    versions = {"vdfmu": summary.get("vdfmu"), **(summary.get("versions") or {})}
    return [*found, ("Versions", ", ".join(f"{name} {version}" for name, version in versions.items()))]


def _table(heads: Sequence[str], rows: Iterable[Sequence[str]]) -> str:
    return table(heads, ([escape(cell) for cell in row] for row in rows), ("name", *[""] * (len(heads) - 1)))
