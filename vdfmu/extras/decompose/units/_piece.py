"""Common parts of links and joints: numbers from the table of robots, and the signals at cutting points.

At a cutting point the unit nearer to the tip receives velocities and returns forces. A is the cutting point of a joint
towards the base, B the one between a joint and its link, C and D are those of a link towards the tip. A link has only
one frame, so its signals at {C} and {D} are in the frame {B} of its joint.
"""

from __future__ import annotations

from types import SimpleNamespace
from typing import TYPE_CHECKING, Any, ClassVar, TypeVar

import numpy as np

from vdfmu.arm.drive.options import OPTIONS, STATELESS
from vdfmu.arm.robot.parameters import ENDS, PARAMETERS, Section
from vdfmu.arm.signals import ACCELERATION, MASS, VELOCITY, WRENCH, six
from vdfmu.arm.world.payload import link_body
from vdfmu.base.measure import derivative_of, unit_of
from vdfmu.compiler.scalar import jets
from vdfmu.compiler.unit import Choice, Input, Output, Parameter, State, Switch, Unit

D = TypeVar("D", Input, Output, Parameter, State)
E = TypeVar("E", Input, Output)
JOINT: tuple[Section, ...] = ("joint", "drive", "friction", *STATELESS)
"""Sections of the table of robots with the parameters of a joint."""
TOOL = ("tool_offset", "tool_rotation")
"""Parameters of an arm's end."""


def numbers(*sections: Section, names: tuple[str, ...] = (), joint_type: str = "revolute") -> dict[str, Parameter]:
    """Return the parameters of one joint in sections of the table of robots, or those with `names`."""
    return {
        row.name: Parameter(
            row.unit(joint_type),
            row.shape,
            row.description[0].upper() + row.description[1:],
            start=next((start for start in (row.start, row.default) if start is not None), 0.0),
            minimum=row.smallest,
            maximum=row.largest,
        )
        for row in PARAMETERS.values()
        if row.section in sections and (not names or row.name in names)
    }


def rates(measure: tuple[tuple[str, ...], int], linear: str, angular: str, order: int) -> tuple[Any, Any, list[str]]:
    """Units, shape and texts of a 6-vector of a measure and its time derivatives up to `order`, one row each."""
    rows = [measure[0]]
    for _ in range(order):
        rows.append(tuple(derivative_of(unit) for unit in rows[-1]))
    texts = [f"{text}, derivative {k}" if k else text for k in range(order + 1) for text in six(linear, angular)]
    return tuple(unit for row in rows for unit in row), (order + 1, 6), texts


DESIRED_VELOCITY = rates(VELOCITY, "Desired velocity", "Desired angular velocity", 3)
_FORCES = rates(WRENCH, "Desired force", "Desired moment", 2)
DESIRED_FORCE = (
    (*_FORCES[0], *WRENCH[0]),
    (4, 6),
    [
        *_FORCES[2],
        *six("Desired force, rotors moving on their springs", "Desired moment, rotors moving on their springs"),
    ],
)
"""The desired force with two derivatives if rotors turn with their links; only the force if they move on their
springs."""


def six_vector(kind: type[D], measure: tuple[tuple[str, ...], int], linear: str, angular: str, at: str) -> D:
    """Return a 6-vector of a measure at a cutting point."""
    return kind(*measure, six(f"{linear} at {{{at}}}", f"{angular} at {{{at}}}"))


def desired_ports(at: str, kind: type[D], back: type[E]) -> dict[str, D | E]:
    """Return the signals at a cutting point of the feedforward: motions, of a `kind`, and the forces `back`."""
    return {
        f"V_{at}_d": kind(*DESIRED_VELOCITY),
        f"g_{at}_d": kind("m/s2", 3, f"Gravity vector of (62) at {{{at}}}, along the desired motion, axis"),
        f"V_{at}": six_vector(kind, VELOCITY, "Velocity", "Angular velocity", at),
        f"V_{at}_r": six_vector(kind, VELOCITY, "Required velocity", "Required angular velocity", at),
        f"V_{at}_r_dot": six_vector(kind, ACCELERATION, "Required acceleration", "Required angular acceleration", at),
        f"g_{at}": kind("m/s2", 3, f"Gravity vector of (62) at {{{at}}}, axis"),
        **desired_forces(at, back),
    }


