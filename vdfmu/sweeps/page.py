"""The page of a parameter study: one HTML file with its figures inside."""

from __future__ import annotations

import base64
import re
import shlex
from collections.abc import Iterable, Sequence
from html import escape
from pathlib import Path

import numpy as np

from vdfmu.errors import UsageError, VdfmuError
from vdfmu.files import replacing
from vdfmu.sweeps.indices import indices
from vdfmu.sweeps.plots import plot
from vdfmu.sweeps.table import Sweep
from vdfmu.temporary import temporary_folder

__all__ = ["write_page"]

_SHOWN = 20
"""Failed points that are listed."""
_STYLE = """
body { font: 15px/1.45 "DejaVu Sans", sans-serif; max-width: 60rem; margin: 2rem auto; padding: 0 1rem; color: #222; }
table { border-collapse: collapse; margin: 0.6rem 0 1.4rem; }
td, th { padding: 0.2rem 0.9rem 0.2rem 0; text-align: left; border-bottom: 1px solid #ddd; vertical-align: top; }
td.number { text-align: right; font-variant-numeric: tabular-nums; }
img { max-width: 100%; display: block; margin: 1rem 0; }
code { background: #f3f3f3; padding: 0.15rem 0.3rem; }
h2 { margin-top: 2.2rem; border-bottom: 2px solid #0072b2; }
"""


def write_page(study: Sweep, path: Path | None = None) -> Path:
    """Write what a study is, the range of each measure, its worst point, failed points, and all figures that fit.

    Parameters
    ----------
    study : Sweep
    path : Path, optional
        Default ``report.html`` in the folder of the study.

    Raises
    ------
    VdfmuError
        If the file cannot be written.
    """
    path = study.folder / "report.html" if path is None else path
    facts, failed, wall = study.facts, study.failed, study["wall_s"]
    about = [
        ("Scenario", facts["source"]),
        *(
            ("Axis", f"{axis}{_unit(facts['units'].get(axis.partition('=')[0], ''))}")
            for axis in facts["axes"]
        ),
        ("Points", f"{len(study)} of {facts['n']} done, {facts['sample']}, seed {facts['seed']}"),
        ("Failed", str(len(failed))),
        ("Time of a point", f"{np.nanmedian(wall):.3g} s in the median, {np.nansum(wall):.3g} s in all"),
        *(
            ("Setting", f"{name} = {value}")
            for name, value in {**facts["settings"], **facts["options"]}.items()
        ),
        ("Engine", facts.get("engine", "fmu")),
        ("vdfmu", facts["vdfmu"]),
    ]
    parts = [
        f"<h1>{escape(str(facts['scenario']))}: parameter study</h1>",
        _table((), [[name, _short(str(text))] for name, text in about]),
        "<h2>Measures</h2>",
        _table(("measure", "smallest", "median", "largest", "at point"), study.ranges()),
    ]
    for name, text in facts["measures"].items():
        parts += [
            f"<h2>{escape(name)}{escape(_unit(facts['units'].get(name, '')))}</h2><p><code>{escape(text)}</code></p>"
        ]
        parts += _of_measure(study, name)
    parts += _compared(study)
    if failed:
        rows = [[str(point), _short(words, 400)] for point, words in list(failed.items())[:_SHOWN]]
        more = len(failed) - len(rows)
        parts += [
            "<h2>Failed points</h2>",
            _table(("point", "why"), rows),
            f"<p>and {more} more</p>" if more else "",
        ]
    content = (
        f'<!DOCTYPE html>\n<html lang="en"><head><meta charset="utf-8"><title>{escape(str(facts["scenario"]))}</title>'
        f"<style>{_STYLE}</style></head>\n<body>\n" + "\n".join(parts) + "\n</body></html>\n"
    )
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        with replacing(path) as file:
            file.write(content.encode())
    except OSError as error:
        raise VdfmuError(f"cannot write {path}: {error.strerror or error}") from None
    return path


def _compared(study: Sweep) -> Iterable[str]:
    """Return how far points of the batch engine are from the runs of the FMUs, as far as they were compared."""
    columns = [column for column in study.columns if column.startswith("to_fmu[")]
    if not columns:
        return
    table = np.array([study["point"], *(study[column] for column in columns)], dtype=float).T
    rows = table[np.isfinite(table).all(axis=1)]
    yield "<h2>Batch engine and FMUs</h2>"
    yield "<p>Largest difference of a recorded signal, by unit, at points that both ran.</p>"
    heads = [column.removeprefix("to_fmu") for column in columns]
    yield _table(("point", *heads), [[f"{row[0]:.0f}", *(f"{x:.2g}" for x in row[1:])] for row in rows])


def _of_measure(study: Sweep, name: str) -> Iterable[str]:
    """Return worst point, indices and figures of a measure, as far as there are any."""
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
            heads = list(found.values)
            yield _table(
                ("axis", *heads), [[axis, *(row.get(h, "") for h in heads)] for axis, row in found.rows()]
            )
    except UsageError as error:
        yield f"<p>{escape(str(error))}</p>"


def _table(heads: Sequence[str], rows: Iterable[Sequence[str]]) -> str:
    head = "".join(f"<th>{escape(one)}</th>" for one in heads)
    lines = ["".join(f"<td{_kind(one) if heads else ''}>{escape(one)}</td>" for one in row) for row in rows]
    return f"<table><tr>{head}</tr>\n" + "\n".join(f"<tr>{line}</tr>" for line in lines) + "\n</table>"


def _kind(text: str) -> str:
    return ' class="number"' if re.fullmatch(r"-?[\d.]+(e[+-]?\d+)?( ± .*)?", text) else ""


def _unit(unit: str) -> str:
    return f" [{unit}]" if unit else ""


def _short(text: str, most: int = 160) -> str:
    return text if len(text) <= most else f"{text[: most - 2]} …"
