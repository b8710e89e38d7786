"""Steps for continuous coupling: inputs ramp linearly over a step, and steps are repeated until the units agree.

Repetitions and error control are optional. `docs/internals.md` has the derivations.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from ctypes import c_void_p
from typing import Any

import numpy as np
from numpy.typing import NDArray

from vdfmu.base.arrays import Floats
from vdfmu.base.errors import CosimError, FailureKind
from vdfmu.engine.fmu.instance import Instance
from vdfmu.engine.masters.broyden import Broyden, not_solved
from vdfmu.engine.masters.coupled import Block, Coupled, CoupledUnit, interface_inverse
from vdfmu.engine.masters.exchange import Exchange
from vdfmu.engine.masters.sampled import Stepper
from vdfmu.engine.plan.grid import Grid, largest_step

_FIRST = 1e-5
"""First step of the error control, relative to the longest step; it is used to calculate the slopes of the signals."""
_SHORTEST = 1e-11
"""Shortest step of the error control, relative to the run, which times in double precision resolve to four digits."""
_SAFETY, _LEAST, _MOST = 0.9, 0.2, 2.0
"""Safety factor of the next step, and limits of its ratio to the last one, as usual for one-step methods."""
_BETWEEN_JUMPS = 5
"""Smallest number of accepted steps between two jumps. If steps fail sooner after a jump, the cause is not another
jump."""
_BLIND = 0.1
"""Ratio of the allowed error to a signal's largest value, above which there is effectively no error control."""