def desired_forces(at: str, back: type[E]) -> dict[str, E]:
    """Return the forces of the feedforward at a cutting point."""
    return {
        f"F_{at}_d": back(*DESIRED_FORCE),
        f"F_{at}_r": six_vector(back, WRENCH, "Required force on the arm beyond the cut", "Required moment on it", at),
    }


def plant_ports(at: str, kind: type[D], back: type[E], hanging: Any = 0.0) -> dict[str, D | E]:
    """Return the signals at a cutting point of a plant: motions, of a `kind`, and `back` apparent mass and bias force.

    `hanging` is the apparent mass without a connection.
    """
    return {
        f"V_{at}": six_vector(kind, VELOCITY, "Velocity", "Angular velocity", at),
        f"g_{at}": kind("m/s2", 3, f"Gravity vector of (62) at {{{at}}}, axis"),
        f"V_{at}_dot": six_vector(kind, ACCELERATION, "Derivative of the velocity", "Angular acceleration", at),
        **apparent(at, back, hanging),
    }


def apparent(at: str, back: type[E], hanging: Any = 0.0) -> dict[str, E]:
    """Return apparent mass and bias force at a cutting point."""
    start = {"start": hanging} if back is Input else {}
    return {
        f"M_{at}": back(*MASS, f"Apparent mass matrix of the arm beyond {{{at}}}", **start),
        f"p_{at}": six_vector(back, WRENCH, "Bias force", "Bias moment", at),
    }


def row_pair(V: np.ndarray) -> tuple[Any, Any]:
    """Return a velocity and its derivative, with two derivatives each, from the four rows of `V`: (6,) jets."""
    return jets(*V[:3]), jets(*V[1:])


def of_joint(kind: type[D], signal: tuple[str, Any, str], joint_type: str, **rest: Any) -> D:
    """Return a variable of one joint: `signal` has its quantity, the shape for an arm, and its text."""
    quantity, _, text = signal
    return kind(unit_of(quantity, joint_type), (), text[0].upper() + text[1:], **rest)


def coupling() -> Switch:
    """Return the switch of the rotor's coupling to its carrier."""
    return Switch(
        True, "Whether the rotor also moves with its carrier, Eq. (4), (7), (11); else only about its axis, (56)"
    )


def friction_choice() -> Choice:
    """Return the arrangement of the friction."""
    return Choice("lumped", "split", text="Friction; 0: lumped, all on the rotor, 1: split, Eq. (54) on the link")


class Piece(Unit):
    """A link or a joint, calculated by the equations of a robot with only this joint.

    It also has model exchange, even without states, because a master that integrates components together can then read
    outputs between setting inputs.
    """

    exchange: ClassVar[bool] = True
    sampled: ClassVar[bool | None] = False
    joint_type: ClassVar[str] = "revolute"

    if TYPE_CHECKING:  # variables that `numbers` and others declare

        def __getattr__(self, name: str) -> Any: ...

    def robot_of_joint(self, **attributes: Any) -> Any:
        """Return a robot of one joint with the numbers of the unit, and `attributes`."""
        values = {name: getattr(self, name) for name in PARAMETERS if name in self.declared}
        arrays = {name: np.asarray(v)[None if PARAMETERS[name].per_joint else ...] for name, v in values.items()}
        flags = dict.fromkeys((*OPTIONS, "payload", "rotor_coupling", *ENDS), False)
        flags |= dict.fromkeys({PARAMETERS[name].section for name in values}.intersection(STATELESS), True)
        robot = SimpleNamespace(n=1, joint_types=(self.joint_type,), **{**flags, **arrays, **attributes})
        robot.body = lambda i: link_body(robot, i)
        return robot
