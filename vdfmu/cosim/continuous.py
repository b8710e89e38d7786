"""Steps for continuous coupling: inputs run linearly over a step, steps are repeated until the units agree.

The algorithms `extrapolated` and `iterative`, with or without error control. See `docs/cosimulation.md`.
"""

from __future__ import annotations

import math
from ctypes import byref, c_double, c_int, c_size_t, c_uint, c_void_p
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from vdfmu.cosim.component import Slave
from vdfmu.cosim.exchange import Call, Exchange, component_argument
from vdfmu.errors import CosimError

__all__ = ["ContinuousStepper"]

Floats = NDArray[np.float64]

_MOST_SWEEPS = 30
_HOPELESS = 1e3
"""Growth of the change over the first at which repeating ends, before numbers overflow."""
_SHORTEST = 1e-6
"""Shortest step of the error control, relative to the longest."""
_SAFETY, _LEAST, _MOST = 0.9, 0.2, 2.0
"""Bounds of the next step relative to the last, as in the controllers of one-step methods."""
_KEPT = 1e-3
"""Relative size of a change of the guess below which Broyden's formula would divide by rounding errors."""


@dataclass
class _Unit:
    """One unit: its calls, and the window of its real inputs."""

    slave: Slave
    gathers: list[Any]
    calls: list[Call]
    window: slice
    moving: bool
    """Whether its inputs run over the step by their derivatives."""


@dataclass
class _Block:
    """Units that depend on each other, in the order of their steps; or a unit alone.

    `torn` are the outputs that a unit of the block reads before they are computed: those that are guessed.
    """

    units: list[_Unit]
    torn: NDArray[np.intp]
    inverse: Floats | None = None
    """Inverse of the derivative of the residual by the guess, as far as Broyden's method knows it."""


