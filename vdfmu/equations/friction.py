"""Joint friction, Eq. (54)-(55), in two arrangements."""

from __future__ import annotations

from typing import Any

import numpy as np


def stribeck_friction(robot: Any, velocity: Any) -> Any:
    """Coulomb, Stribeck and viscous friction xi, Eq. (54): (n,) [N m or N], link-side.

    Deviations: sgn(v) is regularised as tanh(v / eps), so that the plant is an ordinary differential equation
    and sticking is a slow creep below eps; f_v is in N m s/rad, where Table 2 prints kg m/s.

    Parameters
    ----------
    velocity : (n,) [rad/s or m/s]
    """
    stribeck = robot.f_c + (robot.f_s - robot.f_c) * np.exp(-((velocity / robot.v_s) ** 2))
    return stribeck * np.tanh(velocity / robot.eps) + robot.f_v * velocity


def coulomb_friction(robot: Any, kappa_dot: Any) -> Any:
    """Coulomb friction of the rotor, Eq. (55): (n,) [N m], motor-side.

    Deviation: (55) is printed without its sign.
    """
    return robot.f_ck * np.tanh(kappa_dot / robot.eps)


def joint_friction(robot: Any, q_dot: Any, kappa_dot: Any) -> tuple[Any, Any]:
    """Friction on the link and on the rotor in the robot's arrangement.

    ``lumped`` (default, "typically identified as one item"): (54) acts on the rotor, f_ck is omitted.
    ``split`` (the paper's simulation text): (54) acts on the link, (55) on the rotor. It self-excites: the
    falling Stribeck branch has a slope down to -17 N m s/rad on wrist axes of 0.002 kg m2, which no feedback
    through the spring damps.

    Returns
    -------
    xi_l : (n,) [N m or N], link-side, on the link
    xi_m : (n,) [N m], motor-side, on the rotor
    """
    if robot.friction == "split":
        return stribeck_friction(robot, q_dot), coulomb_friction(robot, kappa_dot)
    return np.zeros(robot.n), stribeck_friction(robot, kappa_dot) / robot.ell
