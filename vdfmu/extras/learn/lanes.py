"""Runs of a system in lanes, step by step: inputs are set and signals read between steps."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from ctypes import c_double, c_void_p
from typing import Any

import numpy as np

from vdfmu.base.arrays import Floats
from vdfmu.base.errors import UsageError
from vdfmu.extras.batch.engine import BatchProgram, aligned, lane_library, set_lane, shown_calls


class SteppedLanes:
    """Runs of a program side by side, whose inputs are set and whose signals are read between steps.

    Parameters
    ----------
    program : BatchProgram
    count : int
        Number of runs; they fill blocks of as many lanes as the processor has.
    inputs, signals : sequences of str
        Inputs that :meth:`step` sets, and signals that :meth:`read` returns.

    Attributes
    ----------
    good : (count,) bool array
        Whether a run continues: False if it failed, or its parameters were rejected.
    """

    def __init__(self, program: BatchProgram, count: int, inputs: Sequence[str], signals: Sequence[str]) -> None:
        if len(program.fed):
            raise UsageError("inputs: expected none, because the caller sets the inputs in each step.")
        self._program, (_, self._library) = program, lane_library(program)
        self._lanes, p = int(self._library.lanes()), c_void_p
        self._library.begin_lanes.argtypes, self._library.begin_lanes.restype = [p] * 4, None
        self._library.step_lanes.argtypes, self._library.step_lanes.restype = [p, p, p, c_double, p, p], None
        self._inputs = [program.parameters[name][0] for name in inputs]
        self._signals = [program.signals[name][0] for name in signals]
        self._shown = shown_calls(program, signals)
        blocks, steps = -(-count // self._lanes), int(self._library.solvers())
        self._m = [aligned(len(program.memory), self._lanes) for _ in range(blocks)]
        self._h = [aligned(max(steps, 1), self._lanes) for _ in range(blocks)]
        self._k = np.zeros((blocks, self._lanes), np.intp)
        self._good = np.zeros((blocks, self._lanes), np.bool_)
        self.good = self._good.reshape(-1)[:count]

    def reset(self, points: Mapping[int, Mapping[str, Any]]) -> None:
        """Restart some runs, each with its parameters by ``component.variable``."""
        program, lanes = self._program, self._lanes
        for block in {run // lanes for run in points}:
            m, h, good = aligned(*self._m[block].shape), aligned(*self._h[block].shape), np.zeros(lanes, np.bool_)
            m[:] = program.memory[:, None]
            lane_points = {run % lanes: point for run, point in points.items() if run // lanes == block}
            fit = {lane: set_lane(program, m, lane, point) for lane, point in lane_points.items()}
            self._library.begin_lanes(m.ctypes.data, h.ctypes.data, self._shown.ctypes.data, good.ctypes.data)
            for lane, fits in fit.items():
                self._m[block][:, lane], self._h[block][:, lane] = m[:, lane], h[:, lane]
                self._good[block, lane], self._k[block, lane] = fits and good[lane], 0

    def step(self, values: Floats, count: int = 1) -> None:
        """Make communication steps with inputs (runs, inputs); runs that are not good do not change."""
        size, padded = self._program.sizes[0].item(), np.zeros((self._k.size, len(self._inputs)))
        padded[: len(values)] = values
        t = aligned(1, self._lanes)
        for block, (m, h, good) in enumerate(zip(self._m, self._h, self._good, strict=True)):
            m[self._inputs] = padded[block * self._lanes : (block + 1) * self._lanes].T
            for _ in range(count):
                t[0] = self._k[block] * size
                self._library.step_lanes(
                    m.ctypes.data, h.ctypes.data, t.ctypes.data, size, self._shown.ctypes.data, good.ctypes.data
                )
                good &= np.isfinite(m[self._signals]).all(axis=0)
                self._k[block] += 1

    def read(self) -> Floats:
        """Return the signals (runs, signals)."""
        return np.concatenate([m[self._signals].T for m in self._m])[: len(self.good)]
