"""``report.html``: one run, or several side by side, as one file that works offline; also only the arm of a run.

Static parts are HTML of :mod:`vdfmu.study.report.parts`; ``web/run.js`` draws the rest from the numbers of
:mod:`vdfmu.study.report.content`.
"""

from __future__ import annotations

import base64
import gzip
import os
import shlex
from collections.abc import Mapping, Sequence
from html import escape
from pathlib import Path
from types import ModuleType
from typing import Any, NamedTuple

from vdfmu.base.errors import LOG, CosimError, UsageError, VdfmuError
from vdfmu.base.extras import module_of_extra
from vdfmu.base.files import inside, require_ours, write_whole
from vdfmu.base.page import page
from vdfmu.base.standards import PYTHON_FMI
from vdfmu.base.text import error_text
from vdfmu.base.toml_file import locate, read_toml, shipped_names
from vdfmu.engine.algorithms import DEFAULT
from vdfmu.engine.package.join import JOINED
from vdfmu.engine.results.folder import write_summary
from vdfmu.engine.results.results import Results
from vdfmu.engine.results.verdict import outcome_of, results_of, state_of
from vdfmu.engine.run import Interrupted
from vdfmu.study.report import scripts
from vdfmu.study.report.content import content_of
from vdfmu.study.report.parts import checks, components_table, events, facts_table, marks, page_title, tables, tiles
from vdfmu.study.report.sheets import LATEX, sheets
from vdfmu.study.report.shown_run import NAME, ShownRun, is_gallery, newest_run, read_run, run_folder
from vdfmu.study.run.joint_components import cut_figures, wired_arm
from vdfmu.system.package.drawing import Coupling, system_diagram

_SKIP = '<a class="skip" href="#figures">Skip to the figures</a>\n'
"""First stop for keyboard navigation."""


class StudyPart(NamedTuple):
    """Title, subtitle and body of a study's page, which come above the run of its scenario."""

    title: str
    about: str
    body: str
    content: Mapping[str, Any]
    """For ``web/lab.js``."""
    lead: str
    """Answer of the study in HTML."""


def study_page(study: StudyPart) -> bytes:
    """Return the page of a study without a run below it."""
    body = "\n".join([study.body, scripts.data_element({"runs": [], "study": study.content})])
    look, code = scripts.look(), scripts.scripts_of("study")
    return page(study.title, study.about, body, 84, look, lead=study.lead, scripts=code)


def write_report(runs: Sequence[ShownRun], path: Path, *, simulate: bool = False) -> Path:
    """Write the page of one or more runs; with `simulate` sliders repeat them, with units compiled for the page."""
    write_whole(path, [report_page(runs, simulate=simulate)])
    return path


def report_of(folders: Sequence[Path], out: Path | None = None, *, simulate: bool = False) -> Path:
    """Write the page of runs, by default of the newest one in ``results``, or the page that lists a folder of runs.

    `out` without a suffix is a folder for the page; for a name that ends in ``.tex`` tables are written instead.

    UsageError without results, or for a file not written by vdfmu. Returns the path.
    """
    gallery = len(folders) == 1 and is_gallery(folders[0])
    folders = folders or [newest_run(Path("results"))]
    runs = [] if gallery else [read_run(folder) for folder in folders]
    name = "index.html" if gallery else NAME if len(runs) == 1 else "comparison.html"
    if out is None:
        place = folders[0] if len(folders) == 1 else folders[0].parent
        out = inside(place, (run_folder(place) if len(runs) == 1 else place) / name)
    elif not out.suffix or out.is_dir():  # a folder, as for runs
        out.mkdir(parents=True, exist_ok=True)
        out = inside(out, out / name)
    require_ours(out)
    if gallery:
        return module_of_extra("gallery", "compare", "the list of a folder of runs").write_gallery(folders[0], out)
    if out.suffix == LATEX:
        names = _names(runs)
        tables = [(name, sheet) for name, run in zip(names, runs, strict=True) for sheet in sheets(run.summary)]
        if len(runs) > 1:
            tables.insert(0, ("", _compare().difference_sheet(names, runs)))
        return module_of_extra("latex", "compare", "A file of tables").write_tables(tables, out)
    return write_report(runs, out, simulate=simulate)


