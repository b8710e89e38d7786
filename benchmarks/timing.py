"""Best-of-k timing of several functions at once, in turns, so that drift of the machine hits all alike."""

from __future__ import annotations

import gc
import math
import os
import time
from collections.abc import Callable, Generator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from itertools import repeat
from typing import Any

import numpy as np

_clock = time.process_time if time.get_clock_info("process_time").resolution <= 1e-6 else time.perf_counter
"""Processor time, which other programs do not lengthen much; where it is too coarse, wall time."""


def processor_time() -> float:
    """Processor time of this process and of those that it started and awaited [s]."""
    times = os.times()
    return times.user + times.system + times.children_user + times.children_system


@dataclass
class Case:
    """One function to time.

    Attributes
    ----------
    name : str
    run : callable without arguments
    calls : int
        Calls in one sample.
    best : float [s]
        Least processor time of one call over all samples.
    samples : int
    spent : float [s]
        In all samples.
    """

    name: str
    run: Callable[[], Any]
    calls: int = 1
    best: float = math.inf
    samples: int = 0
    spent: float = 0.0

    def sample(self) -> None:
        """Time `calls` calls. The loop itself adds about 10 ns a call."""
        run = self.run
        began = _clock()
        for _ in repeat(None, self.calls):
            run()
        spent = _clock() - began
        self.best = min(self.best, spent / self.calls)
        self.samples += 1
        self.spent += spent


@contextmanager
def _no_garbage_collection() -> Generator[None]:
    enabled = gc.isenabled()
    gc.disable()
    try:
        yield
    finally:
        if enabled:
            gc.enable()


def measure(cases: Sequence[Case], rounds: int, *, batch: float = 2e-3, limit: float = 4.0) -> None:
    """Time all cases in turns: every round takes one sample of each.

    Parameters
    ----------
    rounds : int
        Samples of each case.
    batch : float [s]
        Least duration of a sample; a shorter function is called several times in it.
    limit : float [s]
        A case that would spend more than this in all gets fewer samples, but at least one.
    """
    with _no_garbage_collection():
        for case in cases:
            case.sample()  # also warms up
            if case.best < batch:
                case.calls = math.ceil(batch / case.best)
                case.best, case.samples = math.inf, 0
        for _ in range(rounds):
            for case in cases:
                if case.samples == 0 or case.spent + case.calls * case.best < limit:
                    case.sample()


@dataclass
class Clock:
    """Takes the processor time of a run block by block; give its :meth:`progress` to the run.

    A block is a hundredth of the run. Its least time over several runs is the same work without what other programs
    took meanwhile.

    Attributes
    ----------
    marks : list of (steps done, processor time)
    """

    marks: list[tuple[int, float]] = field(default_factory=list)

    def progress(self, done: int, total: int) -> None:
        """Note the time of the end of a block."""
        self.marks.append((done, time.process_time()))

    @property
    def blocks(self) -> np.ndarray:
        """Time of each block over the steps of the run [s]; their sum is the time of a step."""
        return np.diff([seconds for _, seconds in self.marks]) / self.marks[-1][0]
