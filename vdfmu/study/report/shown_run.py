"""A run that a page shows, read from its folder."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any, NamedTuple

from vdfmu.base.errors import UsageError
from vdfmu.engine.results.folder import PARTIAL
from vdfmu.engine.results.formats import result_files
from vdfmu.engine.results.results import Results
from vdfmu.study.run.summary_keys import read_summary


class ShownRun(NamedTuple):
    """A run that a page shows."""

    name: str
    results: Results
    summary: Mapping[str, Any]
    package: Path
    """Its ``system.ssp``; a missing one has no diagram."""


def run_folders(folder: Path) -> list[Path]:
    """Return the folders of runs in a folder, also of those that failed, which are in ``partial`` of another."""
    files = (*folder.glob("*/summary.json"), *folder.glob(f"*/{PARTIAL}/summary.json"))
    return sorted(file.parent for file in files)


def newest_run(folder: Path) -> Path:
    """Return the folder of the newest run in a folder; UsageError if there is none."""
    found = sorted(run_folders(folder), key=lambda path: (path / "summary.json").stat().st_mtime)
    if not found:
        raise UsageError(f"{folder}: has no results of a run. Say where they are, or run one: 'vdfmu run tracking'.")
    return found[-1]


def run_folder(folder: Path) -> Path:
    """Return the folder of a run, or, where there is only one that failed, that of this."""
    partial = folder / PARTIAL
    return partial if not (folder / "summary.json").exists() and (partial / "summary.json").exists() else folder


def read_run(folder: Path) -> ShownRun:
    """Return the run whose results are in a folder, see `run_folder`; UsageError if it has none."""
    folder = run_folder(folder)
    tables = [folder / name for name in result_files(folder)]
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
