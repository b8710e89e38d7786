"""The page of a study and its content: the answer, linked figures, tables, and a run that can show any point."""

from __future__ import annotations

import shlex
from collections.abc import Iterable
from contextlib import suppress
from html import escape
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from vdfmu.base.arrays import distinct
from vdfmu.base.errors import UsageError, VdfmuError
from vdfmu.base.extras import module_of_extra
from vdfmu.base.files import inside, temporary_folder, write_whole
from vdfmu.base.measure import quantity
from vdfmu.base.page import table
from vdfmu.study.report.page import NAME, StudyPart, report_page, study_page
from vdfmu.study.report.scripts import packed
from vdfmu.study.report.shown_run import ShownRun, read_run
from vdfmu.study.sweeps.answer import Answer
from vdfmu.study.sweeps.axes import is_option
from vdfmu.study.sweeps.failures import failed_groups, place_of
from vdfmu.study.sweeps.table import Side, StudyTable, view


def write_page(
    study: StudyTable, answer: Answer, path: Path | None = None, *, simulate: bool = True, trust: bool = False
) -> Path:
    """Write a study's page, by default ``report.html`` in its folder, with `simulate` including a run.

    The notes of the study say why a page has no run. With `trust` a study made by others is run too. VdfmuError if it
    fails.
    """
    path = inside(study.folder, study.folder / NAME) if path is None else path
    with temporary_folder("vdfmu_page_") as folder:
        part, run = _part(study, answer, Path(folder) / "run", simulate, trust)
        page = study_page(part) if run is None else report_page([run], simulate=True, study=part)
    with suppress(OSError):  # writing reports details
        path.parent.mkdir(parents=True, exist_ok=True)
    write_whole(path, [page])
    return path


def _part(study: StudyTable, answer: Answer, folder: Path, simulate: bool, trust: bool) -> tuple[StudyPart, Any]:
    facts, failed = study.facts, study.failed
    content: dict[str, Any] = {}
    run = None
    try:
        study.values()
        shown = shown_rows(study, answer)
        points = study_content(study, answer, shown)
        changes, reason = None, ""
        if simulate:
            try:
                run, changes = base_run(study, shown, folder, trust)
            except VdfmuError as error:
                reason = f"The page does not simulate this point: {str(error).splitlines()[0]}"
                study.notes.append(reason)
        content = points | {"changes": changes, "reason": reason}
    except UsageError as error:
        lab = f"<p>{escape(str(error))}</p>"  # no point has a value
    else:
        lab = '<section id="lab" class="card" aria-label="Points of the study"></section>'
    axes, indexed = ", ".join(study.axes), facts["sample"] in ("saltelli", "morris")
    tuning, n = "tune" in facts, len(study)
    count = f"{n} runs of a search" if tuning else f"{n} of {facts['n']} points"
    about = f"{count} over {axes}; {len(failed)} failed"
    if content and n > MOST_SHOWN:
        about += f"; pictures show {len(content['points'])}, a random selection with all extremes"
    sections = [
        lab,
        _card("Measures", _measures(study)),
        *([_card("Failed points, by cause", _failures(study))] if failed else []),
        *(_card(f"Indices of {name}", _indices(study, name)) for name in facts["measures"] if indexed),
        *_compared(study),
        _card("The study", _table(("", ""), _facts(study), "facts")),
        *(["<h2>The scenario as it is, and a chosen point</h2>"] if run is not None else []),
    ]
    more = escape(answer.verdict["results"])
    lead = f'<p class="verdict {answer.state}">{escape(answer.headline)} <small>{more}</small></p>\n'
    if answer.sentences:
        lead += f'<p class="answer">{escape(" ".join(answer.sentences))}</p>\n'
    title = f"{'Tuning' if tuning else 'Study'} of {facts['scenario']}"
    return StudyPart(title, about, "\n".join(sections), content, lead), run


def _card(title: str, body: str) -> str:
    return f'<section class="card"><h2>{escape(title)}</h2>{body}</section>'