class ContinuousStepper(Stepper):
    """Steps the units from one communication point to the next.

    All outputs at the end of the step are predicted from their last two values. Units step in the order of the
    schedule. Each input ramps linearly from its value at the start of the step to its value at the end: the computed
    output if its source has stepped, else the predicted one. External signals are known. A `solver` repeats this from
    saved states with better guesses, until computed and guessed outputs agree. Discrete signals (integers, booleans,
    discrete reals) are held over a step and change at its end. If an output depends directly on such an input (see
    `Schedule.fresh`), the unit gets the value at the end of the step.

    `exchange` has the outputs at the start. `solver` makes a solver for the guesses of a block, such as `Broyden`, or
    is None. Repetitions end when no coupled signal changes by more than `convergence`. `error` is the largest allowed
    error of a coupled signal in a step, or None for steps of the given length. Both are relative to the size or nominal
    value of the signal. `span` [s] is the length of the run.
    """

    def __init__(
        self,
        exchange: Exchange,
        *,
        solver: Callable[[], Broyden] | None,
        convergence: float,
        error: float | None,
        span: float,
    ) -> None:
        self.exchange, self.box, repeat = exchange, exchange.box, solver is not None
        self.repeat, self.convergence, self.error = repeat, convergence, error
        self.steps = self.unit_steps = self.rejected = self.jumps = 0
        self._floor, self._since_jump, self._tried = _SHORTEST * span, _BETWEEN_JUMPS, (0.0, 0.0)
        self.shortest, self.longest = math.inf, 0.0
        coupled = self.coupled = Coupled(exchange)
        self._outputs, self._variables = coupled.outputs, coupled.bank.variables
        self.repeated = [u for b in coupled.blocks for u in b.units if error is not None or (repeat and b.torn.size)]
        self._solvers = [solver() for _ in coupled.blocks] if solver is not None else []
        torn = [block.torn for block in coupled.blocks if not repeat]
        self._extrapolated = np.concatenate([np.zeros(0, np.intp), *torn])
        self._largest = np.abs(self._outputs)
        self._changing = np.zeros(sum(places.size for _, _, places in coupled.switches), bool)
        self._states: dict[str, c_void_p] = {}
        self._previous, self._last, self._h = self._outputs.copy(), 0.0, math.inf

    def advance(self, time: float, step: float, stop: float) -> None:
        """Step all units from `time` by `step` to `stop`, in as many steps as the error control requires."""
        if self.error is None:
            self._step(time, step)
            self._done(step)
        else:
            if self._h == math.inf:
                self._h = _FIRST * step
            while time < stop and not self.box.ended:
                target = self._target(time, stop)
                left = target - time
                parts = math.ceil(left / min(self._h, left) - 1e-9)  # equal parts, so that none is tiny
                end = target if parts <= 1 else time + left / parts
                if end <= time:
                    raise CosimError(
                        self.repeated[0].instance.name,
                        "doStep",
                        time,
                        f"the next step, of {left / parts:.3g} s, is below the resolution of time at {time:.9g} s; "
                        "start the run nearer to t = 0",
                    )
                if self.pressed():
                    raise KeyboardInterrupt
                if self._attempt(time, largest_step(time, end), step):
                    time = end
        # a row holds the value of an input at the end
        np.copyto(self.coupled.inputs, self.coupled.ends)

    def count(self, grid: Grid, row: int) -> None:
        """Count the steps to a row of a run as done, without error control."""
        lengths = [grid.step] * (min(row, grid.n - 1) > 0) + [grid.last] * (row == grid.n)
        self.steps, self.unit_steps = row, row * sum(len(u.parts) for b in self.coupled.blocks for u in b.units)
        self.shortest, self.longest = min(lengths, default=math.inf), max(lengths, default=0.0)

    def _target(self, time: float, stop: float) -> float:
        """Return the latest end of a step under error control, within which no external signal jumps or bends."""
        breaks, close = self.exchange.breaks, self.exchange.close
        i = int(breaks.searchsorted(time + close, "right")) if breaks.size else 0
        return float(breaks[i]) if i < breaks.size and breaks[i] < stop - close else stop

    def facts(self) -> dict[str, Any]:
        """Return the summary's entries on the steps."""
        communication = {
            "steps": self.steps,
            "convergence": self.convergence if self.repeat else None,
            "rejected": self.rejected,
            "jumps": self.jumps,
            "unit_steps": self.unit_steps,
            # rounded, since they are differences of times
            "shortest_step": round(self.shortest, 12),
            "longest_step": round(self.longest, 12),
        }
        return {"communication": communication}

    def notes(self) -> list[str]:
        """Return notes on the run, about signals smaller than the allowed error."""
        allowed = self.convergence if self.error is None else self.error
        if self.error is None and not any(block.torn.size for block in self.coupled.blocks if self.repeat):
            return []
        lines = ((self._largest[i], *self._variables[i]) for i in self.coupled.lines)
        small = [f"{unit}.{v.name}" for y, unit, v in lines if v.nominal is None and 0.0 < y < allowed / _BLIND]
        if not small:
            return []
        more = f" and {len(small) - 3} more" if len(small) > 3 else ""
        return [
            f"{', '.join(small[:3])}{more}: smaller than {allowed / _BLIND:.3g} all the time, and without a nominal "
            f"value in the FMU; so an error of {allowed:g} relative to 1 is allowed. Choose a smaller error"
        ]

    def _step(self, time: float, h: float) -> Floats:
        """Step all units; return the outputs that were predicted."""
        self.box.time = time
        self.coupled.begin()
        for unit in self.repeated:
            self._free(unit.instance)
            self._states[unit.instance.name] = unit.instance.saved_state()
        start = self.coupled.begun[0]
        if self._last > 0.0:
            np.multiply(start - self._previous, h / self._last, self._outputs)
            np.add(self._outputs, start, self._outputs)
            for instance, call, places, rates in self.coupled.rates:
                instance.run([call])
                self._outputs[places] = start[places] + h * rates
            self._outputs[self.coupled.discrete] = start[self.coupled.discrete]
        self.exchange.feed(time + h)
        predicted = self._outputs.copy()
        for i, block in enumerate(self.coupled.blocks):
            if self.repeat and block.torn.size:
                self._solve(block, self._solvers[i], time, h)
            else:
                self._sweep(block, time, h)
        return predicted

    def _done(self, h: float) -> None:
        np.copyto(self._previous, self.coupled.begun[0])
        np.maximum(self._largest, np.abs(self._outputs), out=self._largest)
        self._last, self.steps = h, self.steps + 1
        self.shortest, self.longest = min(self.shortest, h), max(self.longest, h)

    def _attempt(self, time: float, h: float, longest: float) -> bool:
        """Make a step under error control and choose the next; if it is too long, restore everything and return False.

        A step is too long if a unit rejects it without a fatal error: FMI 2.0 lets a unit continue from a restored
        state after fmi2Discard and fmi2Error. Changes of discrete signals, jumps of continuous ones and the end of a
        unit shorten the step until they are located.
        """
        assert self.error is not None
        before, failure = len(self.box.pending), None
        try:
            sizes = self._errors(self._step(time, h), h) / self.error
        except CosimError as error:
            if any(unit.instance.dead for unit in self.repeated):
                raise
            sizes, failure = np.zeros(0), error
        ratio = math.inf if failure is not None else float(sizes.max(initial=0.0))
        changed = self._changed()
        # signals that change in every step change at the communication points themselves
        switched = ratio <= 1.0 and bool(np.any(changed & ~self._changing))
        early = any(at < time + h - self._floor for at in self.box.ended.values())
        if (switched or early) and _LEAST * h >= self._floor:
            ratio = math.inf  # shorten it to locate the change for the other units
        self._h = min(h * min(max(_SAFETY / math.sqrt(max(ratio, 1e-12)), _LEAST), _MOST), longest)
        if ratio <= 1.0:
            self._since_jump += 1
            self._accept(h, longest, changed, switched)
            return True
        if self._h < self._floor:
            if failure is not None:
                raise failure
            if math.isfinite(ratio) and self._since_jump >= _BETWEEN_JUMPS:
                self._since_jump = 0
                self._accept(h, longest, changed, True)  # so short that its error does not matter
                return True
            self.exchange.refuse_not_finite("doStep", time + h)
            raise self._too_short(int(np.argmax(sizes)), time, h, ratio)
        self._tried = h, ratio
        self.rejected += 1
        del self.box.pending[before:]
        self.coupled.undo()
        self._restore(self.repeated)
        return False

    def _too_short(self, i: int, time: float, h: float, ratio: float) -> CosimError:
        """Return the error of a step that is too long and cannot be shortened."""
        assert self.error is not None
        (unit, variable), (longer, larger) = self._variables[i], self._tried
        if longer > h and ratio <= larger * math.sqrt(h / longer):
            why = f"it falls with the step, but none is shorter than {self._floor:.3g} s, {_SHORTEST:g} of the run"
            way = "Simulate the fast part in a separate run, or allow a larger error"
        else:
            why = "a shorter step does not reduce it: the signal jumps repeatedly, or the units' solvers cause it"
            way = "Allow a larger error, lower their tolerance, or use a master without error control"
        text = f"the error of {variable.name} in a step of {h:.3g} s is {ratio:.3g} times the allowed {self.error:g}"
        return CosimError(unit, "doStep", time, f"{text}; {why}. {way}", kind=FailureKind.COUPLING)

    def _accept(self, h: float, longest: float, changed: NDArray[np.bool_], jump: bool) -> None:
        """Accept a step; discard predictions after a jump."""
        self._done(h)
        self._tried = 0.0, 0.0
        self._changing = changed
        if jump:
            self._last, self._h = 0.0, _FIRST * longest
            self.jumps += 1

    def _changed(self) -> NDArray[np.bool_]:
        """Return whether each discrete signal differs from its value at the start of the step."""
        return np.concatenate([now[places] != before[places] for now, before, places in self.coupled.switches])

    def _errors(self, predicted: Floats, h: float) -> Floats:
        """Return the errors of the outputs in the step, relative to their sizes; infinite for NaN.

        The predicted and the computed value of a signal y differ by h (h + h_last) / 2 times its second derivative, to
        first order, or by h^2 / 2 times it if the component provides the first derivative. The line between the ends of
        the step departs from y by at most h^2 / 8 times it. In a step far shorter than the last, this would
        underestimate the error of a jump, so the estimate uses at least a fifth of the last step. Outputs with
        feedthrough are excluded, because they move at the start of a step when the last prediction was wrong, not by a
        jump.
        """
        difference = np.abs(self._outputs - predicted) / self._scale()
        difference[np.isnan(difference)] = math.inf
        sizes = np.zeros(difference.size)
        if self._last > 0.0:  # otherwise there is no prediction yet
            least = np.where(self.coupled.passing, h, max(h, _LEAST * self._last))
            line = least / (4.0 * (h + self._last * ~self.coupled.derived[self.coupled.lines]))
            sizes[self.coupled.lines] = line * difference[self.coupled.lines]
            sizes[self._extrapolated] = difference[self._extrapolated]
        return sizes

    def _scale(self) -> Floats:
        return np.maximum(np.abs(self._outputs), self.coupled.nominal)

    def _solve(self, block: Block, solver: Broyden, time: float, h: float) -> None:
        """Step the units of a block until guessed and computed torn outputs agree."""
        torn, outputs = block.torn, self._outputs
        reported = len(self.box.pending)
        first = True

        def repeat(guess: Floats) -> Floats:
            nonlocal first
            if not first:
                del self.box.pending[reported:]  # from a step that is undone
                self._restore(block.units)
                for values, before, chosen in block.stepwise:
                    values[chosen] = before[chosen]
                outputs[torn] = guess
            first = False
            self._sweep(block, time, h)
            return outputs[torn]

        sizes, count = solver.solve(
            outputs[torn],
            repeat,
            lambda residual: np.abs(residual) / self._scale()[torn],
            self.convergence,
            lambda: interface_inverse(block, self.coupled, h),
        )
        if np.all(sizes <= self.convergence):
            return
        i = int(np.argmax(sizes))
        unit, variable = self._variables[torn[i]]
        way = "choose a shorter step" + ("" if self.error is not None else ", or error control (adaptive)")
        why = f"{variable.name} {not_solved(sizes[i], count, self.convergence)}"
        raise CosimError(
            unit, "doStep", time, f"the coupling does not converge: {why}; {way}", kind=FailureKind.COUPLING
        )

    def _sweep(self, block: Block, time: float, h: float) -> None:
        """Step each unit of a block once, with the latest outputs at the end of the step."""
        clock, size = self.exchange.clock, self.exchange.size
        for unit in block.units:
            for gather in unit.gathers:
                gather()
            np.copyto(unit.ends, unit.inputs)
            if unit.held.size:
                unit.ends[unit.held] = unit.starts[unit.held]
            change = unit.ends - unit.starts
            n = len(unit.parts)
            self.unit_steps += n
            for i, (hold, calls) in enumerate(unit.parts):
                np.add(unit.starts, hold * change, unit.inputs)
                np.multiply(change, (1.0 - hold) / h, unit.slopes)
                clock.value = time + i * h / n
                size.value = largest_step(clock.value, time + h) if i and i == n - 1 else h / n
                unit.instance.run(calls)

    def _restore(self, units: list[CoupledUnit]) -> None:
        for unit in units:
            unit.instance.restore_state(self._states[unit.instance.name])

    def _free(self, instance: Instance) -> None:
        state = self._states.pop(instance.name, None)
        if state is not None:
            instance.free_state(state)

    def free(self) -> None:
        """Free the saved states."""
        for name in list(self._states):
            self._free(self.exchange.instances[name])
