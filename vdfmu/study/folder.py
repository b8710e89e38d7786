"""The folder of a run's results: emptied of an earlier run, and filled even when the run fails."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from vdfmu.cosim import Interrupted, Results
from vdfmu.cosim.interrupt import InterruptGuard
from vdfmu.errors import CosimError, UsageError, VdfmuError
from vdfmu.study.json_text import to_json

__all__ = ["RUN_OUTPUTS", "SYSTEM_OUTPUTS", "keep", "make_empty", "write", "write_summary", "written"]

SYSTEM_OUTPUTS = ("results.csv", "signals.png", "summary.json")
"""Files that a run of a package writes, and replaces in the folder of an earlier one; no package is among them."""
RUN_OUTPUTS = (
    *SYSTEM_OUTPUTS,
    "container.fmu",
    "system.ssp",
    *(f"figure_{number}.png" for number in (7, 8, 10, 11, 13, 14)),
    "torques.png",
    "errors.png",
)
"""Files that the run of a scenario writes and replaces."""


def make_empty(folder: Path, outputs: Sequence[str]) -> None:
    """Make the folder of the results, without the files of an earlier run."""
    try:
        folder.mkdir(parents=True, exist_ok=True)
        for name in outputs:
            (folder / name).unlink(missing_ok=True)
    except OSError as error:
        raise UsageError(
            f"{folder}: cannot hold the results: {error}. Choose another folder with --out."
        ) from error


def written(folder: Path, outputs: Sequence[str]) -> list[str]:
    """Return the names of the files that a run has written."""
    return sorted(name for name in outputs if (folder / name).exists())


def write(results: Results, folder: Path) -> None:
    """Write rows and summary; Ctrl-C waits for them, and a second one does not."""
    with InterruptGuard() as guard:
        results.to_csv(folder / "results.csv")
        write_summary(results.summary, folder)
    if guard.pressed:
        raise Interrupted(float(results.time[-1]), results)


def write_summary(summary: Mapping[str, Any], folder: Path) -> None:
    """Write ``summary.json``."""
    path = folder / "summary.json"
    try:
        path.write_text(to_json(summary) + "\n", encoding="utf-8")
    except OSError as error:
        raise VdfmuError(
            f"{path}: cannot be written: {error}. Free space or choose another folder."
        ) from error


def keep(error: CosimError | Interrupted, folder: Path, summary: Mapping[str, Any]) -> None:
    """Write the rows that a failed run recorded, and why it ended."""
    results = error.results
    if results is not None:
        results.summary = {**summary, **results.summary, "error": str(error)}
        write(results, folder)
