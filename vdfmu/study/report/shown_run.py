"""Reads runs in folders for a page."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any, NamedTuple

from vdfmu.base.errors import UsageError
from vdfmu.engine.linear.growth import Poses
from vdfmu.engine.results.folder import PAGE, PARTIAL
from vdfmu.engine.results.formats import result_files
from vdfmu.engine.results.results import Results
from vdfmu.study.run.summary_keys import read_summary

NAME = PAGE


class ShownRun(NamedTuple):
    """A run that a page shows."""

    name: str
    results: Results
    summary: Mapping[str, Any]
    package: Path
    """The run's ``system.ssp``, which a diagram needs."""
    poses: Poses | None = None
    """The run's loops, if this process made the run."""
    program: Mapping[str, Any] | None = None
    """The run's simulation, see `vdfmu.study.report.simulation.keep_program`, if this process made the run."""


def run_folders(folder: Path) -> list[Path]:
    """Return the folders of runs in a folder, including ``partial`` folders of failed runs."""
    files = (*folder.glob("*/summary.json"), *folder.glob(f"*/{PARTIAL}/summary.json"))
    return sorted(file.parent for file in files)


def newest_run(folder: Path) -> Path:
    """Return the folder of the newest run in a folder; UsageError if there is none."""
    folders = sorted(run_folders(folder), key=lambda path: (path / "summary.json").stat().st_mtime)
    if not folders:
        raise UsageError(f"{folder} must hold results of a run. Name another folder, or run 'vdfmu run tracking'.")
    return folders[-1]


def run_folder(folder: Path) -> Path:
    """Return the folder of a run, or its ``partial`` folder if the run failed and there is no other run."""
    partial = folder / PARTIAL
    return partial if not (folder / "summary.json").exists() and (partial / "summary.json").exists() else folder


def read_run(folder: Path) -> ShownRun:
    """Return the run in a folder, see `run_folder`; UsageError without results."""
    folder = run_folder(folder)
    tables = [folder / name for name in result_files(folder)]
    results_file = next((file for file in reversed(tables) if file.exists()), tables[0])
    for file in (folder / "summary.json", results_file):
        if file.exists():
            require_file(file)
    summary = read_summary(folder / "summary.json")
    results = Results.read(results_file)
    if not len(results):
        raise UsageError(f"{folder}: results must have rows to show, got 0 rows.")
    package = folder / "system.ssp"
    package = package if package.exists() else Path(summary.get("package", ""))
    return ShownRun(folder.resolve().name, results, summary, package)


def require_file(file: Path) -> None:
    """Raise UsageError for a folder, pipe or device, whose content may be endless."""
    if not file.is_file():
        raise UsageError(f"{file} must be a file, got a folder, a pipe or a device.")


def is_gallery(folder: Path) -> bool:
    """Return whether a folder contains folders of runs, but no run itself."""
    return not (folder / "summary.json").exists() and any(run.name != PARTIAL for run in run_folders(folder))
