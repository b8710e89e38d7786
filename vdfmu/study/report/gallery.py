"""``index.html`` of a folder of results: a list of its runs with links and verdicts.

``vdfmu report results`` writes it anew from the summaries in the folder. No run writes to it. Results, packages and
pages of the runs are not opened.
"""

from __future__ import annotations

import os
from collections import Counter
from contextlib import suppress
from datetime import UTC, datetime
from html import escape
from pathlib import Path
from urllib.parse import quote

from vdfmu.base.errors import UsageError, VdfmuError
from vdfmu.base.files import write_whole
from vdfmu.base.page import page, table
from vdfmu.engine.results.folder import PARTIAL
from vdfmu.engine.results.verdict import STATES, line_of, state_of
from vdfmu.study.report.page import NAME
from vdfmu.study.report.scripts import look
from vdfmu.study.report.shown_run import run_folders
from vdfmu.study.run.summary_keys import read_summary

INDEX = "index.html"


def is_gallery(folder: Path) -> bool:
    """Whether a folder has no run itself, but runs in its folders."""
    return not (folder / "summary.json").exists() and any(run.name != PARTIAL for run in run_folders(folder))


def write_gallery(folder: Path, path: Path | None = None) -> Path:
    """Write the list of all runs in a folder, default ``index.html`` in it."""
    path = folder / INDEX if path is None else path
    write_whole(path, [gallery_page(folder, path.parent)])
    return path


def gallery_page(folder: Path, place: Path | None = None) -> bytes:
    """Return the list of all runs in a folder, newest first. Links are relative to the folder `place`."""
    place = folder if place is None else place
    runs, states, problems = list[tuple[float, list[str]]](), Counter[str](), list[str]()
    for run in run_folders(folder):
        name = run.relative_to(folder).as_posix()
        try:
            stamp, state, cells = _row(run)
        except FileNotFoundError:
            continue  # deleted in the meantime
        except (VdfmuError, OSError) as error:
            problems.append(f"{name}: {str(error).splitlines()[0]}")
            continue
        runs.append((stamp, [_link(run, place, name), *cells]))
        states[state] += 1
    runs.sort(key=lambda row: -row[0])
    studies = [file.parent for file in sorted(folder.glob("*/sweep.json")) if (file.parent / NAME).is_file()]
    body = table(("run", "verdict", "system", "date"), (cells for _, cells in runs), ("", "", "", ""))
    body += f"<p>Studies: {', '.join(_link(each, place, each.name) for each in studies)}</p>" if studies else ""
    body += "".join(f"<p class=note>Not shown: {escape(text)}</p>" for text in problems)
    counts = ", ".join(f"{states[state]} {state}" for state in STATES if states[state])
    about = f"{len(runs)} run{'' if len(runs) == 1 else 's'}{f': {counts}' if counts else ''}"
    return page(f"Runs in {folder.resolve().name}", about, f'<div class="wide">{body}</div>', 84, look())


def _row(folder: Path) -> tuple[float, str, list[str]]:
    """Return time [s] and state of a run, and its cells behind the link; VdfmuError if its summary is broken."""
    file = folder / "summary.json"
    stamp = file.stat().st_mtime
    if not file.is_file():
        raise UsageError(f"{file} must be a file, got a folder, a pipe or a device.")
    summary = read_summary(file)
    with suppress(ValueError):  # not a date
        stamp = datetime.fromisoformat(summary.get("date", "")).timestamp()
    state = state_of(summary)
    names = [summary[key] for key in ("scenario", "robot") if summary.get(key)] or [summary.get("system", "system")]
    date = datetime.fromtimestamp(stamp, UTC).strftime("%Y-%m-%d %H:%M UTC")
    verdict = f'<span class="verdict {state}">{escape(line_of(summary))}</span>'
    return stamp, state, [verdict, escape(" on ".join(names)), date]


def _link(folder: Path, place: Path, name: str) -> str:
    """Return a link to the page of a run or a study, or to its folder if it has no page."""
    target = folder / NAME if (folder / NAME).is_file() else folder
    address = quote(os.fsencode(Path(os.path.relpath(target.resolve(), place.resolve())).as_posix()))
    return f'<a href="{address}">{escape(name)}</a>'
