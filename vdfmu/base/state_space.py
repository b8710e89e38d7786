"""Linear systems: discretisation, and matrices whose rows and columns have names and units."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from importlib import import_module
from typing import Any, NamedTuple

import numpy as np

from vdfmu.base.arrays import Floats
from vdfmu.base.errors import UsageError

Signal = tuple[str, str, float]
"""Name, unit and value."""
_PADE = [float(math.comb(13, k) * math.factorial(26 - k) // math.factorial(13)) for k in range(14)]
"""Coefficients of the numerator, Eq. (10.33) of Higham: (26 - k)! / ((13 - k)! k!)."""
_PADE_NORM = 5.371920351148152
"""Largest norm with a backward error below the unit roundoff of doubles."""


class Linear(NamedTuple):
    """``x_dot = A x + B u`` in deviations, or ``x[k+1] = A x[k] + B u[k]``: A (n, n), B (n, m)."""

    A: Floats
    B: Floats


def held(continuous: Linear, step: float) -> Linear:
    """Discretise exactly with a zero-order hold of the inputs over a step [s]."""
    A, B = continuous
    acts = B.any(axis=0)
    whole = np.zeros((len(A) + np.count_nonzero(acts),) * 2)
    whole[: len(A)] = step * np.hstack([A, B[:, acts]])
    power, Gamma = expm(whole)[: len(A)], np.zeros_like(B)
    Gamma[:, acts] = power[:, len(A) :]
    return Linear(power[:, : len(A)], Gamma)


def expm(A: Floats) -> Floats:
    """Return the exponential of a matrix by scaling and squaring with the Pade approximant of degree 13.

    Higham, "The Scaling and Squaring Method for the Matrix Exponential Revisited", SIAM J. Matrix Anal. Appl. 26(4),
    2005. scipy's takes 0.2 s to import.
    """
    squarings = max(0, math.frexp(np.abs(A).sum(axis=0).max(initial=0.0) / _PADE_NORM)[1])
    A = A / 2.0**squarings
    identity, A2 = np.eye(len(A)), A @ A
    A4 = A2 @ A2
    A6 = A2 @ A4
    b = _PADE
    odd = A @ (A6 @ (b[13] * A6 + b[11] * A4 + b[9] * A2) + b[7] * A6 + b[5] * A4 + b[3] * A2 + b[1] * identity)
    even = A6 @ (b[12] * A6 + b[10] * A4 + b[8] * A2) + b[6] * A6 + b[4] * A4 + b[2] * A2 + b[0] * identity
    power: Any = np.linalg.solve(even - odd, even + odd)
    for _ in range(squarings):
        power = power @ power
    return power


@dataclass(frozen=True)
class StateSpace:
    """``x_dot = A x + B u``, ``y = C x + D u`` in deviations. With a step ``x[k+1] = A x[k] + B u[k]``.

    Attributes
    ----------
    A, B, C, D : (n_x, n_x), (n_x, n_u), (n_y, n_x), (n_y, n_u) arrays
    states, inputs, outputs : tuple of str
        Names, such as ``q[1]``.
    state_units, input_units, output_units : tuple of str
    x, u, y : (n_x,), (n_u,), (n_y,) arrays
        Operating point of the linearisation.
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
        """Return the frequency response from inputs to outputs at frequencies (m,) [rad/s]: (m, n_y, n_u)."""
        s = 1j * w if self.step is None else np.exp(1j * w * self.step)
        return self.C @ np.linalg.solve(s[:, None, None] * np.eye(len(self.A)) - self.A, self.B) + self.D

    def to_scipy(self) -> Any:
        """Return a ``scipy.signal.StateSpace``, without the names."""
        from scipy.signal import StateSpace as ScipyStateSpace

        time = {} if self.step is None else {"dt": self.step}
        return ScipyStateSpace(self.A, self.B, self.C, self.D, **time)

    def to_control(self) -> Any:
        """Return a ``control.StateSpace`` of python-control (else UsageError). Dots in the names become ``_``."""
        try:
            control = import_module("control")
        except ImportError:
            raise UsageError("to_control needs python-control. Install it with 'pip install control'.") from None
        time = () if self.step is None else (self.step,)
        kinds = ("states", "inputs", "outputs")
        names = {kind: [name.replace(".", "_") for name in getattr(self, kind)] for kind in kinds}
        return control.ss(self.A, self.B, self.C, self.D, *time, **names)
