"""Runs in folders: one read for a page, all listed in ``index.html``."""

from __future__ import annotations

import os
from collections import Counter
from collections.abc import Mapping
from contextlib import suppress
from datetime import UTC, datetime
from html import escape
from pathlib import Path
from typing import Any, NamedTuple
from urllib.parse import quote

from vdfmu.base.errors import UsageError, VdfmuError
from vdfmu.base.files import write_whole
from vdfmu.base.page import page, table
from vdfmu.base.text import amount
from vdfmu.engine.linear.growth import Poses
from vdfmu.engine.results.folder import PAGE, PARTIAL
from vdfmu.engine.results.formats import result_files
from vdfmu.engine.results.results import Results
from vdfmu.engine.results.verdict import STATES, headline_of, state_of
from vdfmu.study.report.scripts import look
from vdfmu.study.run.summary_keys import read_summary

NAME = PAGE


class ShownRun(NamedTuple):
    """A run that a page shows."""

    name: str
    results: Results
    summary: Mapping[str, Any]
    package: Path
    """Its ``system.ssp``; a diagram needs it."""
    poses: Poses | None = None
    """Its loops, if this process made it."""
    program: Mapping[str, Any] | None = None
    """Its simulation, see `vdfmu.study.report.simulation.keep_program`, if this process made it."""


def _run_folders(folder: Path) -> list[Path]:
    """Return the folders of runs in a folder, with ``partial`` folders of failed runs."""
    files = (*folder.glob("*/summary.json"), *folder.glob(f"*/{PARTIAL}/summary.json"))
    return sorted(file.parent for file in files)


def newest_run(folder: Path) -> Path:
    """Return the folder of the newest run in a folder; UsageError without any."""
    folders = sorted(_run_folders(folder), key=lambda path: (path / "summary.json").stat().st_mtime)
    if not folders:
        raise UsageError(f"{folder} must hold results of a run. Name another folder, or run 'vdfmu run tracking'.")
    return folders[-1]


def run_folder(folder: Path) -> Path:
    """Return the folder of a run; the ``partial`` folder in it if the run failed and no other run is there."""
    partial = folder / PARTIAL
    return partial if not (folder / "summary.json").exists() and (partial / "summary.json").exists() else folder


def read_run(folder: Path) -> ShownRun:
    """Return the run in a folder, see `run_folder`; UsageError without results."""
    folder = run_folder(folder)
    tables = [folder / name for name in result_files(folder)]
    results_file = next((file for file in reversed(tables) if file.exists()), tables[0])
    for file in (folder / "summary.json", results_file):
        if file.exists():
            _require_file(file)
    summary = read_summary(folder / "summary.json")
    results = Results.read(results_file)
    if not len(results):
        raise UsageError(f"{folder}: results must have rows to show, got 0 rows.")
    package = folder / "system.ssp"
    package = package if package.exists() else Path(summary.get("package", ""))
    return ShownRun(folder.resolve().name, results, summary, package)


def _require_file(file: Path) -> None:
    """UsageError for a folder, pipe or device, whose content may be endless."""
    if not file.is_file():
        raise UsageError(f"{file} must be a file, got a folder, a pipe or a device.")


def is_gallery(folder: Path) -> bool:
    """Whether a folder holds folders of runs, and no run itself."""
    return not (folder / "summary.json").exists() and any(run.name != PARTIAL for run in _run_folders(folder))


def write_gallery(folder: Path, path: Path) -> Path:
    """Write the list of all runs in a folder, with links and verdicts; return its path."""
    write_whole(path, [gallery_page(folder, path.parent)])
    return path


def gallery_page(folder: Path, place: Path) -> bytes:
    """Return the list of runs in a folder, newest first, by their summaries alone. Links are relative to `place`."""
    runs, states, problems = list[tuple[float, list[str]]](), Counter[str](), list[str]()
    for run in _run_folders(folder):
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
    about = f"{amount(len(runs), 'run')}{f': {counts}' if counts else ''}"
    return page(f"Runs in {folder.resolve().name}", about, f'<div class="wide">{body}</div>', 84, look())


def _row(folder: Path) -> tuple[float, str, list[str]]:
    """Return time [s] and state of a run, and its cells after the link; VdfmuError for a broken summary."""
    file = folder / "summary.json"
    stamp = file.stat().st_mtime
    _require_file(file)
    summary = read_summary(file)
    with suppress(ValueError):  # not a date
        stamp = datetime.fromisoformat(summary.get("date", "")).timestamp()
    state = state_of(summary)
    names = [summary[key] for key in ("scenario", "robot") if summary.get(key)] or [summary.get("system", "system")]
    date = datetime.fromtimestamp(stamp, UTC).strftime("%Y-%m-%d %H:%M UTC")
    verdict = f'<span class="verdict {state}">{escape(headline_of(summary))}</span>'
    return stamp, state, [verdict, escape(" on ".join(names)), date]


def _link(folder: Path, place: Path, name: str) -> str:
    """Return a link to the page of a run or a study; without a page, to its folder."""
    target = folder / NAME if (folder / NAME).is_file() else folder
    address = quote(os.fsencode(Path(os.path.relpath(target.resolve(), place.resolve())).as_posix()))
    return f'<a href="{address}">{escape(name)}</a>'
