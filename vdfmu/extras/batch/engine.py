"""The compiled communication steps of a system, in the form sent to workers, and their runs in lanes."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from ctypes import CDLL, c_int64, c_void_p
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from vdfmu.base.arrays import Floats
from vdfmu.base.compile import load_library
from vdfmu.base.text import matching
from vdfmu.engine.results.results import Results, Signal

LANES = 8
"""Largest number of lanes of a processor."""
_ALIGNED = 64
"""Alignment of the memory in bytes."""
_MOST = 2**30
"""Largest size of the rows of all lanes [byte]."""


@dataclass(frozen=True)
class BatchProgram:
    """The compiled communication steps of a system."""

    libraries: tuple[bytes, ...]
    """Libraries, one for each of :data:`vdfmu.extras.batch.programs.LEVELS` that the platform has."""
    memory: Floats
    """Values before the start, (m,)."""
    parameters: Mapping[str, tuple[int, float, float]]
    """Variables that a point may set: ``component.variable`` to place, smallest and largest value."""
    signals: Mapping[str, tuple[int, str]]
    """Signals that can be recorded, to place and unit."""
    optional: list[list[int]]
    """Places set by each call that only runs if one of them is recorded."""
    fed: npt.NDArray[np.int64]
    """Places of the external inputs, (k,)."""
    course: Floats
    """Their values in the steps, (n, k)."""
    points: Floats
    """Start of each step [s], (n,)."""
    sizes: Floats
    """Length of each step [s], (n,)."""
    time: Floats
    """Times of the rows [s], (n + 1,)."""

    @property
    def lanes(self) -> int:
        """Largest number of points that run side by side."""
        return LANES

    def engine(self, record: Sequence[str]) -> Engine:
        """Return an object that runs points of this program and records signals."""
        return Engine(self, record)


class Engine:
    """Runs a program with as many points side by side as this processor has lanes.

    The results contain the signals that match the patterns `record`. The `level` is an index of
    :data:`~vdfmu.extras.batch.programs.LEVELS`, by default the highest that the processor supports.
    """

    def __init__(self, program: BatchProgram, record: Sequence[str], level: int | None = None) -> None:
        self._program = program
        self.level, self._library = lane_library(program, level)
        self.lanes: int = self._library.lanes()
        run = self._library.run
        p, number = c_void_p, c_int64
        run.argtypes = [p, p, p, number, p, number, p, p, p, number, p, p]
        run.restype = number
        names = matching(program.signals, record)
        self._signals = [Signal(name, "real", program.signals[name][1], i) for i, name in enumerate(names)]
        self._recorded = np.array([program.signals[name][0] for name in names], dtype=np.int64)
        self._shown = shown_calls(program, names)
        self._memory = aligned(len(program.memory), self.lanes)

    def run(self, points: Sequence[Mapping[str, Any]]) -> list[Results | None]:
        """Run points, each given by the values of some parameters by ``component.variable``.

        The result of a point that fails or exceeds its limits is None; its FMU reports the reason. All are None if
        their rows need more than `_MOST` bytes.
        """
        if self.lanes * len(self._program.time) * len(self._signals) * 8 > _MOST:
            return [None] * len(points)
        results: list[Results | None] = []
        for first in range(0, len(points), self.lanes):
            results += self._together(points[first : first + self.lanes])
        return results

    def _together(self, points: Sequence[Mapping[str, Any]]) -> list[Results | None]:
        program, memory = self._program, self._memory
        memory[:] = program.memory[:, None]
        fit = [set_lane(program, memory, lane, point) for lane, point in enumerate(points)]
        memory[:, len(points) :] = memory[:, [0]]
        n = len(program.points)
        rows = np.empty((self.lanes, n + 1, len(self._signals)))
        good = np.zeros(self.lanes, dtype=np.bool_)
        arguments = (
            memory,
            program.points,
            program.sizes,
            n,
            program.fed,
            len(program.fed),
            program.course,
            self._shown,
            self._recorded,
            len(self._recorded),
            rows,
            good,
        )
        self._library.run(*(each if isinstance(each, int) else each.ctypes.data for each in arguments))
        facts = {"start": 0.0, "stop": program.time[-1].item(), "steps": n}
        return [
            Results(program.time, self._signals, {"real": rows[lane]}, dict(facts)) if fits and good[lane] else None
            for lane, fits in enumerate(fit)
        ]


def lane_library(program: BatchProgram, level: int | None = None) -> tuple[int, CDLL]:
    """Return the library of a level, by default the highest that this processor supports, and the level."""
    plain = load_library(program.libraries[0], "lanes")
    level = int(plain.level()) if level is None else level
    return level, load_library(program.libraries[level], "lanes") if level else plain


def shown_calls(program: BatchProgram, names: Iterable[str]) -> npt.NDArray[np.bool_]:
    """Return whether each call of `BatchProgram.optional` runs, given the recorded signals."""
    shown = {program.signals[name][0] for name in names}
    return np.array([not shown.isdisjoint(places) for places in program.optional], dtype=np.bool_)


def set_lane(program: BatchProgram, memory: Floats, lane: int, point: Mapping[str, Any]) -> bool:
    """Set the parameters of a lane; return whether they are within their limits."""
    for name, value in point.items():
        place, least, largest = program.parameters.get(name, (0, np.inf, -np.inf))
        try:
            number = float(value)
        except (TypeError, ValueError):
            return False
        if not (least <= number <= largest and np.isfinite(number)):
            return False
        memory[place, lane] = number
    return True


def aligned(rows: int, columns: int) -> Floats:
    """Return an array of zeros whose memory is aligned for vectors."""
    bytes_ = np.zeros(rows * columns * 8 + _ALIGNED, dtype=np.uint8)
    offset = -bytes_.ctypes.data % _ALIGNED
    return bytes_[offset : offset + rows * columns * 8].view(np.float64).reshape(rows, columns)
