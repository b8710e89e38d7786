"""Exceptions of the package, and its logger."""

from __future__ import annotations

import errno
import logging
from collections.abc import Sequence
from enum import StrEnum
from typing import Any

LOG = logging.getLogger("vdfmu")
"""Progress in detail, shown by ``--verbose``. Warnings are always shown."""
_SHOWN = 20
"""Largest number of problems in an error's message; `problems` has all of them."""
_DISK = (errno.EIO, errno.EACCES, errno.ENOSPC, errno.EDQUOT, errno.EROFS, errno.EMFILE, errno.ENFILE)


class VdfmuError(Exception):
    """Base of every error that the package raises on purpose."""


class _ProblemsError(VdfmuError):
    """An error that lists all problems, each as one or more sentences with its place."""

    def __init__(self, problems: Sequence[str] | str) -> None:
        self.problems: list[str] = [problems] if isinstance(problems, str) else list(problems)
        super().__init__(self.problems)

    def __str__(self) -> str:
        more = len(self.problems) - _SHOWN
        return "\n".join([*self.problems[:_SHOWN], *([f"and {more} more"] if more > 0 else [])])


class ModelError(_ProblemsError):
    """A robot or scenario file that cannot be used. `problems` lists all of its faults."""


class SspError(_ProblemsError):
    """A system description that cannot be run. `problems` lists all of its faults, `notes` all remarks."""

    problems: list[Any]
    """Each is a `vdfmu.engine.rules.Finding`, and so are the notes."""
    notes: Sequence[Any] = ()


class KernelError(VdfmuError):
    """Equations that cannot be traced, compiled or called."""


class UnitError(VdfmuError):
    """A unit that is declared wrongly, or whose methods cannot be run or traced."""


class FmuError(VdfmuError):
    """An FMU that cannot be built or used."""


class StorageError(FmuError):
    """A file cannot be written: a full disk, a folder without the right to write."""


def disk_error(error: BaseException | None) -> OSError | None:
    """Return the cause of an error if it is the disk or too many open files rather than a fault in a file."""
    while error is not None and not (isinstance(error, OSError) and error.errno in _DISK):
        error = error.__cause__ or error.__context__
    return error


class UsageError(VdfmuError):
    """A wrong option, an unknown name or an unknown parameter."""


SHORTEST_STEP = "the internal step reached its minimum"
"""Part of the message of a unit whose solver gives up. FMI transmits the failure only as this text."""


class FailureKind(StrEnum):
    """Why a co-simulation failed."""

    COMPONENT = "component"
    """A component's call failed for a reason other than those below."""
    SOLVER = "solver"
    """The internal step of a component's solver reached its minimum."""
    NOT_FINITE = "not finite"
    """An output is infinite or NaN."""
    UNSTABLE = "unstable"
    """A loop is unstable."""
    COUPLING = "coupling"
    """The values of coupled components do not agree, or would need a step shorter than the shortest allowed."""
    TIME_LIMIT = "time limit"
    """A component, or a point of a study, took longer than it may."""
    LOST = "lost process"
    """A component's process ended."""


class CosimError(VdfmuError):
    """A co-simulation that failed.

    Attributes: the component `unit`, the failed FMI `call` such as ``doStep``, its simulated `time` [s], the `reason`
    (a message of the unit), `results` recorded before the failure, and the `kind` of failure.
    """

    def __init__(
        self, unit: str, call: str, time: float, reason: str, results: Any = None, kind: str = FailureKind.COMPONENT
    ) -> None:
        self.unit, self.call, self.time, self.reason, self.results = unit, call, time, reason, results
        self.kind = FailureKind(kind)
        super().__init__(unit, call, time, reason, results, kind)

    @property
    def facts(self) -> tuple[str, str, float, str, None, str]:
        """Arguments to construct the same error in another process, without results."""
        return self.unit, self.call, self.time, self.reason, None, str(self.kind)

    @property
    def sentence(self) -> str:
        """Headline that says when, where and why the run ended."""
        return f"run ended at {self.time:.3g} s in {self.unit}: {' '.join(self.reason.split())}"

    def __str__(self) -> str:
        return f"{self.unit} failed at t = {self.time:.9g} s in {self.call}: {self.reason}"
