"""Other importers, each in a separate process."""

from __future__ import annotations

import json
import signal
import subprocess
import sys
import tempfile
from collections.abc import Mapping, Sequence
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.importer_worker import MARK

PACKAGES = {"ecos": ("ecospy", "tbb"), "libcosim": ("libcosimpy",)}
"""Importer to the Python packages that install it."""


def missing(importer: str, packages: Mapping[str, Sequence[str]] = PACKAGES) -> str:
    """Say what is not installed of an importer, of those that need `packages`; empty if nothing."""
    for package in packages[importer]:
        try:
            version(package)
        except PackageNotFoundError:
            return f"{importer} needs {package}, which is not installed (pip install .[test])"
    return ""


def ask(request: Mapping[str, Any], timeout: float = 600.0) -> dict[str, Any]:
    """Let a process of its own run what is asked for.

    Parameters
    ----------
    request : mapping
        ``run``: a key of :data:`benchmarks.importer_worker.RUNNERS`; ``path``, ``step`` [s] and ``steps`` of the run;
        ``importer``, ``signals``, ``out``, ``inputs``, ``parameter_set`` where the run takes them.
    timeout : float [s]

    Returns
    -------
    dict
        Its answer.

    Raises
    ------
    ImporterError
        With the importer's own words, or what is known of its end if it had none.
    """
    try:
        done = subprocess.run(
            [sys.executable, "-m", "benchmarks.importer_worker", json.dumps(dict(request))], timeout=timeout,
            capture_output=True, text=True, check=False, cwd=Path(__file__).parents[1],
        )  # fmt: skip
    except subprocess.TimeoutExpired:
        raise ImporterError(f"no end after {timeout:g} s", crashed=True) from None
    answers = [line for line in done.stdout.splitlines() if line.startswith(MARK)]
    said = (done.stderr or done.stdout).strip()[-2000:]
    how = signal.strsignal(-done.returncode) if done.returncode < 0 else f"exit code {done.returncode}"
    if not answers:
        raise ImporterError(f"the process ended: {how}", crashed=True, said=said)
    answer = json.loads(answers[-1].removeprefix(MARK))
    if "error" in answer:
        raise ImporterError(answer["error"])
    if done.returncode != 0:
        raise ImporterError(f"the process ended after the run: {how}", crashed=True, said=said)
    return answer


def ask_rows(request: Mapping[str, Any], timeout: float = 600.0) -> np.ndarray:
    """Return the rows of a run with signals, (rows, signals); see :func:`ask`."""
    with tempfile.TemporaryDirectory(prefix="vdfmu-bench-") as folder:
        out = Path(folder) / "rows.npy"
        ask({**request, "out": str(out)}, timeout)
        return np.load(out)


class ImporterError(RuntimeError):
    """An importer refused or crashed; `crashed` tells which, `said` what it wrote last."""

    def __init__(self, message: str, *, crashed: bool = False, said: str = "") -> None:
        super().__init__(message)
        self.crashed = crashed
        self.said = said
