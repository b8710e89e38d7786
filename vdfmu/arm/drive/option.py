"""Options of a drive beyond the paper, each a record: rows of the table of parameters, a state, and hooks."""

from __future__ import annotations

import re
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt

Array = npt.NDArray[Any]
Hook = Callable[..., Any]


def row(*values: Any, **rest: Any) -> Any:
    """Field of a table of parameters; arguments: see :class:`~vdfmu.arm.robot.parameters.Row`, without the name."""
    return field(metadata={"row": values, "rest": rest})


class OptionState(NamedTuple):
    """State of the joints that an option adds to the plant: name, unit and text of the unit's variables."""

    name: str
    unit: str
    text: str
    start_text: str
    """Text of the parameter ``<name>_0``."""
    start: Any = 0.0
    """Its value, or a function of the robot."""
    minimum: float | None = None
    slow: bool = False
    """Whether it changes over minutes, so that vibrations know nothing of it."""


class Condition(NamedTuple):
    """Condition on parameters of a joint; not asked where what `name` is a part of is 0."""

    name: str
    """Parameter that a message is about."""
    text: str
    """The condition with the names of its parameters, such as ``L_cb > 2*r_cb``."""
    margin: Hook
    """(robot): (n,), above 0 where it holds."""
    way_out: str
    strict: bool = True
    """Whether a margin of 0 is too small."""

    @property
    def names(self) -> list[str]:
        """Its parameters."""
        return re.findall(r"[A-Za-z]\w*", self.text)


class JointMotion(NamedTuple):
    """Quantities that the rates of states may depend on, each (n,)."""

    kappa_dot: Any
    """Speed of the rotor divided by ell [rad/s or m/s]."""
    stretch: Any
    """Rate at which the drive is deformed [rad/s or m/s]."""
    velocity: Any
    """At which (54) acts [rad/s or m/s]."""
    level: Any
    """Coulomb and Stribeck friction at that speed, without sign [N m or N], link-side."""
    tau: Any
    """Torque that the motor is asked for [N m], motor-side."""
    loss: Any
    """Power that friction and hysteresis turn into heat [W]."""


def _nothing(*_: Any) -> float:
    return 0.0


def _same(value: Any, *_: Any) -> Any:
    return value


@dataclass(frozen=True, kw_only=True)
class DriveOption:
    """Terms that an option adds to the equations of a joint. All is (n,), and 0 unless the option says so.

    ``robot`` has its parameters; ``own`` is its state, None along a desired motion, which has none.
    """

    state: OptionState | None = None
    dry_parameters: tuple[str, ...] = ()
    """Parameters of dry friction: 0, or as small as they may be, in an arm without."""

    conditions: tuple[Condition, ...] = ()
    """Conditions on its parameters."""
    revolute_only: tuple[str, ...] = ()
    """Parameters that must be 0 at prismatic joints."""

    deformation: Hook = _nothing
    """(robot, tau_s): deformation in series with the spring [rad or m], link-side."""
    compliance: Hook = _nothing
    """(robot, tau_s): its slope [rad/(N m) or m/N]."""
    elastic_energy: Hook = _nothing
    """(robot, tau_s): its energy [J]."""

    torque: Hook = _nothing
    """(robot, own): torque of the drive in addition to the spring's [N m or N], link-side."""
    energy: Hook = _nothing
    """(robot, own): energy that the state stands for [J]."""
    stop_torque: Hook = _nothing
    """(robot, q, q_dot): torque of end stops on the link alone [N m or N], link-side; no motion is planned there."""
    link_torque: Hook = _nothing
    """(robot, q): torque on the link alone that every motion meets, as gravity's [N m or N], link-side."""
    link_energy: Hook = _nothing
    """(robot, q): energy of both [J]."""

    mesh_friction: Hook = _nothing
    """(robot, kappa_dot, load): friction on the rotor [N m], motor-side, of a drive that carries a load, link-side."""
    dry_friction: Hook = _same
    """(xi, robot, velocity, level, own): friction instead of ``xi = level tanh(velocity / eps)`` in (54)."""
    viscosity: Hook = _same
    """(f_v, robot, velocity, own): coefficient of viscous friction instead of `f_v`."""
    stored: Hook = _nothing
    """(robot, velocity, level, own): the part of the power of friction that is stored [W]."""

    motor: Hook = _same
    """(tau, robot, kappa_dot, own): torque of the motor where `tau` is asked for [N m], motor-side."""
    rate: Hook = _nothing
    """(robot, motion, own): rate of the state, by a :class:`JointMotion`."""
    loss: Hook = _nothing
    """(robot, stretch, own): power that turns into heat in addition to friction's [W]."""
    rest: Hook = lambda robot, tau_s: np.zeros(robot.n)
    """(robot, tau_s): state where springs and motors hold the arm at rest; None: its parameter's value."""

    @property
    def replaces_dry_friction(self) -> bool:
        """Whether it has a law of its own instead of Coulomb and Stribeck friction."""
        return self.dry_friction is not _same
