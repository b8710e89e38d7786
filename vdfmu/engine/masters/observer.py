"""Taps of a run, which read its components at some rows, show rows to an observer, or delay them to real time."""

from __future__ import annotations

import gc
import math
import os
import platform
import time as clock
from array import array
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any, Protocol

import numpy as np

from vdfmu.base.arrays import Floats
from vdfmu.base.errors import UsageError
from vdfmu.engine.masters.exchange import Exchange
from vdfmu.engine.results.recorder import Tap
from vdfmu.engine.results.results import Results


class Observer(Protocol):
    """Receives rows of a run, which waits meanwhile. A class needs ``row``; the other members are optional."""

    wanted: Sequence[str]
    """Names of real signals that it receives, with ``*`` for any text; they need not exist. Default: all."""
    period: float
    """Shortest wall time between two rows [s]; 0, the default, for every row."""

    def begin(self, names: Sequence[str], about: Mapping[str, Any]) -> None:
        """Receive the names of the existing signals, and facts about the run."""
        ...

    def row(self, time: float, values: Floats) -> None:
        """Receive the values (k,) at a time [s]; the observer may keep the array."""
        ...

    def end(self, results: Results) -> None:
        """Receive all rows of the run, even if it failed."""
        ...


class Observed(Tap):
    """Shows rows to an observer, at most one per period."""

    def __init__(self, observer: Observer, exchange: Exchange, about: Mapping[str, Any]) -> None:
        names, self._memory, places = exchange.reals(getattr(observer, "wanted", ("*",)))
        getattr(observer, "begin", lambda names, about: None)(names, about)
        self._row, self._period, self._due = observer.row, getattr(observer, "period", 0.0), 0.0
        self._columns = np.array(places, np.intp)

    def due(self, k: int) -> float:
        """Return `k` if the period is over."""
        return k if clock.perf_counter() >= self._due else math.inf

    def take(self, k: int, time: float, components: Any) -> None:
        """Show the row."""
        self._row(time, self._memory.take(self._columns))
        self._due = clock.perf_counter() + self._period


_SPIN = 2e-4
"""Busy wait before a row is due [s], because sleeps rarely end later than this."""
_NAP = 0.1
"""Longest sleep [s], after which signals are checked."""


class Pace(Tap):
    """Delays rows until they are due. Within its block Python's garbage collection, which takes milliseconds, is off.

    `speed` is simulated time divided by wall time; 1 is real time. Rows are `step` [s] apart. The clock starts with the
    second row, because the first step loads code. `pressed` returns whether the user stops the run, which ends the
    wait.
    """

    def __init__(self, speed: float, step: float, pressed: Callable[[], bool] = lambda: False) -> None:
        if not 0.0 < speed < np.inf:
            raise UsageError(f"pace: expected a positive number of simulated seconds a second, got {speed:g}.")
        self._speed, self._interval, self._pressed = speed, step / speed, pressed
        self._began, self._late, self._over = 0.0, array("d"), 0
        self.waited = 0.0
        """Wall time spent waiting [s]."""

    def __enter__(self) -> None:
        self._collects = gc.isenabled()
        gc.disable()

    def __exit__(self, *_: object) -> None:
        if self._collects:
            gc.enable()

    def due(self, k: int) -> float:
        """Return `k`, because each row is needed."""
        return k

    def take(self, k: int, time: float, components: Any) -> None:
        """Wait until row `k` is due."""
        now = clock.perf_counter()
        if k < 2:
            self._began = now - k * self._interval
            return
        due = self._began + k * self._interval
        ready = now
        while due - now > _SPIN and not self._pressed():
            clock.sleep(min(due - now - _SPIN, _NAP))
            now = clock.perf_counter()
        while now < due and not self._pressed():
            now = clock.perf_counter()
        self.waited += now - ready
        self._over += ready > due
        self._late.append(max(now - due, 0.0))

    def facts(self) -> dict[str, Any]:
        """Return `speed`, the lateness of the rows, and the machine for the summary."""
        late = np.array(self._late) if self._late else np.zeros(1)
        p50, p99_9 = np.percentile(late, [50.0, 99.9]).tolist()
        return {
            "speed": self._speed,
            "rows": len(self._late),
            "overruns": self._over,
            "late_p50_s": p50,
            "late_p99_9_s": p99_9,
            "late_worst_s": late.max().item(),
            "worst_row": int(late.argmax()) + 2,
            "machine": machine_name(),
        }


def machine_name() -> str:
    """Processor, number of cores and system."""
    return f"{processor_name()}, {os.cpu_count()} cores, {platform.platform()}"


def processor_name() -> str:
    """Name of the processor, or of its architecture if unknown."""
    try:
        lines = Path("/proc/cpuinfo").read_text(encoding="utf-8").splitlines()
    except OSError:
        return platform.processor() or platform.machine()
    names = [line.split(":", 1)[1].strip() for line in lines if line.startswith("model name")]
    return names[0] if names else platform.machine()
