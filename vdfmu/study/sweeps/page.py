"""The page of a parameter study: pictures that choose together, tables, and a run that opens any point."""

from __future__ import annotations

from collections.abc import Iterable
from contextlib import suppress
from html import escape
from pathlib import Path
from typing import Any

import numpy as np

from vdfmu.base.errors import UsageError, VdfmuError
from vdfmu.base.files import write_whole
from vdfmu.base.page import table
from vdfmu.base.temporary import temporary_folder
from vdfmu.study.report.page import NAME, StudyPart, report_page, study_page
from vdfmu.study.sweeps.axes import read_axes
from vdfmu.study.sweeps.indices import indices
from vdfmu.study.sweeps.lab import base_run, failed_groups, study_content
from vdfmu.study.sweeps.table import StudyTable


def write_page(study: StudyTable, path: Path | None = None, *, simulate: bool = True) -> Path:
    """Write the points of a study, the range of each measure, failures by cause, and indices; with `simulate` the run.

    Default ``report.html`` in the folder of the study; VdfmuError if it cannot be written.
    """
    path = study.folder / NAME if path is None else path
    with temporary_folder("vdfmu_page_") as folder:
        part, run = _part(study, Path(folder) / str(study.facts["scenario"]), simulate)
        page = study_page(part) if run is None else report_page([run], simulate=True, study=part)
    with suppress(OSError):  # writing then reports more
        path.parent.mkdir(parents=True, exist_ok=True)
    write_whole(path, [page])
    return path


def _part(study: StudyTable, folder: Path, simulate: bool) -> tuple[StudyPart, Any]:
    facts, failed = study.facts, study.failed
    content: dict[str, Any] = {}
    run = None
    try:
        study.values()
        points = study_content(study)
        changes, reason = None, ""
        if simulate:
            try:
                run, changes = base_run(study, folder)
            except VdfmuError as error:
                reason = f"The page does not simulate this point: {str(error).splitlines()[0]}"
        content = points | {"changes": changes, "reason": reason}
    except UsageError as error:
        lab = f"<p>{escape(str(error))}</p>"  # no point has a value
    else:
        lab = '<section id="lab" class="card" aria-label="Points of the study"></section>'
    axes, indexed = ", ".join(study.axes), facts["sample"] in ("saltelli", "morris")
    about = f"{len(study)} of {facts['n']} points of {facts['scenario']} over {axes}; {len(failed)} failed"
    sections = [
        lab,
        _card("Measures", _measures(study)),
        *([_card("Failed points, by cause", _failures(study))] if failed else []),
        *(_card(f"Indices of {name}", _indices(study, name)) for name in facts["measures"] if indexed),
        *_compared(study),
        _card("The study", _table(("", ""), _facts(study), "facts")),
        *(["<h2>The scenario as it is, and a chosen point</h2>"] if run is not None else []),
    ]
    return StudyPart(f"Study of {facts['scenario']}", about, "\n".join(sections), content), run


def _card(title: str, body: str) -> str:
    return f'<section class="card"><h2>{escape(title)}</h2>{body}</section>'


def _facts(study: StudyTable) -> list[list[str]]:
    facts, wall = study.facts, study["wall_s"]
    return [
        ["Scenario", str(facts["source"])],
        *(["Axis", f"{axis}{_unit(facts['units'].get(axis.partition('=')[0], ''))}"] for axis in facts["axes"]),
        *(["Measure", f"{name} = {text}"] for name, text in facts["measures"].items()),
        ["Points", f"{len(study)} of {facts['n']} done, {facts['sample']}, seed {facts['seed']}"],
        ["Time of a point", f"{np.nanmedian(wall):.3g} s in the median, {np.nansum(wall):.3g} s in all"],
        *(["Setting", f"{name} = {value}"] for name, value in {**facts["settings"], **facts["options"]}.items()),
        ["Engine", facts.get("engine", "fmu")],
        ["vdfmu", facts["vdfmu"]],
    ]


def _measures(study: StudyTable) -> str:
    """Return the range of each measure, with its worst point by the values of its axes, which opens it."""
    rows: list[list[str]] = []
    places = {point: k for k, point in enumerate(study["point"].tolist())}
    columns = study.table(study.axes).to_pylist()
    factors = {axis.target: " ×" if axis.factor else "" for axis in read_axes(study.facts["axes"])}
    for column, *ends, point in study.ranges():
        unit = study.facts["units"].get(column.partition("[")[0], "")
        cells = [escape(column) + _unit(unit), *map(escape, ends)]
        if point:
            values = ", ".join(
                f"{axis}{factors[axis]} {_value(value)}" for axis, value in columns[places[int(point)]].items()
            )
            cells.append(f'<button type="button" data-point="{point}">{escape(_short(values))}</button>')
        else:
            cells.append("")
        rows.append(cells)
    return _html_table(("measure", "smallest", "median", "largest", "largest at"), rows)


def _value(value: Any) -> str:
    return f"{value:.3g}" if isinstance(value, float) else Path(str(value)).name


def _failures(study: StudyTable) -> str:
    rows = [
        [
            escape(group.cause), str(len(group.points)), escape(_short(group.where)),
            f'<button type="button" data-point="{group.points[0]}">point {group.points[0]}</button>',
            f"<details><summary>message</summary>{escape(_short(group.message, 400))}</details>",
        ]
        for group in failed_groups(study)
    ]  # fmt: skip
    return _html_table(("cause", "points", "where", "first", ""), rows)


def _indices(study: StudyTable, name: str) -> str:
    try:
        found = indices(study, name)
    except UsageError as error:
        return f"<p>{escape(str(error))}</p>"
    rows = [[axis, *(row.get(index, "") for index in found.values)] for axis, row in found.rows()]
    return _table(("axis", *found.values), rows)


def _compared(study: StudyTable) -> Iterable[str]:
    """Return the differences of points of the batch engine from the runs of the FMUs, where they were compared."""
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
    return _html_table(heads, ([escape(one) for one in row] for row in rows), look)


def _html_table(heads: tuple[str, ...], rows: Iterable[list[str]], look: str = "") -> str:
    return f'<div class="wide {look}">{table(heads, rows, ("",) * len(heads))}</div>'


def _unit(unit: str) -> str:
    return f" [{unit}]" if unit else ""


def _short(text: str, most: int = 160) -> str:
    return text if len(text) <= most else f"{text[: most - 2]} …"
