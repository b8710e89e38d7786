"""A few runs in one process, and that what they leave behind is seen."""

import mmap
import os

import pytest

from tests.hostile import runs


@pytest.mark.heavy
def test_a_few_runs_in_eight_threads_are_the_same_and_leave_nothing_behind(tmp_path):
    runs.threads(2, 0, tmp_path)
    runs.in_a_row(24, 0, tmp_path)


@pytest.mark.heavy
@pytest.mark.parametrize(("held", "words"), [("memory", "memory grows by"), ("file", "open and mapped files")])
def test_what_runs_leave_behind_is_seen(tmp_path, monkeypatch, held, words):
    """A run that keeps 1 MB, of which 4 MB are no fault, or a file open: 18 are after the warm-up."""
    simulate, kept = runs.simulate, []

    def leak(package, stop):
        kept.append(mmap.mmap(-1, 2**20) if held == "memory" else open(os.devnull))  # noqa: SIM115
        if held == "memory":  # pages that are new, where the heap may have room from before
            kept[-1].write(os.urandom(2**20))
        return simulate(package, stop=stop)

    monkeypatch.setattr(runs, "simulate", leak)
    with pytest.raises(AssertionError, match=words):
        runs.in_a_row(24, 0, tmp_path)
