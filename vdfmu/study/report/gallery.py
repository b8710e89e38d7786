"""``index.html`` of a folder of results: all its runs as cards with a picture of the arm and its path, sortable.

It is written anew from what is in the folder, by ``vdfmu report results``: no run writes to it, so that runs at the
same time cannot be in each other's way, and a deleted run is gone from it.
"""

from __future__ import annotations

import csv
import os
from collections.abc import Iterator, Mapping, Sequence
from contextlib import suppress
from datetime import UTC, datetime
from html import escape
from pathlib import Path
from typing import Any, NamedTuple
from urllib.parse import quote

import numpy as np

from vdfmu.base.arrays import Floats
from vdfmu.base.errors import VdfmuError
from vdfmu.base.files import write_whole
from vdfmu.base.measure import coherent, quantity
from vdfmu.base.page import page
from vdfmu.engine.results.folder import PARTIAL
from vdfmu.engine.results.formats import result_files
from vdfmu.engine.results.results import Results
from vdfmu.engine.results.verdict import FAILED, STATES, line_of, state_of
from vdfmu.study.report.page import NAME
from vdfmu.study.report.scripts import GALLERY, look, scripts_of
from vdfmu.study.report.shapes import Chain
from vdfmu.study.report.shown_run import run_folders
from vdfmu.study.run.summary_keys import read_summary

INDEX = "index.html"
_TIMES = 40
"""Rows of a run from which its picture is drawn."""
_END = 1 << 16
"""Bytes at the end of a file in which its last row is."""
_WIDE, _HIGH = 320, 200
"""Size of a picture [px]."""
_EYE = np.array([0.95, -1.25, 0.62])
"""Where the eye is, of an arm whose z axis points up: as in the perspective of ``web/scene.js``."""


class RunCard(NamedTuple):
    """A run of a gallery."""

    name: str
    page: str
    """Address of its page from the folder, or of its own folder."""
    about: Sequence[str]
    """Lines: scenario and robot, or system; date."""
    verdict: str
    state: str
    """Of the verdict; both are empty for a run without one."""
    numbers: Mapping[str, float]
    """By which cards are sorted: ``tool`` error [m], ``joint`` of the worst joint [rad, m], ``date`` in s."""
    shown: Sequence[str]
    """Lines of numbers."""
    picture: str


def is_gallery(folder: Path) -> bool:
    """Whether a folder is none of a run, but has runs in it."""
    return not (folder / "summary.json").exists() and any(one.name != PARTIAL for one in run_folders(folder))


def write_gallery(folder: Path, path: Path | None = None) -> Path:
    """Write the page of all runs in a folder, default ``index.html`` in it."""
    path = folder / INDEX if path is None else path
    write_whole(path, [gallery_page(folder, path.parent)])
    return path


def gallery_page(folder: Path, place: Path | None = None) -> bytes:
    """Return the page of all runs in a folder, whose links are those of a file in the folder `place`."""
    found, problems = list[RunCard](), list[str]()
    for run in run_folders(folder):
        name = run.relative_to(folder).as_posix()
        try:
            found.append(entry_of(run, folder if place is None else place, name))
        except FileNotFoundError:
            continue  # deleted in the meantime
        except (VdfmuError, OSError) as error:
            problems.append(f"{name}: {str(error).splitlines()[0]}")
    found.sort(key=lambda entry: -entry.numbers["date"])
    keys = {"date": "newest", "name": "name", "verdict": "failed first", "tool": "tool error", "joint": "worst joint"}
    options = "".join(f'<option value="{key}">{words}</option>' for key, words in keys.items())
    made = [file.parent.name for file in sorted(folder.glob("*/sweep.json")) if (file.parent / NAME).is_file()]
    studies = [f'<a href="{_address(folder / name / NAME, place or folder)}">{escape(name)}</a>' for name in made]
    notes = f"<p>Studies: {', '.join(studies)}</p>" if made else ""
    notes += "".join(f"<p class=note>Not shown: {escape(text)}</p>" for text in problems)
    body = f"""<div class="bar"><label class="choice">Sort by <select id="sort">{options}</select></label>
<label class="choice">Show <input id="find" type="search" placeholder="part of a name"></label>
<span id="count" role="status"></span></div>
<ul class="gallery">{"".join(map(_card, found))}</ul>{notes}"""
    counts = {state: sum(entry.state == state for entry in found) for state in STATES}
    states = ", ".join(f"{count} {state}" for state, count in counts.items() if count)
    about = f"{len(found)} run{'' if len(found) == 1 else 's'}{f': {states}' if states else ''}"
    return page(f"Runs in {folder.resolve().name}", about, body, 84, look("gallery.css"), scripts=scripts_of(GALLERY))


