"""Joint friction, Eq. (54)-(55), in two arrangements and with the options of a drive."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from vdfmu.arm.drive.option import Friction, Sliding
from vdfmu.arm.drive.options import options_of

States = Mapping[str, Any]
"""States of options, (n,) each, by name; empty along a desired motion."""


def friction_level(robot: Any, velocity: Any) -> Any:
    """Unsigned Coulomb and Stribeck friction at a speed, the bracket of (54): (n,) [N m or N], link-side."""
    return robot.f_c + (robot.f_s - robot.f_c) * np.exp(-((velocity / robot.v_s) ** 2))


def sliding_at(robot: Any, velocity: Any, kappa_dot: Any, load: Any) -> Sliding:
    """Quantities that friction depends on, at the velocity of (54). Parameters: see :func:`joint_friction`."""
    return Sliding(velocity, friction_level(robot, velocity), kappa_dot, load)


def friction_terms(robot: Any, sliding: Sliding, states: States | None = None) -> Friction:
    """Terms of Eq. (54), modified by the options."""
    friction = Friction(sliding.level * np.tanh(sliding.velocity / robot.eps), robot.f_v)
    for option, state in options_of(robot, states):
        friction = option.friction(friction, robot, sliding, state)
    return friction


def stribeck_friction(robot: Any, velocity: Any, states: States | None = None) -> Any:
    """Coulomb, Stribeck and viscous friction xi, Eq. (54): (n,) [N m or N], link-side.

    Deviations: sgn(v) is regularised as tanh(v / eps), so that the plant is an ordinary differential equation and
    sticking is a slow creep below eps; f_v is in N m s/rad, whereas Table 2 prints kg m/s. `velocity` is in rad/s or
    m/s; `states` are those of options, for example a temperature.
    """
    friction = friction_terms(robot, sliding_at(robot, velocity, velocity, 0.0), states)
    return friction.dry + friction.f_v * velocity


def linear_friction(robot: Any) -> Any:
    """Viscous and dry friction f_v and f_c: (n, 2), link-side. Without the Stribeck effect (54) is linear in them."""
    return np.stack([robot.f_v, robot.f_c], axis=1)


def friction_regressor(robot: Any, velocity: Any, direction: Any) -> Any:
    """Return Y, (n, 2), of the friction ``sum(Y * linear_friction, axis=1)`` at `velocity`, dry along `direction`."""
    return np.stack([velocity, np.tanh(direction / robot.eps)], axis=1)


def coulomb_friction(robot: Any, kappa_dot: Any) -> Any:
    """Coulomb friction of the rotor, Eq. (55): (n,) [N m], motor-side.

    Deviation: (55) is printed without its sign.
    """
    return robot.f_ck * np.tanh(kappa_dot / robot.eps)


def friction_velocity(robot: Any, q_dot: Any, kappa_dot: Any) -> Any:
    """Velocity at which (54) acts in the robot's arrangement: (n,) [rad/s or m/s]."""
    return {"split": q_dot, "lumped": kappa_dot}[robot.friction]


def joint_friction(
    robot: Any, q_dot: Any, kappa_dot: Any, load: Any = 0.0, states: States | None = None
) -> tuple[Any, Any]:
    """Friction on the link, (n,) [N m or N], link-side, and on the rotor, (n,) [N m], motor-side.

    ``lumped`` (default, "typically identified as one item"): (54) acts on the rotor, f_ck is omitted. ``split`` (the
    paper's simulation text): (54) acts on the link, (55) on the rotor. It is self-excited: the falling Stribeck branch
    has a slope down to -17 N m s/rad on wrist axes of 0.002 kg m2, which no feedback through the spring can damp.
    `load` is the torque of the drive, (n,) [N m or N], link-side.
    """
    velocity = friction_velocity(robot, q_dot, kappa_dot)
    xi = stribeck_friction(robot, velocity, states)
    xi_l, xi_m = {"lumped": (np.zeros(robot.n), xi / robot.ell), "split": (xi, coulomb_friction(robot, kappa_dot))}[
        robot.friction
    ]
    return xi_l, xi_m + friction_terms(robot, sliding_at(robot, velocity, kappa_dot, load), states).mesh


def friction_loss(robot: Any, q_dot: Any, kappa_dot: Any, load: Any = 0.0, states: States | None = None) -> Any:
    """Heat of friction, without power that bristles store: (n,) [W], at least 0. Parameters: :func:`joint_friction`."""
    xi_l, xi_m = joint_friction(robot, q_dot, kappa_dot, load, states)
    velocity = friction_velocity(robot, q_dot, kappa_dot)
    stored = friction_terms(robot, sliding_at(robot, velocity, kappa_dot, load), states).stored
    return xi_l * q_dot + xi_m * robot.ell * kappa_dot - stored
