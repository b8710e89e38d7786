"""The base class of units: what `base` declares, and how a unit runs by itself in Python."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from vdfmu.base.state_space import StateSpace
from vdfmu.compiler.unit.base import BaseUnit
from vdfmu.compiler.unit.simulation import Solution, linearize, simulate


class Unit(BaseUnit):
    """Base of all units. A subclass declares variables and overrides some of the four methods.

    Its docstring is the unit's description: the first line says what it is, the rest is for its page.

    Parameters
    ----------
    robot : Robot, optional
        Robot of a unit that has variables for joints, or :class:`RobotParameters`.
    **values : array_like
        Parameters and inputs instead of their start values.

    Raises
    ------
    UnitError
        For a unit without the robot that it needs.
    UsageError
        For a name or a value that does not fit.
    """

    def simulate(
        self, inputs: Mapping[str, Any] | None = None, *, stop: float, step: float = 1e-3, tolerance: float = 1e-9
    ) -> Solution:
        """Run the unit from time 0 by scipy, with the parameters and inputs that are set.

        Parameters
        ----------
        inputs : mapping of str to value or function of time, optional
            Inputs that change, or are to have another value.
        stop, step : float [s]
            End, and time from one row to the next.
        tolerance : float
            Tolerance of the continuous states, relative and absolute.

        Returns
        -------
        Solution
            ``solution.t`` and ``solution["y"]``: inputs and outputs, (m, ...) each.

        Raises
        ------
        UsageError
            For an unknown input.
        UnitError
            If a method fails.
        """
        return simulate(self, inputs, stop=stop, step=step, tolerance=tolerance)

    def linearize(self, *, x: Any = None, t: float = 0.0) -> StateSpace:
        """Return the linear model at the inputs and parameters that are set, and a state.

        Parameters
        ----------
        x : (n_x,) array_like, optional
            Continuous states in the order of their declaration; default those at the start.
        t : float [s]

        Returns
        -------
        vdfmu.StateSpace
            ``A, B, C, D`` with the names of their rows and columns; outputs are the states and what follows from them.
        """
        return linearize(self, x=x, t=t)
