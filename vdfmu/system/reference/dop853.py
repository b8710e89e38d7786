"""DOP853, the explicit method of order 8, in compiled code with scipy's coefficients, step control and error norm."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from ctypes import CDLL, POINTER, Structure, byref, c_double, c_int, c_size_t, c_void_p, cast
from dataclasses import dataclass
from functools import cache
from hashlib import sha256
from pathlib import Path
from typing import Any, Protocol

import numpy as np

from vdfmu.base.arrays import Floats, scipy_part
from vdfmu.base.compile import own_library
from vdfmu.base.errors import VdfmuError
from vdfmu.base.files import source_bytes
from vdfmu.system.reference.wired import WiredUnits

_SOURCE = Path(__file__).with_suffix(".c")
_STAGES = 12


class _Method(Structure):
    _fields_ = [(name, POINTER(c_double)) for name in ("A", "B", "C", "E3", "E5")] + [
        (name, c_double) for name in ("relative", "absolute")
    ]


@cache
def _library() -> CDLL | None:
    """Return the library; None without a compiler or disk space."""
    library = own_library(_SOURCE)
    if library is not None:
        pointers = [c_void_p] * 4
        library.advance.argtypes = (*pointers, c_size_t, c_double, c_double, c_double, c_void_p)
        library.advance.restype = c_int
    return library


def source_key() -> str:
    """Return a digest of the C text."""
    return sha256(source_bytes(_SOURCE)).hexdigest()


class CompiledDop853:
    """Integrates states `x` (n,) in place. `rate` is a compiled function of time [s] that reads `x`, sets `x_dot`."""

    def __init__(self, rate: Any, x: Floats, x_dot: Floats, rtol: float, atol: float) -> None:
        tables = scipy_part("scipy.integrate._ivp.dop853_coefficients")
        library = _library()
        assert library is not None
        self._numbers = {name: np.ascontiguousarray(getattr(tables, name)) for name in ("A", "B", "C", "E3", "E5")}
        pointers = [numbers.ctypes.data_as(POINTER(c_double)) for numbers in self._numbers.values()]
        self._method = _Method(*pointers, rtol, atol)
        self._work = np.zeros((_STAGES + 2) * x.size)
        self._places = (byref(self._method), cast(rate, c_void_p), x.ctypes.data, x_dot.ctypes.data, x.size)
        self._run, self._room = library.advance, self._work.ctypes.data

    def advance(self, t: float, to: float, first: float) -> int:
        """Integrate from `t` to `to` [s], with first step `first`; return the number of steps, negative on failure."""
        return self._run(*self._places, t, to, first, self._room)


def compiles(rate: object) -> bool:
    """Return whether a right-hand side is in a compiled library and this solver can be compiled too."""
    return hasattr(rate, "argtypes") and _library() is not None


class CountedSteps(Protocol):
    """The solver of a unit's states: the number of steps in its last interval, and whether it is compiled."""

    steps: int
    is_compiled: bool


@dataclass
class Repeated:
    """Intervals of a compiled solution that scipy also solved."""

    intervals: int = 0
    difference: float = 0.0
    """Largest difference of a state [SI]."""

    @property
    def entries(self) -> dict[str, float]:
        """Return the entries for a summary; empty if only scipy solved."""
        return {"solved_by_scipy": self.intervals, "max_solver_difference": self.difference} if self.intervals else {}


class KeptIntervals:
    """States of a system before and after each interval of a block, and the steps of its units' solvers."""

    def __init__(
        self, system: WiredUnits, movers: Sequence[CountedSteps], rows: int, tolerances: Mapping[str, float]
    ) -> None:
        self._system, self._movers, self._tolerances = system, movers, tolerances
        self._before, self._after = np.empty((rows, system.memory.size)), np.empty((rows, system.x.size))
        self._steps, self._times = np.empty((rows, len(movers)), int), np.empty((rows, 2))
        self._row = -1

    def begin(self, t: float, to: float) -> None:
        """Keep the memory before the interval from `t` to `to` [s]."""
        self._row = k = (self._row + 1) % len(self._before)
        self._before[k], self._times[k] = self._system.memory, (t, to)
        self._steps[k] = [mover.steps for mover in self._movers]

    def end(self) -> None:
        """Keep the states after it."""
        self._after[self._row] = self._system.memory[self._system.x]

    def difference(self, back: int, step: Callable[[float, float], None]) -> float:
        """Let scipy solve the interval that ended `back` intervals ago, and return the largest difference of a state.

        VdfmuError if it exceeds what both solvers' tolerances, applied to a norm over all states in each step, allow.
        """
        k = (self._row - back) % len(self._before)
        memory, x, steps = self._system.memory.copy(), self._after[k], [mover.steps for mover in self._movers]
        self._system.memory[:] = self._before[k]
        for mover, first in zip(self._movers, self._steps[k].tolist(), strict=True):
            mover.steps, mover.is_compiled = first, False
        t, to = self._times[k].tolist()
        step(t, to)
        apart = np.abs(self._system.memory[self._system.x] - x)
        tolerances, most = self._tolerances, max(mover.steps for mover in self._movers) + 1
        allowed = 2.0 * most * math.sqrt(x.size) * (tolerances["atol"] + tolerances["rtol"] * np.abs(x))
        if np.any(apart > allowed):
            raise VdfmuError(
                f"The reference failed: from t = {t:.9g} s to {to:.9g} s its compiled solver and scipy's differ by "
                f"{apart.max():.3g}. Report it, and run without the reference."
            )
        self._system.memory[:] = memory
        for mover, last in zip(self._movers, steps, strict=True):
            mover.steps, mover.is_compiled = last, True
        return float(apart.max())