def _facts(study: StudyTable) -> list[list[str]]:
    facts, wall = study.facts, study["wall_s"]
    return [
        ["Scenario", str(facts["source"])],
        *(["Axis", f"{axis}{_unit(facts['units'].get(axis.partition('=')[0], ''))}"] for axis in facts["axes"]),
        *(["Measure", f"{name} = {text}"] for name, text in facts["measures"].items()),
        *(
            [["Search", f"{len(study)} runs, {study.robots} robots, seed {facts['seed']}"]]
            if "tune" in facts
            else [["Points", f"{len(study)} of {facts['n']} done, {facts['sample']}, seed {facts['seed']}"]]
        ),
        ["Time of a point", f"{np.nanmedian(wall):.3g} s in the median, {np.nansum(wall):.3g} s in all"],
        *(["Parameter", f"{name} = {value}"] for name, value in {**facts["parameters"], **facts["options"]}.items()),
        ["Engine", facts.get("engine", "fmu")],
        ["vdfmu", facts["vdfmu"]],
    ]


def _measures(study: StudyTable) -> str:
    """Return the range of each measure, with buttons for its best and worst points, labelled by the axes' values."""
    rows: list[list[str]] = []
    places = {point: k for k, point in enumerate(study["point"].tolist())}
    columns = study.table(study.axes).to_pylist()
    for column, low, middle, high, least, most in study.ranges():
        unit = study.facts["units"].get(column.partition("[")[0], "")
        ends = [
            f'<button type="button" data-point="{point}">'
            f"{escape(_short(place_of(study, columns[places[int(point)]])))}</button>"
            if point
            else ""
            for point in (least, most)
        ]
        numbers = [quantity(float(text), unit) for text in (low, middle, high)] if least else [low, "", ""]
        rows.append([escape(column), *map(escape, numbers), *ends])
    return _html_table(("measure", "smallest", "median", "largest", "smallest at", "largest at"), rows)


def _failures(study: StudyTable) -> str:
    rows = [
        [
            escape(group.cause),
            str(len(group.points)),
            escape(_short(group.where)),
            f'<button type="button" data-point="{group.points[0]}">point {group.points[0]}</button>',
            f"<details><summary>message</summary>{escape(_short(group.message, 400))}</details>",
        ]
        for group in failed_groups(study)
    ]
    return _html_table(("cause", "points", "where", "first", ""), rows)


def _indices(study: StudyTable, name: str) -> str:
    try:
        sensitivity = module_of_extra("sensitivities", "sensitivity", "the table of indices").indices(study, name)
    except UsageError as error:
        return f"<p>{escape(str(error))}</p>"
    rows = [[axis, *(row.get(index, "") for index in sensitivity.values)] for axis, row in sensitivity.rows()]
    return _table(("axis", *sensitivity.values), rows)


def _compared(study: StudyTable) -> Iterable[str]:
    """Return the differences between the batch engine and FMUs at points that both ran."""
    columns = [column for column in study.columns if column.startswith("to_fmu[")]
    if not columns:
        return
    values = np.array([study["point"], *(study[column] for column in columns)], dtype=float).T
    rows = values[np.isfinite(values).all(axis=1)]
    words = "<p>Largest difference of a recorded signal, by unit, at points that both ran.</p>"
    heads = [column.removeprefix("to_fmu") for column in columns]
    cells = [[f"{row[0]:.0f}", *(f"{x:.2g}" for x in row[1:])] for row in rows]
    yield _card("Batch engine and FMUs", words + _table(("point", *heads), cells))


def _table(heads: tuple[str, ...], rows: Iterable[list[str]], look: str = "") -> str:
    return _html_table(heads, ([escape(cell) for cell in row] for row in rows), look)


def _html_table(heads: tuple[str, ...], rows: Iterable[list[str]], look: str = "") -> str:
    return f'<div class="wide {look}">{table(heads, rows, ("",) * len(heads))}</div>'


def _unit(unit: str) -> str:
    return f" [{unit}]" if unit else ""


def _short(text: str, most: int = 160) -> str:
    return text if len(text) <= most else f"{text[: most - 2]} …"


MOST_SHOWN = 15_000
"""Most points in a page, 3 MB with five columns. Of more points it has a random selection, and all that its texts
mention."""
MOST_VALUES = 200_000
"""Most parameters of all points in a page, 2 MB."""


