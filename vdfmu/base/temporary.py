"""Temporary folders that no signal leaves behind."""

from __future__ import annotations

import tempfile
from collections.abc import Generator
from contextlib import contextmanager, suppress

from vdfmu.base.interrupt import InterruptGuard


@contextmanager
def temporary_folder(prefix: str) -> Generator[str]:
    """Make a temporary folder, and remove it in the end, whenever Ctrl-C comes: what cannot be removed stays.

    Python's own leaves a folder after an interrupt between its making and the note to remove it, and by one during
    the removal; and its first search for a place leaves a trial file. OSError if there is no place.
    """
    made = None
    try:
        with InterruptGuard():
            made = tempfile.TemporaryDirectory(prefix=prefix, ignore_cleanup_errors=True)
        yield made.name
    finally:
        if made is not None:
            try:
                with InterruptGuard():
                    _remove(made)
            except KeyboardInterrupt:  # it may have come before the guard
                _remove(made)
                raise


def _remove(folder: tempfile.TemporaryDirectory[str]) -> None:
    """Remove a folder; twice, since a passing error, which ends the first try, leaves the rest."""
    for _ in range(2):
        with suppress(OSError):
            folder.cleanup()
