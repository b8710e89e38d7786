"""Options of a drive beyond the paper. Each is a record of rows in the table of parameters, a state, and seven laws."""

from __future__ import annotations

import re
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt

Array = npt.NDArray[Any]
Law = Callable[..., Any]


def row(*values: Any, **rest: Any) -> Any:
    """Field of a table of parameters; arguments: see :class:`~vdfmu.arm.robot.parameters.Row`, without the name."""
    return field(metadata={"row": values, "rest": rest})


class OptionState(NamedTuple):
    """State of the joints that an option adds to the plant, with the name, unit and text of the unit's variables."""

    name: str
    unit: str
    text: str
    start_text: str
    """Text of the parameter ``<name>_0``."""
    start: Any = 0.0
    """The parameter's value, or a function of the robot."""
    minimum: float | None = None
    slow: bool = False
    """Whether the state changes over minutes, so that the analysis of vibrations omits it."""


class Condition(NamedTuple):
    """Condition on parameters of a joint, skipped if the parameter `name` is part of an option with the value 0."""

    name: str
    """Parameter named in the message."""
    text: str
    """The condition with the names of its parameters, such as ``L_cb > 2*r_cb``."""
    margin: Law
    """Function of the robot that returns (n,), above 0 if the condition holds."""
    fix: str
    strict: bool = True
    """Whether the margin must be above 0 rather than at least 0."""

    @property
    def names(self) -> list[str]:
        """Parameters of the condition."""
        return re.findall(r"[A-Za-z]\w*", self.text)


class Spring(NamedTuple):
    """Springs of the drives under a torque, each (n,), link-side: deformation [rad or m], its slope, energy [J]."""

    deformation: Any
    compliance: Any
    energy: Any


class Parallel(NamedTuple):
    """In parallel with the springs, each (n,): torque [N m or N], link-side, dissipated power [W], energy [J]."""

    torque: Any = 0.0
    loss: Any = 0.0
    energy: Any = 0.0


class Friction(NamedTuple):
    """Friction of the joints, each (n,): `dry` and `f_v` link-side, `mesh` motor-side.

    `dry` is the friction of (54) with its sign [N m or N], `f_v` the viscous coefficient [N m s/rad or N s/m], `mesh`
    [N m] acts additionally on the rotor. The part `stored` [W] of the power is not heat; its integral is `energy` [J].
    """

    dry: Any
    f_v: Any
    mesh: Any = 0.0
    stored: Any = 0.0
    energy: Any = 0.0


class LinkTorque(NamedTuple):
    """Acting only on the links, each (n,): torque [N m or N], link-side, and energy [J]."""

    torque: Any = 0.0
    energy: Any = 0.0


class Sliding(NamedTuple):
    """Quantities that friction depends on, each (n,).

    `velocity` is the argument of (54), `level` its friction without sign [N m or N], `kappa_dot` the speed of the rotor
    divided by ell, `load` the torque of the drive [N m or N], link-side.
    """

    velocity: Any
    level: Any
    kappa_dot: Any
    load: Any


class JointMotion(NamedTuple):
    """Arguments of the states' rates, each (n,): those of :class:`Sliding` and three more.

    `stretch` is the rate of the deformation [rad/s or m/s], `tau` the torque requested of the motor [N m], motor-side,
    `loss` the power [W] that friction and all laws except the spring's dissipate.
    """

    velocity: Any
    level: Any
    kappa_dot: Any
    load: Any
    stretch: Any
    tau: Any
    loss: Any


def _same(value: Any, *_: Any) -> Any:
    return value


@dataclass(frozen=True, kw_only=True)
class DriveOption:
    """Laws of an option in addition to the paper's, as terms (n,) for all joints.

    ``robot`` has the option's parameters. ``state`` is the value of the option's state, or None along a desired motion.
    A law whose first argument is the value from the paper and earlier options returns the new value.
    """

    state: OptionState | None = None
    dry_parameters: tuple[str, ...] = ()
    """Parameters of dry friction, which have their smallest value in an arm without it."""
    replaces_dry_friction: bool = False
    """Whether its law replaces Coulomb and Stribeck friction."""
    conditions: tuple[Condition, ...] = ()
    revolute_only: tuple[str, ...] = ()
    """Parameters that must be 0 at prismatic joints."""

    spring: Law = _same
    """(spring, robot, tau_s): :class:`Spring`. In series, deformations, compliances and energies add."""
    parallel: Law | None = None
    """(robot, stretch, state): :class:`Parallel`, added to the spring's torque."""
    friction: Law = _same
    """(friction, robot, sliding, state): :class:`Friction` as a function of a :class:`Sliding`."""
    link: Law | None = None
    """(robot, q, q_dot): :class:`LinkTorque`. `q_dot` is None for a planned motion, which meets no stop."""
    motor: Law = _same
    """(tau, robot, kappa_dot, state): torque of the motor for a command `tau` [N m], motor-side."""
    rate: Law | None = None
    """(robot, motion, state): rate of the state, as a function of a :class:`JointMotion`."""
    rest: Law = lambda robot, tau_s: np.zeros(robot.n)
    """(robot, tau_s): state of an arm held at rest by springs and motors; None for the parameter's value."""