def entry_of(folder: Path, place: Path, name: str) -> RunCard:
    """Return the card of the run in a folder, with its address from `place`; VdfmuError if it cannot be read."""
    file = folder / "summary.json"
    stamp = file.stat().st_mtime
    summary = read_summary(file)
    with suppress(ValueError):  # of a date that is none
        stamp = datetime.fromisoformat(summary.get("date", "")).timestamp()
    state, numbers, shown = state_of(summary), {"date": stamp}, list[str]()
    figures: Mapping[str, Any] = summary.get("key_figures") or {}
    if "tool_error" in figures:
        numbers["tool"] = figures["tool_error"]["value"]
        shown.append(f"tool error {quantity(numbers['tool'], 'm')}")
    errors: Sequence[float] = summary.get("max_position_error_deg") or ()
    if errors:
        worst = int(np.argmax(errors))
        unit = (summary.get("position_units") or ["deg"] * len(errors))[worst]
        numbers["joint"] = errors[worst] * coherent(unit)[1]
        shown.append(f"joint {worst + 1} worst, {quantity(errors[worst], unit)}")
    shown = shown if state in ("", FAILED) else []  # else the verdict has these numbers
    try:
        picture = picture_of(folder, summary)
    except (VdfmuError, OSError, ValueError, csv.Error) as error:  # ValueError: no text, or a text for a number
        picture = _letter(name)
        shown.append(f"Results cannot be read: {str(error).splitlines()[0]}")
    page_of = folder / NAME if (folder / NAME).is_file() else folder
    about = " on ".join(filter(None, (str(summary.get("scenario") or ""), str(summary.get("robot") or ""))))
    date = datetime.fromtimestamp(stamp, UTC).strftime("%Y-%m-%d %H:%M UTC")
    return RunCard(
        name, _address(page_of, place), (about or str(summary.get("system", "system")), date),
        line_of(summary), state, numbers, shown, picture,
    )  # fmt: skip


def _address(file: Path, place: Path) -> str:
    return quote(Path(os.path.relpath(file.resolve(), place.resolve())).as_posix())


def _card(entry: RunCard) -> str:
    rank = -STATES.index(entry.state) if entry.state else ""
    keys = {"name": entry.name, "verdict": rank, **entry.numbers}
    data = " ".join(f'data-{key}="{escape(str(value))}"' for key, value in keys.items())
    lines = "".join(f"<p>{escape(line)}</p>" for line in (*entry.shown, *entry.about))
    return (
        f'<li {data}><div class="card"><a href="{escape(entry.page)}">{entry.picture}<h2>{escape(entry.name)}</h2>'
        f'<p class="{entry.state}">{escape(entry.verdict)}</p>{lines}</a></div></li>'
    )