class ContinuousStepper:
    """Steps the units from one communication point to the next.

    All outputs at the end of the step are predicted from their last two values. The units step in the order of the
    schedule; each input runs linearly from its value at the start of the step to that at its end, which is the
    computed output where its source has stepped, else the predicted one. `iterative` repeats that with the computed
    outputs in place of the predicted ones, from the saved states, until they agree.

    Parameters
    ----------
    exchange : Exchange
        After the initialization, with the outputs at the start.
    repeat : bool
        `iterative`; else `extrapolated`.
    convergence : float
        Largest change of a coupled signal, relative to its size and at least to its nominal value, at which the
        repetitions end.
    error : float or None
        Largest error of a coupled signal in a step, relative in the same way; None for steps of the given length.
    """

    def __init__(self, exchange: Exchange, *, repeat: bool, convergence: float, error: float | None) -> None:
        self.exchange = exchange
        self.repeat, self.convergence, self.error = repeat, convergence, error
        self.steps = self.unit_steps = self.rejected = 0
        self.shortest, self.longest = math.inf, 0.0
        bank = self._bank = exchange.banks[0]
        self._outputs, self._inputs = bank.outputs, bank.inputs
        links = bank.links
        self._sources = np.array([bank.position[k.start] for k in links], np.intp)
        self._factor = np.array([k.conversion.factor for k in links])
        self._offset = np.array([k.conversion.offset for k in links])
        self._starts = np.zeros(len(links))
        self._ends = np.zeros(len(links))
        self._slopes = np.zeros(len(links))
        self._rates = (c_double * len(links)).from_buffer(self._slopes)  # pyright: ignore[reportArgumentType]
        self._nominal = np.array([v.nominal for _, v in bank.variables[: bank.outputs.size]])
        self._size = exchange.size
        units = [self._unit(name) for name in exchange.checked.schedule.units]
        self._blocks = self._cut(units)
        self._hold = self._held_at()
        self._store_states = repeat or error is not None
        self._states: dict[str, c_void_p] = {}
        self._before, self._last, self._h = self._outputs.copy(), 0.0, math.inf
        self._extrapolated, self._interpolated = self._approximated()

    # ------------------------------------------------------------------ plan

    def _unit(self, name: str) -> _Unit:
        exchange, bank = self.exchange, self._bank
        slave = exchange.slaves[name]
        window = bank.input_windows[name]
        moving = slave.description.interpolates_inputs and window.stop > window.start
        calls = exchange.calls(name)
        if moving:
            calls.insert([call[-1] for call in calls].index("doStep"), self._rate_call(slave, window))
        gathers = [each.gather(each.input_windows[name]) for each in exchange.banks[1:]]
        return _Unit(slave, [g for g in gathers if g is not None], calls, window, moving)

    def _rate_call(self, slave: Slave, window: slice) -> Call:
        """Return the call that gives the first derivatives of a unit's inputs.

        It has one argument more than the others: the two counts are bound to the function.
        """
        bank = self._bank
        n = window.stop - window.start
        first = bank.outputs.size + window.start
        references = (c_uint * n)(*(v.reference for _, v in bank.variables[first : first + n]))
        orders = (c_int * n)(*([1] * n))
        values = byref(self._rates, 8 * window.start)
        function = slave.function("fmi2SetRealInputDerivatives")

        def call(component: Any, references: Any, count: Any, values: Any) -> int:
            return function(component, references, count, orders, values)

        count = c_size_t.from_param(n)
        return call, component_argument(slave), references, count, values, "setRealInputDerivatives"

    def _cut(self, units: list[_Unit]) -> list[_Block]:
        """Put the units of each loop into a block, with the outputs to be guessed."""
        by_name = {unit.slave.name: unit for unit in units}
        links = self._bank.links
        blocks: list[_Block] = []
        for names in self.exchange.checked.schedule.blocks:
            rank = {name: i for i, name in enumerate(names)}
            torn = {
                self._bank.position[k.start]
                for k in links
                if k.start[0] in rank and k.end[0] in rank and rank[k.start[0]] >= rank[k.end[0]]
            }
            blocks.append(_Block([by_name[name] for name in names], np.array(sorted(torn), np.intp)))
        return blocks

    def _held_at(self) -> Floats:
        """Where in the step an input is read that cannot run: 0 where it runs, at the start.

        An input that an output depends on directly is needed at the end of the step, any other in its middle: the
        mean of a linear input has the same integral.
        """
        bank, schedule = self._bank, self.exchange.checked.schedule
        hold = np.zeros(len(bank.links))
        for unit in (unit for block in self._blocks for unit in block.units if not unit.moving):
            for i in range(unit.window.start, unit.window.stop):
                hold[i] = 1.0 if bank.links[i].end in schedule.through else 0.5
        return hold

    def _approximated(self) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
        """Return the outputs of which a step uses an extrapolation, and those of which it uses a line."""
        through = self.exchange.checked.schedule.through
        torn = np.unique(np.concatenate([block.torn for block in self._blocks]))
        line = {self._bank.position[k.start] for k in self._bank.links if k.end not in through}
        empty = np.zeros(0, np.intp)
        return (empty if self.repeat else torn), np.array(sorted(line), np.intp)

    # ------------------------------------------------------------------ steps

    def advance(self, start: float, step: float, stop: float) -> None:
        """Step all units from `start` by `step` to `stop`, in as many steps as the error control wants."""
        if self.error is None:
            self._try(start, step, step)
        else:
            time = start
            while time < stop:
                left = stop - time
                parts = math.ceil(left / min(self._h, left) - 1e-9)  # equal ones, so that none is tiny
                end = stop if parts <= 1 else time + left / parts
                if self._try(time, end - time, step):
                    time = end
        self._inputs[:] = self._ends  # what a row holds of an input is its value at the end

    def facts(self) -> dict[str, Any]:
        """Return what the summary says of the steps."""
        return {
            "communication": {
                "steps": self.steps,
                "rejected": self.rejected,
                "unit_steps": self.unit_steps,
                "shortest_step": self.shortest,
                "longest_step": self.longest,
            }
        }

    def _try(self, time: float, h: float, longest: float) -> bool:
        """Do a step; with error control return False, with everything restored, if its error is too large."""
        outputs = self._outputs
        self.exchange.clock.value, self._size.value = time, h
        if self._store_states:
            self._save()
        start = outputs.copy()
        if self._last > 0.0:
            np.multiply(start - self._before, h / self._last, outputs)
            outputs += start
        predicted = outputs.copy()
        np.multiply(self._factor, start[self._sources], self._starts)
        self._starts += self._offset
        agreed = all(self._solve(block, time, h) for block in self._blocks)
        if self.error is not None and not self._accept(predicted, agreed, h, longest):
            outputs[:] = start
            self._restore([unit for block in self._blocks for unit in block.units])
            return False
        self._before, self._last = start, h
        self.steps += 1
        self.shortest, self.longest = min(self.shortest, h), max(self.longest, h)
        return True

    def _accept(self, predicted: Floats, agreed: bool, h: float, longest: float) -> bool:
        """Choose the next step; tell whether the error of this one is small enough.

        Predicted and computed value of a signal y differ by h (h + h_last) / 2 times its second derivative, to first
        order; the line between its values at the ends of the step departs from it by at most h^2 / 8 times that.
        """
        difference = np.abs(self._outputs - predicted) / self._scale()
        line = h / (4.0 * (h + self._last)) if self._last > 0.0 else 1.0
        size = max(
            difference[self._extrapolated].max(initial=0.0),
            line * difference[self._interpolated].max(initial=0.0),
        )
        ratio = float(size) / (self.error or 1.0)
        factor = _SAFETY / math.sqrt(max(ratio, 1e-12)) if agreed else _LEAST
        self._h = min(h * min(max(factor, _LEAST), _MOST), longest)
        if agreed and ratio <= 1.0:
            return True
        self.rejected += 1
        if self._h < _SHORTEST * longest:
            raise CosimError(
                "", "doStep", self.exchange.clock.value,
                f"the coupled signals do not come within the error {self.error:g} with steps of {h:.3g} s; "
                "allow a larger error, or use gauss-seidel",
            )  # fmt: skip
        return False

    def _scale(self) -> Floats:
        return np.maximum(np.abs(self._outputs), self._nominal)

    def _solve(self, block: _Block, time: float, h: float) -> bool:
        """Step the units of a block, repeatedly until the guess of the torn outputs comes out as it went in."""
        torn, outputs = block.torn, self._outputs
        if not self.repeat or not torn.size:
            self._sweep(block, h)
            return True
        guess = outputs[torn]
        change = last = residual = np.zeros(torn.size)
        sizes: list[float] = []
        while len(sizes) < _MOST_SWEEPS and (len(sizes) < 3 or sizes[-1] < _HOPELESS * sizes[0]):
            if sizes:
                self._restore(block.units)
            self._sweep(block, h)
            residual = outputs[torn] - guess
            relative = np.abs(residual) / self._scale()[torn]
            sizes.append(float(relative.max()))
            if sizes[-1] <= self.convergence:
                return True
            if len(sizes) > 1:
                _broyden(block, change, residual - last)
            last = residual
            change = residual if block.inverse is None else -block.inverse @ residual
            guess = guess + change
            outputs[torn] = guess
        block.inverse = None
        if self.error is not None:
            return False
        i = int(np.argmax(np.abs(residual) / self._scale()[torn]))
        unit, variable = self._bank.variables[torn[i]]
        raise CosimError(
            unit, "doStep", time,
            f"the coupling does not converge: {variable.name} still changes by {abs(residual[i]):.3g} after "
            f"{len(sizes)} repetitions (wanted: {self.convergence:g} relative); choose a shorter step, or error "
            "control (adaptive)",
        )  # fmt: skip

    def _sweep(self, block: _Block, h: float) -> None:
        """Step each unit of a block once, with the latest outputs at the end of the step."""
        self.unit_steps += len(block.units)
        for unit in block.units:
            w = unit.window
            if w.stop > w.start:
                ends, starts = self._ends[w], self._starts[w]
                np.multiply(self._factor[w], self._outputs[self._sources[w]], ends)
                ends += self._offset[w]
                if unit.moving:
                    self._inputs[w] = starts
                    np.subtract(ends, starts, self._slopes[w])
                    self._slopes[w] /= h
                else:
                    self._inputs[w] = starts + self._hold[w] * (ends - starts)
            for gather in unit.gathers:
                gather()
            for function, a, b, c, d, name in unit.calls:
                status = function(a, b, c, d)
                if status:
                    unit.slave.judge(status, name)

    # ------------------------------------------------------------------ states

    def _save(self) -> None:
        for block in self._blocks:
            if self.error is None and not block.torn.size:
                continue  # never repeated
            for unit in block.units:
                self._free(unit.slave)
                state = self._states[unit.slave.name] = c_void_p()
                unit.slave.call("GetFMUstate", byref(state))

    def _restore(self, units: list[_Unit]) -> None:
        for unit in units:
            unit.slave.call("SetFMUstate", self._states[unit.slave.name])

    def _free(self, slave: Slave) -> None:
        state = self._states.pop(slave.name, None)
        if state is not None and not slave.dead:
            slave.call("FreeFMUstate", byref(state))

    def close(self) -> None:
        """Free the saved states."""
        for name in list(self._states):
            self._free(self.exchange.slaves[name])


def _broyden(block: _Block, change: Floats, difference: Floats) -> None:
    """Improve the inverse of the derivative of the residual, by Broyden's first formula in its inverse form.

    Without coupling the residual falls by the change of the guess: the derivative is minus the identity.
    """
    inverse = -np.eye(change.size) if block.inverse is None else block.inverse
    moved = inverse @ difference
    scale = change @ moved
    if abs(scale) > _KEPT * (change @ change):
        block.inverse = inverse + np.outer(change - moved, change @ inverse) / scale