def write_failed(
    name: str, package: Path, folder: Path, error: CosimError | Interrupted,
    program: Mapping[str, Any] | None = None, *, simulate: bool = False,
) -> None:  # fmt: skip
    """Write the page of a failed run that has rows; see `write_report`. A second failure is noted in the error."""
    try:
        if error.results is not None and len(error.results):
            run = ShownRun(name, error.results, error.results.summary, package, program=program)
            write_report([run], folder / NAME, simulate=simulate)
            write_summary(error.results.summary, folder)
    except Exception as other:
        error.add_note(f"{NAME} could not be made of its rows: {error_text(other)}")


def report_page(
    runs: Sequence[ShownRun], *, simulate: bool = False, arm_alone: bool = False, study: StudyPart | None = None
) -> bytes:
    """Return the page of one or more runs, or of only their arms.

    `simulate`: see :func:`write_report`. `study`: the study above the run of its scenario.
    """
    names = _names(runs)
    wired = [{} if "arm" in run.summary else _wired(run) for run in runs]
    runs = [run._replace(summary={**run.summary, **more}) for run, more in zip(runs, wired, strict=True)]
    binaries: dict[str, str] = {}
    commands = [run_command(run.summary) for run in runs]
    simulations = [
        _simulation(run, binaries if simulate else None, command) for run, command in zip(runs, commands, strict=True)
    ]
    parts = [
        {
            "name": name,
            **content_of(run.results, run.summary),
            "simulation": simulation,
            "command": command,
            "marks": marks(run.summary),
            "events": events(run.summary),
        }
        for name, run, simulation, command in zip(names, runs, simulations, commands, strict=True)
    ]
    scenarios = [simulation for simulation, run in zip(simulations, runs, strict=True) if "scenario" in run.summary]
    for reason in dict.fromkeys(simulation.get("reason") for simulation in scenarios if simulate):
        if reason:
            LOG.warning("the page has no sliders. %s", reason)
    if arm_alone:
        parts = [part | {"figures": [], "signals": [], "simulation": None} for part in parts]
    data = {"runs": parts} | ({"binaries": binaries} if binaries else {})
    data |= {"study": study.content} if study else {}
    drawn = (system_diagram(run.package, run.summary.get("held", ()), _coupling(run.summary)) for run in runs)
    diagram = next(filter(None, drawn), "")
    system = f'<section id="system" class="card" hidden><h2>System</h2><div class="wide">{diagram}</div></section>'
    summaries = [run.summary for run in runs]
    joined = not any("scenario" in summary or "arm" in summary for summary in summaries)
    compare = _compare() if len(runs) > 1 and not arm_alone else None
    settings = compare.difference_sheet(names, runs) if compare else None
    body = "\n".join(
        [
            *([study.body] if study else ()),
            *checks(names, runs),
            *(compare.comparison(names, runs, settings) if compare else ()),
            *([system] if joined else []),
            '<div class="bench"><section id="arm" class="card" hidden aria-label="The arm in 3D"></section>',
            '<div class="side">',
            *(tiles(summaries[0]) if len(runs) == 1 else ()),
            '<section id="simulate" class="card" hidden aria-label="Simulate"></section>',
            '<section id="figures" class="card" hidden aria-label="Figures"></section>',
            '<section id="found" class="card" hidden aria-label="Simulated and recorded"></section></div></div>',
            *([] if joined else [system]),
            *(components_table(runs[0]) if len(runs) == 1 else ()),
            *tables(names, runs),
            *facts_table(names, runs),
            "<noscript><p>Figures and the arm need scripts. Allow scripts in this browser.</p></noscript>",
            scripts.data_element(data),
            *([f'<script type="text/plain" id="worker">{scripts.bundle("master.js")}</script>'] if binaries else []),
            scripts.libraries(),
        ]
    )
    lines = [
        (f"{name}: {line}" if len(runs) > 1 else line, results_of(summary), state_of(summary), k)
        for k, (name, summary) in enumerate(zip(names, summaries, strict=True))
        if (line := outcome_of(summary))
    ]
    about = _about(summaries)
    head = scripts.run_head("; ".join(line for line, *_ in lines) or about, arm_alone)
    if study:
        code = scripts.scripts_of("sweep")
        return page(study.title, study.about, body, 84, head, first=_SKIP, lead=study.lead, scripts=code)
    verdicts = [
        f'<p class="verdict {state}" data-run="{k}">{escape(line)} <small>{escape(more)}</small></p>\n'
        for line, more, state, k in lines
    ]
    if compare:
        verdicts.insert(0, f'<p class="verdict">{escape(compare.answer(names, runs, settings))}</p>\n')
    lead = "".join(verdicts)
    tab = page_title(names[0], summaries[0]) if len(runs) == 1 else ""
    script = scripts.scripts_of("run")
    return page(", ".join(names), about, body, 92, head, tab=tab, first=_SKIP, lead=lead, scripts=script)


