"""The list of the runs in a folder, ``index.html``: links, verdicts and key figures."""

from __future__ import annotations

import os
from collections import Counter
from contextlib import suppress
from datetime import UTC, datetime
from html import escape
from pathlib import Path
from typing import NamedTuple
from urllib.parse import quote

from vdfmu.base.errors import VdfmuError
from vdfmu.base.files import write_whole
from vdfmu.base.page import page
from vdfmu.base.text import amount
from vdfmu.engine.results.verdict import STATES, outcome_of, state_of
from vdfmu.extras.compare.comparison import sortable
from vdfmu.study.report.scripts import look, scripts_of
from vdfmu.study.report.shown_run import NAME, require_file, run_folders
from vdfmu.study.run.summary_keys import Summary, read_summary


def write_gallery(folder: Path, path: Path) -> Path:
    """Write the list of all runs in a folder, with links and verdicts; return its path."""
    write_whole(path, [gallery_page(folder, path.parent)])
    return path


def gallery_page(folder: Path, place: Path) -> bytes:
    """Return the list of runs in a folder, newest first, from their summaries only. Links are relative to `place`."""
    runs, states, problems = list[_ListedRun](), Counter[str](), list[str]()
    for run in run_folders(folder):
        name = run.relative_to(folder).as_posix()
        try:
            runs.append(_row(run, _link(run, place, name)))
        except FileNotFoundError:
            continue  # deleted in the meantime
        except (VdfmuError, OSError) as error:
            problems.append(f"{name}: {str(error).splitlines()[0]}")
            continue
        states[state_of(runs[-1].summary)] += 1
    runs.sort(key=lambda row: -row.stamp)
    studies = [file.parent for file in sorted(folder.glob("*/sweep.json")) if (file.parent / NAME).is_file()]
    body = sortable(("run", "verdict", "system"), [row.cells for row in runs], [row.summary for row in runs], "date")
    body += f"<p>Studies: {', '.join(_link(each, place, each.name) for each in studies)}</p>" if studies else ""
    body += "".join(f"<p class=note>Not shown: {escape(text)}</p>" for text in problems)
    counts = ", ".join(f"{states[state]} {state}" for state in STATES if states[state])
    about = f"{amount(len(runs), 'run')}{f': {counts}' if counts else ''}"
    wide, script = f'<div class="wide">{body}</div>', scripts_of("gallery")
    return page(f"Runs in {folder.resolve().name}", about, wide, 84, look(), scripts=script)


class _ListedRun(NamedTuple):
    """A run of the list."""

    stamp: float
    """Its time [s]."""
    summary: Summary
    cells: list[str]
    """Link, verdict, system and date."""


def _row(folder: Path, link: str) -> _ListedRun:
    """Return the row of a run; VdfmuError for a broken summary."""
    file = folder / "summary.json"
    stamp = file.stat().st_mtime
    require_file(file)
    summary = read_summary(file)
    with suppress(ValueError):  # not a date
        stamp = datetime.fromisoformat(summary.get("date", "")).timestamp()
    names = [summary[key] for key in ("scenario", "robot") if summary.get(key)] or [summary.get("system", "system")]
    date = datetime.fromtimestamp(stamp, UTC).strftime("%Y-%m-%d %H:%M UTC")
    verdict = f'<span class="verdict {state_of(summary)}">{escape(outcome_of(summary))}</span>'
    return _ListedRun(
        stamp, summary, [link, verdict, escape(" on ".join(names)), f'<data value="{stamp!r}">{date}</data>']
    )


def _link(folder: Path, place: Path, name: str) -> str:
    """Return a link to the page of a run or a study, or to its folder if there is no page."""
    target = folder / NAME if (folder / NAME).is_file() else folder
    address = quote(os.fsencode(Path(os.path.relpath(target.resolve(), place.resolve())).as_posix()))
    return f'<a href="{address}">{escape(name)}</a>'
