"""Other importers, each in a separate process."""

from __future__ import annotations

import signal
from collections.abc import Callable, Mapping, Sequence
from importlib.metadata import PackageNotFoundError, version
from typing import Any

from vdfmu.base.process import Child

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


def ask(run: Callable[..., Any], *, timeout: float = 600.0, **arguments: Any) -> Any:
    """Return what a function of :mod:`benchmarks.importer_worker` returns in a separate process, arrays as lists.

    Raises
    ------
    ImporterError
        With the importer's own words, or what is known of its end if it had none.
    """
    child = Child("benchmarks.importer_worker", limit=timeout)
    child.send((run, arguments))
    try:
        answer = child.take()
    except EOFError:
        answer = None
    code, _, _ = child.end()
    how = signal.strsignal(-code) if code < 0 else f"exit code {code}"
    if child.late:
        raise ImporterError(f"no end after {timeout:g} s", crashed=True)
    if answer is None:
        raise ImporterError(f"the process ended: {how}", crashed=True)
    if "error" in answer:
        raise ImporterError(answer["error"])
    if code:
        raise ImporterError(f"the process ended after the run: {how}", crashed=True)
    return answer["result"]


class ImporterError(RuntimeError):
    """An importer refused or crashed; `crashed` tells which."""

    def __init__(self, message: str, *, crashed: bool = False) -> None:
        super().__init__(message)
        self.crashed = crashed
