"""What each unit computes, as a short program of traced functions on its own memory.

The Python slave runs the program, the native FMU is generated from it, and the dependencies are read off it.
A statement names groups of the variable table; further groups are ``p``, the robot's run-time parameters,
``x`` and ``x_dot``, the state of the plant and its derivative, and ``t``, the time.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

__all__ = ["PROGRAMS", "Call", "Copy", "Program", "Statement"]

When = tuple[str, int]
"""A parameter and the value of it that makes a statement run."""


@dataclass(frozen=True)
class Call:
    """Run a traced function of :mod:`vdfmu.kernel.trace`.

    Attributes
    ----------
    function : str
    groups : mapping of str to str
        Argument or result to its group, where their names differ.
    when : (parameter, value) or None
    """

    function: str
    groups: Mapping[str, str] = field(default_factory=dict)
    when: When | None = None

    def group(self, name: str) -> str:
        """Group of an argument or a result."""
        return self.groups.get(name, name)


@dataclass(frozen=True)
class Copy:
    """Copy a group to another."""

    target: str
    source: str
    when: When | None = None


Statement = Call | Copy


@dataclass(frozen=True)
class Program:
    """Program of one unit.

    Attributes
    ----------
    start : statements that make the state of the start time from the parameters
    outputs : statements that make the outputs from inputs, parameters, state and time
    derivatives : statements that make the derivative of the state
    step : the solver's step; None if the unit has no state. Its arguments `h`, `tolerance` and ``<input>_dot``,
        and its results, belong to the solver
    """

    outputs: tuple[Statement, ...]
    start: tuple[Statement, ...] = ()
    derivatives: tuple[Statement, ...] = ()
    step: Call | None = None

    @property
    def calls(self) -> tuple[Call, ...]:
        """Calls of start, outputs and derivatives."""
        statements = (*self.start, *self.outputs, *self.derivatives)
        return tuple(s for s in statements if isinstance(s, Call))


_REST, _GIVEN = ("equilibrium", 1), ("equilibrium", 0)

PROGRAMS = {
    "trajectory": Program(outputs=(Call("trajectory"),)),
    "feedforward": Program(
        outputs=(
            Call("feedforward_inverse", when=("mode", 0)),
            Call("feedforward_vdc", when=("mode", 1)),
        )
    ),
    "controller": Program(
        outputs=(
            Call("pd_control", {"velocity_d": "kappa_dot_d", "velocity": "kappa_dot"}, when=("velocity", 0)),
            Call("pd_control", {"velocity_d": "q_d_dot", "velocity": "q_dot"}, when=("velocity", 1)),
            Call("pd_control", {"velocity_d": "q_d_dot", "velocity": "kappa_dot"}, when=("velocity", 2)),
        )
    ),
    "plant": Program(
        start=(
            Copy("q", "q_0"),
            Copy("q_dot", "q_dot_0"),
            Copy("kappa_dot", "q_dot_0", when=_REST),
            Call("equilibrium_torque", {"q": "q_0"}, when=_REST),
            Copy("kappa_dot", "kappa_dot_0", when=_GIVEN),
            Copy("tau_s", "tau_s_0", when=_GIVEN),
        ),
        outputs=(Call("plant_outputs"),),
        derivatives=(Call("plant_derivative"),),
        step=Call("plant_step"),
    ),
    "estimator": Program(outputs=(Call("torque_estimates"),)),
}
"""Unit to its program."""
