"""What the reader of a file of another tool needs, and what the file may unpack to."""

from __future__ import annotations

from importlib import import_module
from pathlib import Path
from types import ModuleType

from vdfmu.base.errors import UsageError

LEAST, RATIO = 256 * 2**20, 20
"""Bytes that any file may unpack to, and how many times its size more may be: logs of float64 shrink 2 to 4 times."""
COUNT = 10_000
"""Most variables of a file."""


class UnpackBudget:
    """Bytes and variables of a file, counted before memory is taken for them."""

    def __init__(self, path: Path) -> None:
        self.path, self.count, self.left = path, 0, max(LEAST, RATIO * path.stat().st_size)
        self._limit = self.left

    def spend(self, size: int, count: int = 0) -> None:
        """Count bytes and variables; UsageError beyond the limit."""
        self.left -= size
        self.count += count
        if self.left < 0:
            got = f"{(self._limit - self.left) / 2**20:.0f} MiB or more"
            raise self.refused(f"unpack to at most {self._limit / 2**20:.0f} MiB", got, "Save a shorter part of it")
        if self.count > COUNT:
            raise self.refused(f"have at most {COUNT} variables", "more", "Save fewer of them")

    def refused(self, must: str, got: str, way: str) -> UsageError:
        """Return the error of a file that is not as it must be."""
        return UsageError(f"{self.path}: the file must {must}, got {got}. {way}.")


def imported(what: str, package: str, extra: str, *modules: str) -> tuple[ModuleType, ...]:
    """Return modules of a package that a format needs; UsageError if it is not installed."""
    try:
        return tuple(import_module(module) for module in modules)
    except ImportError as error:
        raise UsageError(
            f"{what} needs the package {package}, which cannot be imported: {error}. Install it with "
            f"'pip install vdfmu[{extra}]'. The results of a run can be CSV, which needs no package: --format csv."
        ) from None
