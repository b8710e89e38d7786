"""File operations of commands that fail, one after another: nothing is lost, and the same command succeeds then."""

import pytest

from tests.hostile.disk import failed as fail
from tests.hostile.disk import prepared
from vdfmu.base.errors import VdfmuError

_QUICK = ("unit new",)
"""A command that compiles nothing."""


def failures(name: str, most: int) -> tuple[int, list[str]]:
    """Let operations of a command fail, evenly spread from the first to the last, which is a full disk for its results.

    Returns how many stopped it, and all faults found.
    """
    faults = prepared(name).faults
    stopped, problems = 0, []
    for i in range(most):
        try:
            fail(name, faults[i * (len(faults) - 1) // (most - 1)])
        except VdfmuError:
            stopped += 1
        except AssertionError as error:
            problems.append(str(error))
    return stopped, problems


@pytest.mark.parametrize("name", _QUICK)
def test_some_failures_of_the_disk_lose_nothing(name):
    stopped, problems = failures(name, 5)
    assert stopped and not problems


@pytest.mark.heavy
@pytest.mark.parametrize(
    ("name", "most"), [("run", 4), ("sweep, half done", 4), ("tune, more", 4), ("ssp", 4), ("ssp --reference", 8)]
)
def test_failures_of_the_disk_lose_nothing(name, most):
    """Of one command for each way of writing results; `make hostile` has all of them."""
    stopped, problems = failures(name, most)
    assert stopped and not problems