def shown_rows(study: StudyTable, answer: Answer) -> NDArray[np.intp]:
    """Return the rows of the points in a page: all, or some with all extremes, first failures and roles."""
    n, points = len(study), study["point"]
    if n <= MOST_SHOWN:
        return np.arange(n)
    named = [int(point) for row in study.ranges() for point in row[-2:] if point]
    named += [group.points[0] for group in failed_groups(study)]
    some = np.random.default_rng(0).choice(n, MOST_SHOWN, replace=False)
    return distinct(some, np.flatnonzero(np.isin(points, named)), *_roles(study, answer).values()).astype(np.intp)


def columns_of(study: StudyTable, shown: NDArray[np.intp]) -> list[dict[str, Any]]:
    """Return the axes that vary, the most influential first, and the measures, each a column of `shown` rows.

    For a measure with several elements, the largest precedes them. Values have six digits, and are None for a failed
    run.
    """
    sides = [(side, True) for side in view(study).sides]
    for name in study.facts["measures"]:
        elements = study.elements(name) if any(c.partition("[")[0] == name for c in study.measures) else []
        for column in dict.fromkeys([name, *elements] if elements else []):
            try:
                sides.append((view(study, column).value, False))
            except UsageError:
                continue  # all failed
    return [_column(side, axis, shown) for side, axis in sides]


def _column(side: Side, axis: bool, shown: NDArray[np.intp]) -> dict[str, Any]:
    values = [float(f"{v:.6g}") if np.isfinite(v) else None for v in side.values[shown]]
    return {
        "name": side.name, "unit": side.unit, "log": side.log, "words": side.words, "axis": axis, "values": values,
    }  # fmt: skip


def study_content(study: StudyTable, answer: Answer, shown: NDArray[np.intp]) -> dict[str, Any]:
    """Return the data of the `shown` rows in the page, without ``changes``, see `base_run`, and their ``reason``."""
    package = str(study.facts["source"]).endswith(".ssp")
    failed, points = study.failed, study["point"][shown].tolist()
    return {
        "points": points,
        "columns": columns_of(study, shown),
        "failed": [failed.get(point) for point in points],
        "command": "" if package else f"vdfmu run --from {shlex.quote(str(study.path))} --row",
        "roles": {role: np.searchsorted(shown, rows).tolist() for role, rows in _roles(study, answer).items()},
    }


def _roles(study: StudyTable, answer: Answer) -> dict[str, list[int]]:
    """Return the rows of points by their roles: start, chosen and infeasible of a search, the best of a sweep."""
    points = study["point"]
    if study.search is None:
        return {} if answer.best is None else {"best": np.flatnonzero(points == answer.best).tolist()}
    return {
        role: np.flatnonzero(np.isin(points, [*getattr(study.search, role)])).tolist()
        for role in ("start", "chosen", "infeasible")
    }


def base_run(
    study: StudyTable, shown: NDArray[np.intp], folder: Path, trust: bool = False
) -> tuple[ShownRun, dict[str, Any]]:
    """Run a study's scenario without its axes in a folder; return the run and the parameters of `shown` points.

    Varied options have the values of the best point; points with other values have no changes. ``names`` are
    ``component.variable``, ``rows`` the places of points, ``values`` little-endian numbers, point by point.
    """
    from vdfmu.study.runs import run

    study.require_own(trust)
    source, best = study.facts["source"], study.row("best")
    if source.endswith(".ssp"):
        raise UsageError("Only scenarios are simulated in a page.")
    system, options = study.system(best)
    table, switched = study.table(study.axes).take(shown).to_pylist(), list(filter(is_option, study.axes))
    rows = [k for k, row in enumerate(table) if all(row[axis] == best[axis] for axis in switched)]
    changes = [system.parameters({target: table[k][target] for target in system.bindings}) for k in rows]
    names = list(changes[0]) if changes else []
    if len(names) * len(rows) > MOST_VALUES:
        raise UsageError(f"The study has {len(rows)} points with {len(names)} parameters, too much for a page.")
    numbers = np.array([[float(values[name]) for name in names] for values in changes], "<f8")
    run(source, out=folder, reference=False, **options)
    return read_run(folder), {"names": names, "rows": rows, "values": packed(numbers, "<f8")}
