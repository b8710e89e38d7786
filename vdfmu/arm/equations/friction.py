"""Joint friction, Eq. (54)-(55), in two arrangements; with options, its load, its temperature and its bristles."""

from __future__ import annotations

from typing import Any

import numpy as np

from vdfmu.arm.drive.bristles import bristle_rate, bristle_torque
from vdfmu.arm.drive.load_loss import mesh_friction
from vdfmu.arm.drive.thermal import viscosity


def friction_level(robot: Any, velocity: Any) -> Any:
    """Coulomb and Stribeck friction at a speed, the bracket of (54), without sign: (n,) [N m or N], link-side."""
    return robot.f_c + (robot.f_s - robot.f_c) * np.exp(-((velocity / robot.v_s) ** 2))


def stribeck_friction(robot: Any, velocity: Any, tau_z: Any = None, T_j: Any = None) -> Any:
    """Coulomb, Stribeck and viscous friction xi, Eq. (54): (n,) [N m or N], link-side.

    Deviations: sgn(v) is regularised as tanh(v / eps), so that the plant is an ordinary differential equation
    and sticking is a slow creep below eps; f_v is in N m s/rad, where Table 2 prints kg m/s.

    Parameters
    ----------
    velocity : (n,) [rad/s or m/s]
    tau_z : (n,) [N m or N], optional
        Torque of bristles in place of tanh.
    T_j : (n,) [K], optional
        Temperature of an arm whose viscous friction depends on it; default that of the surroundings.
    """
    level = friction_level(robot, velocity)
    if tau_z is None:
        dry = level * np.tanh(velocity / robot.eps)
    else:
        dry = bristle_torque(robot, velocity, tau_z, level)
    return dry + viscosity(robot, T_j) * velocity


def coulomb_friction(robot: Any, kappa_dot: Any) -> Any:
    """Coulomb friction of the rotor, Eq. (55): (n,) [N m], motor-side.

    Deviation: (55) is printed without its sign.
    """
    return robot.f_ck * np.tanh(kappa_dot / robot.eps)


def joint_friction(
    robot: Any, q_dot: Any, kappa_dot: Any, load: Any = 0.0, tau_z: Any = None, T_j: Any = None
) -> tuple[Any, Any]:
    """Friction on the link and on the rotor in the robot's arrangement.

    ``lumped`` (default, "typically identified as one item"): (54) acts on the rotor, f_ck is omitted.
    ``split`` (the paper's simulation text): (54) acts on the link, (55) on the rotor. It self-excites: the
    falling Stribeck branch has a slope down to -17 N m s/rad on wrist axes of 0.002 kg m2, which no feedback
    through the spring damps.

    Parameters
    ----------
    load : (n,) [N m or N] torque of the drive, link-side, which loads the mesh of a robot with load_loss
    tau_z, T_j : see :func:`stribeck_friction`

    Returns
    -------
    xi_l : (n,) [N m or N], link-side, on the link
    xi_m : (n,) [N m], motor-side, on the rotor
    """
    if robot.friction == "split":
        xi_l, xi_m = stribeck_friction(robot, q_dot, tau_z, T_j), coulomb_friction(robot, kappa_dot)
    else:
        xi_l, xi_m = np.zeros(robot.n), stribeck_friction(robot, kappa_dot, tau_z, T_j) / robot.ell
    if robot.load_loss:
        xi_m = xi_m + mesh_friction(robot, kappa_dot, load)
    return xi_l, xi_m


def bristles_rate(robot: Any, q_dot: Any, kappa_dot: Any, tau_z: Any) -> Any:
    """Rate of the bristles' torque, which act where (54) does: (n,) [N m/s or N/s]."""
    velocity = q_dot if robot.friction == "split" else kappa_dot
    return bristle_rate(robot, velocity, tau_z, friction_level(robot, velocity))


def friction_loss(
    robot: Any, q_dot: Any, kappa_dot: Any, load: Any = 0.0, tau_z: Any = None, T_j: Any = None
) -> Any:
    """Power that friction turns into heat, never negative: (n,) [W]. Parameters as of :func:`joint_friction`.

    It is the power that friction takes, but for what bristles store and give back.
    """
    xi_l, xi_m = joint_friction(robot, q_dot, kappa_dot, load, tau_z, T_j)
    power = xi_l * q_dot + xi_m * robot.ell * kappa_dot
    if tau_z is None:
        return power
    return power - tau_z * bristles_rate(robot, q_dot, kappa_dot, tau_z) / robot.sigma_0


def dry_friction(robot: Any) -> tuple[str, ...]:
    """Names of the parameters that are 0, or as small as they may be, in an arm without dry friction."""
    return ("f_ck", "mu_l", *(("sigma_0", "sigma_1") if robot.bristles else ("f_c", "f_s")))
