"""The page of a parameter study: one HTML file with its figures inside."""

from __future__ import annotations

import base64
import shlex
from collections.abc import Iterable
from contextlib import suppress
from html import escape
from pathlib import Path

import numpy as np

from vdfmu.base.errors import UsageError
from vdfmu.base.files import write_whole
from vdfmu.base.temporary import temporary_folder
from vdfmu.compiler.fmu.page import page, table
from vdfmu.study.report.page import look
from vdfmu.study.sweeps.indices import indices
from vdfmu.study.sweeps.plots import plot
from vdfmu.study.sweeps.table import StudyTable

_SHOWN = 20
"""Failed points that are listed."""


def write_page(study: StudyTable, path: Path | None = None) -> Path:
    """Write facts of a study, the range of each measure, its worst point, failed points, and all figures that fit.

    Default ``report.html`` in the folder of the study; VdfmuError if it cannot be written.
    """
    path = study.folder / "report.html" if path is None else path
    facts, failed, wall = study.facts, study.failed, study["wall_s"]
    about = [
        ("Scenario", facts["source"]),
        *(("Axis", f"{axis}{_unit(facts['units'].get(axis.partition('=')[0], ''))}") for axis in facts["axes"]),
        ("Points", f"{len(study)} of {facts['n']} done, {facts['sample']}, seed {facts['seed']}"),
        ("Failed", str(len(failed))),
        ("Time of a point", f"{np.nanmedian(wall):.3g} s in the median, {np.nansum(wall):.3g} s in all"),
        *(("Setting", f"{name} = {value}") for name, value in {**facts["settings"], **facts["options"]}.items()),
        ("Engine", facts.get("engine", "fmu")),
        ("vdfmu", facts["vdfmu"]),
    ]
    parts = [
        _table(("", ""), [[name, _short(str(text))] for name, text in about]),
        "<h2>Measures</h2>",
        _table(("measure", "smallest", "median", "largest", "at point"), study.ranges()),
    ]
    for name, text in facts["measures"].items():
        head = escape(f"{name}{_unit(facts['units'].get(name, ''))}")
        parts += [f"<h2>{head}</h2><p><code>{escape(text)}</code></p>", *_of_measure(study, name)]
    parts += _compared(study)
    if failed:
        rows = [[str(point), _short(words, 400)] for point, words in list(failed.items())[:_SHOWN]]
        more = len(failed) - len(rows)
        parts += ["<h2>Failed points</h2>", _table(("point", "why"), rows), f"<p>and {more} more</p>" if more else ""]
    with suppress(OSError):  # writing then reports more
        path.parent.mkdir(parents=True, exist_ok=True)
    write_whole(path, [page(str(facts["scenario"]), "Parameter study", "\n".join(parts), 60, look())])
    return path


def _compared(study: StudyTable) -> Iterable[str]:
    """Return the differences of points of the batch engine from the runs of the FMUs, where they were compared."""
    columns = [column for column in study.columns if column.startswith("to_fmu[")]
    if not columns:
        return
    table = np.array([study["point"], *(study[column] for column in columns)], dtype=float).T
    rows = table[np.isfinite(table).all(axis=1)]
    yield "<h2>Batch engine and FMUs</h2>"
    yield "<p>Largest difference of a recorded signal, by unit, at points that both ran.</p>"
    heads = [column.removeprefix("to_fmu") for column in columns]
    yield _table(("point", *heads), [[f"{row[0]:.0f}", *(f"{x:.2g}" for x in row[1:])] for row in rows])


def _of_measure(study: StudyTable, name: str) -> Iterable[str]:
    """Return worst point, indices and figures of a measure, if there are any."""
    try:
        worst = study.row("worst", name)
        words = ", ".join(f"{axis} = {worst[axis]}" for axis in study.axes)
        yield f"<p>Worst point: {worst['point']}, {escape(_short(words))}."
        if not str(study.facts["source"]).endswith(".ssp"):
            command = f"vdfmu run --from {shlex.quote(str(study.path))} --row worst --by {name}"
            yield f" Run it again: <code>{escape(command)}</code>"
        yield "</p>"
        with temporary_folder("vdfmu_page_") as folder:
            for file in plot(study, measure=name, out=Path(folder)):
                picture = base64.b64encode(file.read_bytes()).decode()
                yield f'<img alt="{escape(file.stem)}" src="data:image/png;base64,{picture}">'
        if study.facts["sample"] in ("saltelli", "morris"):
            found = indices(study, name)
            rows = [[axis, *(row.get(name, "") for name in found.values)] for axis, row in found.rows()]
            yield _table(("axis", *found.values), rows)
    except UsageError as error:
        yield f"<p>{escape(str(error))}</p>"


def _table(heads: tuple[str, ...], rows: Iterable[list[str]]) -> str:
    cells = ([escape(one) for one in row] for row in rows)
    return f'<div class="wide">{table(heads, cells, ("",) * len(heads))}</div>'


def _unit(unit: str) -> str:
    return f" [{unit}]" if unit else ""


def _short(text: str, most: int = 160) -> str:
    return text if len(text) <= most else f"{text[: most - 2]} …"
