"""Real time: a run that is held back to the clock, and how late its rows were."""

from __future__ import annotations

import gc
import os
import platform
import time as clock
from array import array
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from vdfmu.base.errors import UsageError
from vdfmu.engine.masters.observer import Tap

_SPIN = 2e-4
"""Time before a row is due from which on the clock is looked at all the time [s]: sleeps end later than this rarely."""
_NAP = 0.1
"""Longest sleep [s], after which a signal is seen."""


class Pace(Tap):
    """Ends rows, each not before it is due. In its block Python does not look for what is garbage, for milliseconds.

    Parameters
    ----------
    speed : float
        Time of the run over wall time; 1 is real time.
    step : float [s]
        Between two rows. The clock starts with the second row: the first step of all loads code.
    pressed : callable
        Whether the user stops the run, which then waits no longer.
    """

    def __init__(self, speed: float, step: float, pressed: Callable[[], bool] = lambda: False) -> None:
        if not 0.0 < speed < np.inf:
            raise UsageError(f"pace: expected a positive number of simulated seconds a second, got {speed:g}.")
        self._speed, self._interval, self._pressed = speed, step / speed, pressed
        self._began, self._late, self._over = 0.0, array("d"), 0
        self.waited = 0.0
        """Wall time of the waiting [s]."""

    def __enter__(self) -> None:
        self._collects = gc.isenabled()
        gc.disable()

    def __exit__(self, *_: object) -> None:
        if self._collects:
            gc.enable()

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
        """Return `speed` and the lateness of the rows for the summary, with the machine that it was measured on."""
        late = np.array(self._late) if self._late else np.zeros(1)
        p50, p99_9 = np.percentile(late, [50.0, 99.9]).tolist()
        return {
            "speed": self._speed, "rows": len(self._late), "overruns": self._over, "late_p50_s": p50,
            "late_p99_9_s": p99_9, "late_worst_s": late.max().item(), "worst_row": int(late.argmax()) + 2,
            "machine": machine_name(),
        }  # fmt: skip


def machine_name() -> str:
    """Processor, number of cores and system."""
    return f"{processor_name()}, {os.cpu_count()} cores, {platform.platform()}"


def processor_name() -> str:
    """Name of the processor, as far as the system tells."""
    try:
        lines = Path("/proc/cpuinfo").read_text(encoding="utf-8").splitlines()
    except OSError:
        return platform.processor() or platform.machine()
    names = [line.split(":", 1)[1].strip() for line in lines if line.startswith("model name")]
    return names[0] if names else platform.machine()
