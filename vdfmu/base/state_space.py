"""A linear system with names and units."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from importlib import import_module
from typing import Any, NamedTuple

import numpy as np
from scipy.linalg import expm

from vdfmu.base.arrays import Floats
from vdfmu.base.errors import UsageError

Signal = tuple[str, str, float]
"""Name, unit and value."""


class Linear(NamedTuple):
    """``x_dot = A x + B u`` of deviations, or ``x[k+1] = A x[k] + B u[k]``: A (n, n), B (n, m)."""

    A: Floats
    B: Floats


def held(continuous: Linear, step: float) -> Linear:
    """Discretise exactly: the states after a step [s] through which the inputs are held."""
    n, m = continuous.B.shape
    whole: Any = expm(step * np.block([[continuous.A, continuous.B], [np.zeros((m, n + m))]]))
    return Linear(whole[:n, :n], whole[:n, n:])


@dataclass(frozen=True)
class StateSpace:
    """``x_dot = A x + B u``, ``y = C x + D u`` of deviations; with a step ``x[k+1] = A x[k] + B u[k]``.

    Attributes
    ----------
    A, B, C, D : (n_x, n_x), (n_x, n_u), (n_y, n_x), (n_y, n_u) arrays
    states, inputs, outputs : tuple of str
        Names, such as ``q[1]``.
    state_units, input_units, output_units : tuple of str
    x, u, y : (n_x,), (n_u,), (n_y,) arrays
        Where it is linearised.
    step : float or None [s]
        None for continuous time.
    notes : tuple of str
        Notes on how it was linearised.
    """

    A: Floats
    B: Floats
    C: Floats
    D: Floats
    states: tuple[str, ...]
    inputs: tuple[str, ...]
    outputs: tuple[str, ...]
    state_units: tuple[str, ...]
    input_units: tuple[str, ...]
    output_units: tuple[str, ...]
    x: Floats
    u: Floats
    y: Floats
    step: float | None = None
    notes: tuple[str, ...] = ()

    @classmethod
    def of(
        cls, jacobian: Floats, states: Sequence[Signal], inputs: Sequence[Signal], outputs: Sequence[Signal]
    ) -> StateSpace:
        """Return the system with the matrix [[A, B], [C, D]]."""
        n, signals = len(states), (states, inputs, outputs)
        names = [tuple(name for name, _, _ in each) for each in signals]
        units = [tuple(unit for _, unit, _ in each) for each in signals]
        x, u, y = (np.array([value for _, _, value in each], np.float64) for each in signals)
        A, B, C, D = jacobian[:n, :n], jacobian[:n, n:], jacobian[n:, :n], jacobian[n:, n:]
        return cls(A, B, C, D, names[0], names[1], names[2], units[0], units[1], units[2], x, u, y)

    def response(self, w: Floats) -> Any:
        """Return the response of the outputs to the inputs at frequencies (m,) [rad/s]: (m, n_y, n_u)."""
        s = 1j * w if self.step is None else np.exp(1j * w * self.step)
        return self.C @ np.linalg.solve(s[:, None, None] * np.eye(len(self.A)) - self.A, self.B) + self.D

    def to_scipy(self) -> Any:
        """Return a ``scipy.signal.StateSpace``, which has no names."""
        from scipy.signal import StateSpace as ScipyStateSpace

        time = {} if self.step is None else {"dt": self.step}
        return ScipyStateSpace(self.A, self.B, self.C, self.D, **time)

    def to_control(self) -> Any:
        """Return a ``control.StateSpace`` of python-control, with the names, whose dots become ``_``.

        Raises
        ------
        UsageError
            If python-control is not installed.
        """
        try:
            control = import_module("control")
        except ImportError:
            raise UsageError(
                "to_control: expected python-control, which is not installed: pip install control."
            ) from None
        time = () if self.step is None else (self.step,)
        names = {
            kind: [name.replace(".", "_") for name in getattr(self, kind)] for kind in ("states", "inputs", "outputs")
        }
        return control.ss(self.A, self.B, self.C, self.D, *time, **names)
