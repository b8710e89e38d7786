"""Ctrl-C within a guard waits for the end of its block."""

import signal
from contextlib import nullcontext

import pytest

from vdfmu.base.interrupt import InterruptGuard


def kept(guard):
    with guard:
        yield


@pytest.mark.parametrize("interrupted", [False, True])
def test_a_guard_of_a_generator_that_nobody_ends_leaves_other_guards_as_they_are(interrupted):
    """Its block may have begun within another, which has ended since and has given the handler back."""
    outer, generator = InterruptGuard(), kept(InterruptGuard())
    steps = []
    with pytest.raises(KeyboardInterrupt) if interrupted else nullcontext():
        with outer:
            next(generator)
            if interrupted:
                signal.raise_signal(signal.SIGINT)
    with pytest.raises(KeyboardInterrupt), InterruptGuard():
        signal.raise_signal(signal.SIGINT)
        steps.append("the rest of the block")
    assert steps
    generator.close()
    assert signal.getsignal(signal.SIGINT) is signal.default_int_handler
