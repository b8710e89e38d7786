"""Steps for continuous coupling: inputs run linearly over a step, steps are repeated until the units agree.

The algorithms `extrapolated` and `iterative`, with or without error control; `docs/cosimulation.md` derives them.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from ctypes import byref, c_double, c_int, c_size_t, c_uint, c_void_p
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from vdfmu.cosim.broyden import Broyden
from vdfmu.cosim.component import MessageBox, Slave
from vdfmu.cosim.exchange import Bank, Call, Exchange, component_argument
from vdfmu.errors import CosimError

__all__ = ["ContinuousStepper"]

Floats = NDArray[np.float64]
Indices = NDArray[np.intp]

_FIRST, _SHORTEST = 1e-5, 1e-6
"""First and shortest step of the error control, relative to the longest. The first finds the slopes of the signals."""
_SAFETY, _LEAST, _MOST = 0.9, 0.2, 2.0
"""Next step relative to the last: factor to the wanted one, and its bounds, as one-step methods have them."""
_BETWEEN_JUMPS = 5
"""Accepted steps between two jumps of a signal; where there are fewer, it is no jump that makes them fail."""
_BLIND = 0.1
"""Allowed error over the largest value of a signal from which on it is as good as none."""


@dataclass
class _Unit:
    """One unit: its calls and its real inputs, which are windows of one array each."""

    slave: Slave
    gathers: list[Callable[[], None]]
    calls: list[Call]
    inputs: Floats
    """What is set before the step."""
    starts: Floats
    ends: Floats
    slopes: Floats
    hold: Floats
    """Where on the line through the step the input begins: 0 at its start, where it runs; else it stays there."""
    held: Indices
    """Those that keep their value at the start of the step."""


@dataclass
class _Block:
    """Units that depend on each other, in the order of their steps; or a unit alone.

    `torn` are the continuous outputs that a unit of the block reads before they are computed: those that are guessed.
    """

    units: list[_Unit]
    torn: Indices
    stepwise: list[tuple[NDArray[Any], NDArray[Any], Indices]]
    """Of each type: outputs, those at the start of the step, and which are discrete."""
    solver: Broyden = field(default_factory=Broyden)


class ContinuousStepper:
    """Steps the units from one communication point to the next.

    All outputs at the end of the step are predicted from their last two values. The units step in the order of the
    schedule; each input runs linearly from its value at the start of the step to that at its end, which is the
    computed output where its source has stepped, else the predicted one. `iterative` repeats that from the saved
    states, with better guesses, until the outputs come out as they went in. What is discrete (integers, booleans,
    discrete reals) does not run: it changes at the end of a step, and over the step has the value at its start. Where an
    output depends on it directly (see `Schedule.fresh`), the unit gets its value at the end of the step.

    Parameters
    ----------
    exchange : Exchange
        After the initialization, with the outputs at the start.
    box : MessageBox
    repeat : bool
        `iterative`; else `extrapolated`.
    convergence : float
        Largest change of a coupled signal, relative to its size and at least to its nominal value, at which the
        repetitions end.
    error : float or None
        Largest error of a coupled signal in a step, relative in the same way; None for steps of the given length.
    """

    def __init__(
        self, exchange: Exchange, box: MessageBox, *, repeat: bool, convergence: float, error: float | None
    ) -> None:
        self.exchange, self.box = exchange, box
        self.repeat, self.convergence, self.error = repeat, convergence, error
        self.steps = self.unit_steps = self.rejected = 0
        self.shortest, self.longest = math.inf, 0.0
        bank = self._bank = exchange.banks[0]
        self._outputs, self._inputs = bank.outputs, bank.inputs
        n = len(bank.links)
        self._starts, self._ends, self._slopes = np.zeros(n), np.zeros(n), np.zeros(max(n, 1))
        self._rates = (c_double * self._slopes.size).from_buffer(self._slopes)  # pyright: ignore[reportArgumentType]
        self._discrete = np.array(
            [v.variability == "discrete" for _, v in bank.variables[: bank.outputs.size]], bool
        )
        self._begun = [each.outputs.copy() for each in exchange.banks]
        self._waiting = {each.kind: np.zeros_like(each.inputs) for each in exchange.banks[1:]}
        self._gathers = [each.gather(slice(0, len(each.links))) for each in exchange.banks]
        self._nominal = np.array([v.nominal for _, v in bank.variables[: bank.outputs.size]])
        units = [self._unit(name) for name in exchange.checked.schedule.units]
        self._blocks = self._cut(units)
        self._repeated = [
            u for b in self._blocks for u in b.units if error is not None or (repeat and b.torn.size)
        ]
        self._states: dict[str, c_void_p] = {}
        self._previous, self._last, self._h = self._outputs.copy(), 0.0, math.inf
        self.pressed: Callable[[], bool] = lambda: False
        """Whether the user wants to stop, asked between the steps of a row."""
        self._extrapolated, self._interpolated = self._approximated()

    # ------------------------------------------------------------------ plan

    def _unit(self, name: str) -> _Unit:
        exchange, bank = self.exchange, self._bank
        slave, window, calls = exchange.slaves[name], bank.input_windows[name], exchange.calls(name)
        moving = slave.description.interpolates_inputs
        if moving and window.stop > window.start:
            calls.insert([call[-1] for call in calls].index("doStep"), self._rate_call(slave, window))
        # Where an input cannot run: it is needed at the end of the step if an output depends on it directly. Any other is
        # integrated: the middle of a line has the line's integral, and a discrete one stays as it is at the start.
        schedule = exchange.checked.schedule
        gathers = [self._gather_of(each, name) for each in exchange.banks]
        links = bank.links[window]
        hold = [
            1.0 if k.discrete or not moving and k.end in schedule.through else 0.0 if moving else 0.5
            for k in links
        ]  # fmt: skip
        held = [i for i, k in enumerate(links) if k.discrete and k.end not in schedule.fresh]
        return _Unit(
            slave, [gather for gather in gathers if gather is not None], calls,
            self._inputs[window], self._starts[window], self._ends[window], self._slopes[window],
            np.array(hold), np.array(held, np.intp),
        )  # fmt: skip

    def _gather_of(self, bank: Bank, name: str) -> Callable[[], None] | None:
        """Return the function that brings a unit's inputs of one type up to date, but those that wait for the next step.

        Those of reals wait in `_sweep`.
        """
        window = bank.input_windows[name]
        gather = bank.gather(window)
        fresh = self.exchange.checked.schedule.fresh
        held = np.array([i for i, k in enumerate(bank.links[window]) if k.end not in fresh], np.intp)
        if gather is None or bank is self._bank or not held.size:
            return gather
        inputs, starts = bank.inputs[window], self._waiting[bank.kind][window]

        def some() -> None:
            gather()
            inputs[held] = starts[held]

        return some

    def _rate_call(self, slave: Slave, window: slice) -> Call:
        """Return the call that gives the first derivatives of a unit's inputs."""
        bank = self._bank
        n = window.stop - window.start
        first = bank.outputs.size + window.start
        references = (c_uint * n)(*(v.reference for _, v in bank.variables[first : first + n]))
        orders = (c_int * n)(*([1] * n))
        function = slave.function("fmi2SetRealInputDerivatives")

        def call(component: Any, references: Any, count: Any, values: Any) -> int:
            return function(component, references, count, orders, values)

        values = byref(self._rates, self._slopes.itemsize * window.start)
        return (
            call,
            component_argument(slave),
            references,
            c_size_t.from_param(n),
            values,
            "setRealInputDerivatives",
        )

    def _cut(self, units: list[_Unit]) -> list[_Block]:
        """Put the units of each loop into a block, with the outputs to be guessed."""
        by_name = {unit.slave.name: unit for unit in units}
        position = self._bank.position
        blocks: list[_Block] = []
        for names in self.exchange.checked.schedule.blocks:
            rank = {name: i for i, name in enumerate(names)}
            torn = {
                position[k.start]
                for k in self._bank.links
                if k.start[0] in rank and k.end[0] in rank and rank[k.start[0]] >= rank[k.end[0]]
            }
            torn -= set(np.flatnonzero(self._discrete))
            stepwise: list[tuple[NDArray[Any], NDArray[Any], Indices]] = []
            for bank, before in zip(self.exchange.banks, self._begun, strict=True):
                windows = [range(w.start, w.stop) for w in (bank.output_windows[name] for name in names)]
                own = np.array([i for w in windows for i in w], np.intp)
                chosen = own[self._discrete[own]] if bank is self._bank else own
                if chosen.size:
                    stepwise.append((bank.outputs, before, chosen))
            blocks.append(
                _Block([by_name[name] for name in names], np.array(sorted(torn), np.intp), stepwise)
            )
        return blocks

    def _approximated(self) -> tuple[Indices, Indices]:
        """Return the outputs of which a step uses an extrapolation, and those of which it uses a line."""
        torn = np.zeros(0, np.intp) if self.repeat else np.concatenate([block.torn for block in self._blocks])
        line = {self._bank.position[k.start] for k in self._bank.links} - set(np.flatnonzero(self._discrete))
        return torn, np.array(sorted(line), np.intp)

    # ------------------------------------------------------------------ steps

    def advance(self, start: float, step: float, stop: float) -> None:
        """Step all units from `start` by `step` to `stop`, in as many steps as the error control wants."""
        if self.error is None:
            self._step(start, step)
            self._done(step)
        else:
            time = start
            if self._h == math.inf:
                self._h = _FIRST * step
            while time < stop:
                left = stop - time
                parts = math.ceil(left / min(self._h, left) - 1e-9)  # equal ones, so that none is tiny
                end = stop if parts <= 1 else time + left / parts
                if end <= time:
                    raise CosimError(
                        self._repeated[0].slave.name, "doStep", time,
                        f"the next step, of {left / parts:.3g} s, is below the resolution of time at {time:.9g} s; "
                        "begin nearer to zero",
                    )  # fmt: skip
                if self.pressed():
                    raise KeyboardInterrupt
                if self._attempt(time, end - time, step):
                    time = end
        np.copyto(self._inputs, self._ends)  # what a row holds of an input is its value at the end

    def facts(self) -> dict[str, Any]:
        """Return what the summary says of the steps."""
        return {
            "communication": {
                "steps": self.steps,
                "convergence": self.convergence if self.repeat else None,
                "rejected": self.rejected,
                "unit_steps": self.unit_steps,
                # differences of times, rounded to what is more than rounding errors
                "shortest_step": round(self.shortest, 12),
                "longest_step": round(self.longest, 12),
            }
        }

    def _step(self, time: float, h: float) -> Floats:
        """Step all units; return the outputs that were predicted."""
        self.exchange.clock.value, self.exchange.size.value, self.box.time = time, h, time
        for bank, before in zip(self.exchange.banks, self._begun, strict=True):
            np.copyto(before, bank.outputs)
        for unit in self._repeated:
            self._save(unit.slave)
        start = self._begun[0]
        for bank, gather in zip(self.exchange.banks, self._gathers, strict=True):
            if gather is not None:
                gather()
                np.copyto(self._waiting.get(bank.kind, self._starts), bank.inputs)
        if self._last > 0.0:
            np.multiply(start - self._previous, h / self._last, self._outputs)
            np.add(self._outputs, start, self._outputs)
            self._outputs[self._discrete] = start[self._discrete]
        predicted = self._outputs.copy()
        for block in self._blocks:
            if self.repeat and block.torn.size:
                self._solve(block, time, h)
            else:
                self._sweep(block, h)
        return predicted

    def _done(self, h: float) -> None:
        np.copyto(self._previous, self._begun[0])
        self._last = h
        self.steps += 1
        self.shortest, self.longest = min(self.shortest, h), max(self.longest, h)

    def _attempt(self, time: float, h: float, longest: float) -> bool:
        """Do a step under error control and choose the next; False, with everything restored, if it is too long.

        A unit that refuses the step makes it too long, unless the refusal is fatal: FMI 2.0 lets a unit go on from a
        restored state after fmi2Discard and fmi2Error.
        """
        assert self.error is not None
        said, failure = len(self.box.pending), None
        try:
            sizes = self._errors(self._step(time, h), h) / self.error
        except CosimError as error:
            if any(unit.slave.dead for unit in self._repeated):
                raise
            sizes, failure = np.zeros(0), error
        ratio = math.inf if failure is not None else float(sizes.max(initial=0.0))
        self._h = min(h * min(max(_SAFETY / math.sqrt(max(ratio, 1e-12)), _LEAST), _MOST), longest)
        if ratio <= 1.0:
            self._done(h)
            return True
        if self._h < _SHORTEST * longest:
            if failure is not None:
                raise failure
            unit, variable = self._bank.variables[int(np.argmax(sizes))]
            raise CosimError(
                unit, "doStep", time,
                f"the error of {variable.name} in a step of {h:.3g} s is {ratio:.3g} times the allowed {self.error:g}, "
                "and no shorter step is tried: the signal jumps, or the allowed error is below that of the units' "
                "solvers. Allow a larger error, or use a master without error control",
            )  # fmt: skip
        self.rejected += 1
        del self.box.pending[said:]
        for bank, before in zip(self.exchange.banks, self._begun, strict=True):
            np.copyto(bank.outputs, before)
        self._restore(self._repeated)
        return False

    def _errors(self, predicted: Floats, h: float) -> Floats:
        """Return the errors of the outputs in the step, relative to their sizes; infinite where they are no numbers.

        Predicted and computed value of a signal y differ by h (h + h_last) / 2 times its second derivative, to first
        order; the line between its values at the ends of the step departs from it by at most h^2 / 8 times that.
        """
        difference = np.abs(self._outputs - predicted) / self._scale()
        difference[np.isnan(difference)] = math.inf
        sizes = np.zeros(difference.size)
        if self._last > 0.0:  # else there is no prediction yet
            line = h / (4.0 * (h + self._last))
            sizes[self._interpolated] = line * difference[self._interpolated]
            sizes[self._extrapolated] = difference[self._extrapolated]
        return sizes

    def _scale(self) -> Floats:
        return np.maximum(np.abs(self._outputs), self._nominal)

    def _solve(self, block: _Block, time: float, h: float) -> None:
        """Step the units of a block until the guess of the torn outputs comes out as it went in."""
        torn, outputs = block.torn, self._outputs
        said = len(self.box.pending)
        first = True

        def repeat(guess: Floats) -> Floats:
            nonlocal first
            if not first:
                del self.box.pending[said:]  # of a step that is taken back
                self._restore(block.units)
                for values, before, chosen in block.stepwise:
                    values[chosen] = before[chosen]
                outputs[torn] = guess
            first = False
            self._sweep(block, h)
            return outputs[torn]

        sizes, count = block.solver.solve(
            outputs[torn], repeat, lambda residual: np.abs(residual) / self._scale()[torn], self.convergence
        )
        if np.all(sizes <= self.convergence):
            return
        i = int(np.argmax(sizes))
        unit, variable = self._bank.variables[torn[i]]
        way = "" if self.error is not None else ", or error control (adaptive)"
        raise CosimError(
            unit, "doStep", time,
            f"the coupling does not converge: {variable.name} still changes by {sizes[i]:.3g} of its size after "
            f"{count} repetitions of the step (wanted: {self.convergence:g}); choose a shorter step{way}",
        )  # fmt: skip

    def _sweep(self, block: _Block, h: float) -> None:
        """Step each unit of a block once, with the latest outputs at the end of the step."""
        self.unit_steps += len(block.units)
        for unit in block.units:
            for gather in unit.gathers:
                gather()
            np.copyto(unit.ends, unit.inputs)
            if unit.held.size:
                unit.ends[unit.held] = unit.starts[unit.held]
            change = unit.ends - unit.starts
            np.add(unit.starts, unit.hold * change, unit.inputs)
            np.multiply(change, (1.0 - unit.hold) / h, unit.slopes)
            for function, a, b, c, d, name in unit.calls:
                status = function(a, b, c, d)
                if status:
                    unit.slave.judge(status, name)

    # ------------------------------------------------------------------ states

    def _save(self, slave: Slave) -> None:
        self._free(slave)
        state = self._states[slave.name] = c_void_p()
        slave.call("GetFMUstate", byref(state))

    def _restore(self, units: list[_Unit]) -> None:
        for unit in units:
            unit.slave.call("SetFMUstate", self._states[unit.slave.name])
            unit.slave.stage = "initialized"

    def _free(self, slave: Slave) -> None:
        state = self._states.pop(slave.name, None)
        if state is not None and not slave.dead:
            slave.call("FreeFMUstate", byref(state))

    def close(self) -> None:
        """Free the saved states."""
        for name in list(self._states):
            self._free(self.exchange.slaves[name])