def _compare() -> ModuleType:
    """Return the comparison of several runs, which is an extra."""
    return module_of_extra("comparison", "compare", "the page of several runs")


def _simulation(run: ShownRun, binaries: dict[str, str] | None, command: str) -> dict[str, Any]:
    """Return the simulation of a run in the page, see `simulation_of`, or the reason why there is none."""
    if "scenario" not in run.summary:
        return {"reason": "This run is not simulated here: only runs of scenarios by 'vdfmu run' are."}
    from vdfmu.study.report.simulation import simulation_of  # takes long to import

    return simulation_of(run, binaries, command)


def _coupling(summary: Mapping[str, Any]) -> Coupling:
    """Return the coupling errors of signals that components read."""
    judgement: Mapping[str, Any] = summary.get("judgement") or {"signals": (), "wanted": 1.0}
    errors: dict[str, float] = {}
    for each in judgement["signals"]:
        group = each["name"].partition("[")[0]
        if each.get("read", True) and each["error"] >= errors.get(group, 0.0):
            errors[group] = each["error"]
    return Coupling(errors, judgement["wanted"])


def _wired(run: ShownRun) -> dict[str, Any]:
    """Return a summary's entries on an arm of joint components."""
    arm = wired_arm(run.results, run.package)
    return arm | {"key_figures": cut_figures(run.results)} if arm else {}


def _about(summaries: Sequence[Mapping[str, Any]]) -> str:
    """Return the subtitle: robots or systems, number of runs, version; for a single run also description and date."""
    each = [f"robot {s['robot']}" if "robot" in s else _system_of(s) for s in summaries]
    about = "; ".join(dict.fromkeys(each))
    count, version = "one run" if len(summaries) == 1 else f"{len(summaries)} runs", summaries[0].get("vdfmu", "")
    purpose = f"{summaries[0].get('description', '').rstrip('.')}. " if len(summaries) == 1 else ""
    made = f" on {summaries[0]['date'][:10]}" if len(summaries) == 1 and "date" in summaries[0] else ""
    return f"{purpose.removeprefix('. ')}{about[0].upper()}{about[1:]}, {count} of vdfmu {version}{made}".strip()


def _system_of(summary: Mapping[str, Any]) -> str:
    """Return what was run, for the subtitle."""
    name = summary.get("system", "")
    return f"FMU {name}" if [name] == summary.get("order") else "joined FMUs" if name == JOINED else f"system {name}"


def _name_of(run: ShownRun) -> str:
    """Return the scenario or system; of FMUs that were joined for the run the components, at most four."""
    name, parts = run.summary.get("scenario") or run.summary.get("system"), run.summary.get("order", ())
    if name != JOINED or not parts:
        return str(name or run.name)
    more = [f"{len(parts) - 3} more"] if len(parts) > 4 else []
    *first, last = [*parts[: 3 if more else 4], *more]
    return f"{', '.join(first)} and {last}" if first else last


def _names(runs: Sequence[ShownRun]) -> list[str]:
    """Return the names of the scenarios or systems; if two are the same, of the folders, numbered if they are equal."""
    names = [_name_of(run) for run in runs]
    if len(set(names)) < len(names):
        names = [run.name for run in runs]
    return [f"{name} ({names[: i + 1].count(name)})" if names.count(name) > 1 else name for i, name in enumerate(names)]


_OPTIONS = ("stop", "step", "algorithm", "adaptive", "tolerance")


