"""The small FMUs and packages of `tests/engine`, and processes that were left behind."""

import os
from pathlib import Path

import pytest

from tests.engine.conftest import arm_package, built, fmus, pack, system, xml

__all__ = ["arm_package", "built", "federates", "fmus", "pack", "system", "xml"]


def federates_of(parent: int | None = None) -> dict[int, int]:
    """Return the federates' processes that a process has started, this one by default: number in the run to id."""
    processes = {}
    for folder in Path("/proc").glob("[0-9]*"):
        try:
            arguments = (folder / "cmdline").read_text().split("\0")
            status = (folder / "stat").read_text().rpartition(")")[2].split()
        except OSError:  # it has just ended
            continue
        if (
            "vdfmu.engine.federation.server" in arguments
            and status[0] != "Z"
            and int(status[1]) == (parent or os.getpid())
        ):
            memory = next(text for text in arguments if text.endswith("/memory"))
            processes[int(Path(memory).parent.name.removeprefix("federate_"))] = int(folder.name)
    return processes


@pytest.fixture
def federates():
    """Return `federates_of`; none of this process is left in the end."""
    yield federates_of
    assert federates_of() == {}
