"""Springs and rotors along a desired motion of the links, from two time derivatives of Eq. (2)-(3), (9), (44)-(47)."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from vdfmu.arm.equations.flexible_joint import link_torques, rotor_position
from vdfmu.arm.equations.friction import joint_friction
from vdfmu.arm.equations.inverse_dynamics import AT_REST, NO_WRENCH, Base, inverse_dynamics
from vdfmu.arm.equations.trajectory import Desired
from vdfmu.arm.world.attachment import seen_from_base
from vdfmu.compiler.scalar import derivative, jets


class DriveMotion(NamedTuple):
    """Spring torque, rotor motion, and friction of links (link-side) and rotors (motor-side), each (n,)."""

    tau_s: Any
    kappa: Any
    kappa_dot: Any
    kappa_ddot: Any
    xi_l: Any
    xi_m: Any


def desired_drive_motion(
    robot: Any, desired: Desired, F_e_d: np.ndarray = NO_WRENCH, base: Base = AT_REST
) -> DriveMotion:
    """Motion of springs and rotors while the links follow the desired motion exactly.

    ``tau_s = ID(q_d, ..) + xi_l`` and ``kappa = q_d + D(tau_s) + theta_err``. The two derivatives of kappa are computed
    with jets from q_d and its derivatives up to the fourth. The derivatives of the wrench `F_e_d`, and of the
    acceleration of a moving base, are assumed to be zero.

    With `rotor_coupling` ID contains the rotors' reaction (11), as if each rotor moved like its link. The acceleration
    of the deformation would need two more derivatives of q_d for each joint of the chain. Its part of kappa, ``D' I_m
    D_ddot``, is omitted here but included in the torques of :func:`feedforward_inverse`. An exact inverse does not
    exist, because D'' of (3) jumps when a torque crosses 0, and the rotors of earlier joints would have to jump with
    it.
    """
    q, q_dot, q_ddot = desired_jets(desired)
    seen, base_jets = seen_from_base(robot, base)
    return drive_motion(robot, q, q_dot, inverse_dynamics(seen, q, q_dot, q_ddot, F_e_d, (q_dot, q_ddot), base_jets))


def desired_jets(desired: Desired) -> tuple[Any, Any, Any]:
    """Return q_d, q_d_dot and q_d_ddot with two derivatives each, (n,) jets."""
    q_d, q_d_dot, q_d_ddot, q_d_dddot, q_d_ddddot = desired
    return jets(q_d, q_d_dot, q_d_ddot), jets(q_d_dot, q_d_ddot, q_d_dddot), jets(q_d_ddot, q_d_dddot, q_d_ddddot)


def drive_motion(robot: Any, q: Any, q_dot: Any, tau: Any) -> DriveMotion:
    """Motion of springs and rotors for jets (n,) of the desired motion and of the torques `tau` on the links.

    ``tau_s = tau + xi_l`` of (9), minus :func:`link_torques`.
    """
    xi_l, _ = joint_friction(robot, q_dot, q_dot)
    torque = tau - link_torques(robot, q) + xi_l
    kappa = rotor_position(robot, q, torque)
    tau_s, kappa_dot = derivative(torque, 0), derivative(kappa, 1)
    xi_l, xi_m = joint_friction(robot, derivative(q_dot, 0), kappa_dot, tau_s)
    return DriveMotion(tau_s, derivative(kappa, 0), kappa_dot, derivative(kappa, 2), xi_l, xi_m)