def run_command(summary: Mapping[str, Any]) -> str:
    """Return the command that repeats the run of a scenario, with the options that changed the scenario.

    It contains all options if the scenario's file cannot be read. It is empty for other runs, for runs with external
    inputs, and for units that are Python objects.
    """
    name, units = summary.get("scenario"), summary.get("units") or {}
    if not name or summary.get("inputs") or any("<" in unit for unit in units.values()):
        return ""
    scenario = str(summary.get("scenario_file", name))
    written, robot = _written(scenario)
    if written is None and scenario.endswith("_reach"):  # as `reach_scenario` names it
        scenario = "reach"
    from vdfmu.compiler.unit.declaration import SOLVER_TOLERANCE  # takes long to import

    defaults = {"algorithm": DEFAULT, "tolerance": SOLVER_TOLERANCE}  # if a scenario's file lacks these keys
    words = ["vdfmu", "run", scenario]
    asked = summary.get("robot_file") or summary.get("robot")
    if "robot_file" in summary or asked != robot and asked in shipped_names("robots"):
        words += ["--robot", str(asked)]
    for option in _OPTIONS:
        value = summary.get(option)
        if value is not None and (written is None or value != written.get(option, defaults.get(option))):
            words += [f"--{option}", repr(value).removesuffix(".0") if isinstance(value, float) else str(value)]
    words += ["--backend", "python"] if summary.get("backend") == "python" else []
    words += ["--fmi", summary["fmi"]] if summary.get("fmi", PYTHON_FMI.name) != PYTHON_FMI.name else []
    entries = (summary.get("own_limits") or {}).items()
    limits = {key: entry["value"] for key, entry in entries if entry["by"] == "--limit"}
    words += [word for key, value in limits.items() for word in ("--limit", f"{key}={value!r}")]
    words += [word for component, unit in units.items() for word in ("--unit", f"{component}={unit}")]
    words += ["--unfed", "ok"] if units and summary.get("unfed") else []
    for connection in summary.get("connections") or ():
        words += ["--connect", connection.replace(" -> ", "=")]
    words += [
        word for each in (summary.get("parameters") or {}).items() for word in ("--set", "=".join(map(str, each)))
    ]
    return shlex.join(words)


def _written(scenario: str) -> tuple[dict[str, Any] | None, str | None]:
    """Return the content of a scenario's file, or None if it cannot be read, and the name of its robot."""
    try:
        path = locate(scenario, "scenarios")
        written = read_toml(path)
    except VdfmuError:
        return None, None
    try:
        robot = written.get("robot")
        return written, robot and read_toml(locate(robot, "robots", path.parent)).get("name")
    except VdfmuError:
        return written, None


_HEIGHT = 620
"""Height of the frame in a notebook before the page has loaded [px]."""
_LOADER = (
    "<script>(async () => {{ const bytes = Uint8Array.from(atob('{}'), (c) => c.charCodeAt(0)); "
    "const page = new Blob([bytes]).stream().pipeThrough(new DecompressionStream('gzip')); "
    "document.write(await new Response(page).text()); document.close(); "
    "addEventListener('report', () => {{ if (frameElement) frameElement.style.height = "
    "document.getElementById('arm').offsetHeight + 2 + 'px'; }}); }})()</script>"
)
"""Unpacks the page and sets its frame's height to that of the arm's section."""


def animate(run: Results | str | os.PathLike[str]) -> Animation:
    """Animate the arm of a run.

    Parameters
    ----------
    run : Results or path
        Results of `vdfmu.run`, or the folder of a run.

    Returns
    -------
    Animation
        A notebook shows it with a player; `Animation.save` writes it.

    Raises
    ------
    UsageError
        For results without an arm, or without its positions.

    Examples
    --------
    >>> animate(vdfmu.run("tracking"))
    >>> animate("results/tracking").save("arm.html")
    """
    if isinstance(run, Results):
        shown = ShownRun("run", run, run.summary, Path(run.summary.get("package", "")))
    else:
        shown = read_run(Path(run))
    if "arm" not in shown.summary:
        raise UsageError(
            "animate: run must be results of an arm, or their folder, got results without an arm. Use their plot()."
        )
    if "plant.q" not in shown.results:
        raise UsageError("animate: results must have the positions of the joints, plant.q. Record them.")
    return Animation(shown)


class Animation:
    """The moving arm of a run, made by :func:`vdfmu.study.report.page.animate`."""

    def __init__(self, run: ShownRun) -> None:
        self._page = report_page([run], arm_alone=True)
        self._name = f"{run.summary.get('scenario', run.name)}, {run.summary.get('robot', 'an arm')}"

    def __repr__(self) -> str:
        return f"<the arm of {self._name}: a notebook shows it, save('arm.html') writes it>"

    def _repr_html_(self) -> str:
        page = base64.b64encode(gzip.compress(self._page, mtime=0)).decode()
        return (
            f'<iframe srcdoc="{_LOADER.format(page)}" title="The arm in 3D" '
            f'style="width: 100%; height: {_HEIGHT}px; border: 0"></iframe>'
        )

    def save(self, path: str | os.PathLike[str]) -> Path:
        """Write the page of the arm for a browser; return its path.

        Raises
        ------
        UsageError
            If the name does not end with ``.html``.
        VdfmuError
            If the file cannot be written.
        """
        path = Path(path)
        if path.suffix.lower() != ".html":
            raise UsageError(f"save: the name must end with .html, got {path}.")
        write_whole(path, [self._page])
        return path