def picture_of(folder: Path, summary: Mapping[str, Any]) -> str:
    """Return a drawing of the arm of a run at its start and end, with the path of its tool; else its first letter.

    VdfmuError, OSError, ValueError or csv.Error if its results cannot be read.
    """
    plain = _letter(folder.parent.name if folder.name == PARTIAL else folder.name)
    if "arm" not in summary:
        return plain
    chain = Chain(summary["arm"])
    q = _sampled(folder, [f"plant.q[{i + 1}]" for i in range(chain.n)])
    if q is None or not np.isfinite(q).all():
        return plain
    points = np.array([chain.points(row) for row in q])
    right, above = seen_along(chain.up)
    flat = np.stack([points @ right, -(points @ above)], axis=-1)  # (rows, frames, 2)
    low, high = flat.reshape(-1, 2).min(axis=0), flat.reshape(-1, 2).max(axis=0)
    scale = min((_WIDE - 60) / max(high[0] - low[0], 1e-9), (_HIGH - 44) / max(high[1] - low[1], 1e-9))
    flat = (flat - (low + high) / 2.0) * scale + [_WIDE / 2.0, _HIGH / 2.0]
    joints = "".join(f'<circle cx="{x:.1f}" cy="{y:.1f}" r="4"/>' for x, y in flat[-1][1:-1])
    x, y = flat[-1][0]
    return (
        f'<svg viewBox="0 0 {_WIDE} {_HIGH}" aria-hidden="true"><path class="arm start" d="{_line(flat[0])}"/>'
        f'<path class="base arm" d="M{x - 14:.1f} {y + 4:.1f}h28"/><path class="arm" d="{_line(flat[-1])}"/>'
        f'<path class="path" d="{_line(flat[:, -1])}"/>{joints}</svg>'
    )


def seen_along(up: Floats) -> tuple[Floats, Floats]:
    """Return the directions in {I} that point right and up in a picture, (3,) each, of an arm on a floor below `up`."""
    axis, cosine = np.cross([0.0, 0.0, 1.0], up), up[2]
    if cosine < -1.0 + 1e-12:  # half a turn around y, as three.js makes it
        eye = _EYE * [-1.0, 1.0, -1.0]
    else:  # the shortest turn of z to `up`, by Rodrigues
        eye = cosine * _EYE + np.cross(axis, _EYE) + axis * (axis @ _EYE) / (1.0 + cosine)
    right, eye = np.cross(up, eye), eye / np.linalg.norm(eye)
    right /= np.linalg.norm(right)
    return right, np.cross(eye, right)


def _letter(name: str) -> str:
    text = f'<text x="160" y="108">{escape(name[:1].upper())}</text>'
    return f'<svg viewBox="0 0 {_WIDE} {_HIGH}" aria-hidden="true">{text}</svg>'


def _line(points: Floats) -> str:
    return "M" + "L".join(f"{x:.1f} {y:.1f}" for x, y in points)


def _sampled(folder: Path, names: Sequence[str]) -> Floats | None:
    """Return some rows of signals, (m, signals), the first and the last among them; None if one was not recorded.

    Of a CSV file these rows alone are read.
    """
    table = next((file for name in result_files() if (file := folder / name).is_file()), None)
    if table is None:
        return None
    if table.suffix == ".csv":
        rows = list(_rows_of(table, names))
        return np.array(rows) if len(rows) > 1 else None
    results = Results.read(table)
    if any(name not in results.names for name in names) or len(results) < 2:
        return None
    chosen = np.linspace(0, len(results) - 1, _TIMES).round().astype(int)
    return np.stack([results[name][chosen] for name in names], axis=1)


def _rows_of(table: Path, names: Sequence[str]) -> Iterator[list[float]]:
    with table.open("rb") as file:
        heads = next(csv.reader([file.readline().decode()]))
        if any(name not in heads for name in names):
            return
        file.readline()  # units of measurement
        columns, begin, size = [heads.index(name) for name in names], file.tell(), table.stat().st_size
        lines = list[bytes]()
        for k in range(_TIMES - 1):
            file.seek(begin + (size - begin) * k // (_TIMES - 1))
            if k:
                file.readline()  # the rest of a row
            lines.append(file.readline())
        file.seek(max(begin, size - _END))
        lines.append(file.read().splitlines()[-1] if size > begin else b"")
    for line in lines:
        cells = line.decode().split(",")
        if len(cells) == len(heads):  # else the file ends within the row
            yield [float(cells[column]) for column in columns]
