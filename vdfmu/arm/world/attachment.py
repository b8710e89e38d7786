"""The ends of an arm: a moving base, and a load with a mass. Not in the paper; off by default.

Subsystems of virtual decomposition exchange a motion one way and a wrench the other way at their cutting point. The
wrench of a load depends on the acceleration of the cutting point, ``M_e A_O + F_e``, and that acceleration on the
wrench. So the load passes on M_e and F_e, which do not depend on accelerations.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np

from vdfmu.arm.equations.flexible_joint import split_state
from vdfmu.arm.equations.forward_dynamics import Hanging, articulated, forward_dynamics
from vdfmu.arm.equations.inverse_dynamics import Base, ChainMotion, link_motion
from vdfmu.arm.equations.kinematics import tool_transform
from vdfmu.arm.equations.plant import driven
from vdfmu.arm.equations.spatial import skew, transform_mass_matrix
from vdfmu.compiler.scalar import jets


class Load(NamedTuple):
    """A load at the end effector, such as a second arm: the wrench of the arm on it is ``M_e A_O + F_e``."""

    M_e: Any
    """(6, 6) [kg, kg m, kg m2] apparent mass matrix in {O}, symmetric."""

    def hanging(self, robot: Any, V_B: np.ndarray) -> Hanging:
        """Return it as a body at the last link with the velocity `V_B`, which adds ``M_e A_O`` to F."""
        U_O = tool_transform(robot)
        turning = point_acceleration(U_O.T @ V_B, np.zeros(6))
        M = transform_mass_matrix(robot.tool_rotation, robot.tool_offset, self.M_e)
        return Hanging(M, U_O @ (self.M_e @ turning))

    def wrench(self, robot: Any, motion: ChainMotion) -> np.ndarray:
        """Return ``M_e A_O`` for a motion of the links: (6,) [N, N m] in {O}."""
        return self.M_e @ tool_acceleration(robot, motion.V_n, motion.V_n_dot)


def moving_base(R_S: np.ndarray, omega_S: Any, A_S: np.ndarray) -> Base:
    """Return the motion of a base for equations of forces: relative to its comoving frame, without linear velocity.

    `R_S` (3, 3) rotates {S} in {I}. `omega_S` (3,) [rad/s] and `A_S` (6,) [m/s2, rad/s2], the classical
    acceleration of the origin and the angular acceleration, are in {S}.
    """
    return Base(R_S, np.concatenate([np.zeros(3), omega_S]), A_S)


def turning_gravity(g: np.ndarray, V: np.ndarray, V_dot: np.ndarray) -> Any:
    """Gravity (3,) [m/s2] in a frame that moves with `V` and `V_dot`, (6,) each, with two derivatives: jets."""
    turning = skew(V[3:])
    g_dot = -(turning @ g)
    return jets(g, g_dot, -(skew(V_dot[3:]) @ g) - turning @ g_dot)


def seen_from_base(robot: Any, base: Base) -> tuple[Any, Base]:
    """Return the arm and its base in {S}, where gravity turns, with two time derivatives. A_S is constant."""
    zero = np.zeros(6)
    # the linear velocity stays 0: see `moving_base`
    V_S_dot = np.concatenate([np.zeros(3), base.V_S_dot[3:]])
    seen = replace(robot, gravity=turning_gravity(base.R_S.T @ robot.gravity, base.V_S, base.V_S_dot))
    return seen, Base(np.eye(3), jets(base.V_S, V_S_dot, zero), jets(base.V_S_dot, zero, zero))


def point_acceleration(V: np.ndarray, V_dot: np.ndarray) -> np.ndarray:
    """Classical acceleration of a frame's origin, and angular acceleration: (6,) [m/s2, rad/s2] in the frame.

    The derivative of the coordinates does not contain ``omega x v``, the rotation of the frame itself.
    """
    return np.concatenate([V_dot[:3] + skew(V[3:]) @ V[:3], V_dot[3:]])


def tool_acceleration(robot: Any, V_B: np.ndarray, V_B_dot: np.ndarray) -> np.ndarray:
    """:func:`point_acceleration` A_O of the end-effector frame {O}: (6,) in {O}; V_B, V_B_dot of the last link."""
    U_O = tool_transform(robot)
    return point_acceleration(U_O.T @ V_B, U_O.T @ V_B_dot)


def base_load(robot: Any, x: np.ndarray, tau: np.ndarray, F_e: np.ndarray, base: Base, load: Load | None) -> Hanging:
    """Return the plant as a body at its base, in {S}, on which the wrench of the base is ``M_S A_S + F_S0``.

    Arguments as in :func:`.plant_derivative`; the `base` has no linear velocity, and its `V_S_dot` is not used.
    """
    state = split_state(robot, x)
    tau_l, _, F_Dk, hanging = driven(robot, state, tau, base, load)
    a = articulated(robot, state.q, state.q_dot, tau_l, F_e, F_Dk, base, hanging)
    return Hanging(a.arm.M, a.arm.p + a.reaction)


def tool_motion(
    robot: Any, x: np.ndarray, tau: np.ndarray, F_e: np.ndarray, base: Base, load: Load | None = None
) -> tuple[np.ndarray, np.ndarray]:
    """Return V_O, without the base's linear velocity, and A_O, in {O}: (6,). Arguments: :func:`.plant_derivative`."""
    state = split_state(robot, x)
    tau_l, _, F_Dk, hanging = driven(robot, state, tau, base, load)
    q_ddot = forward_dynamics(robot, state.q, state.q_dot, tau_l, F_e, F_Dk, base, hanging)
    motion = link_motion(robot, state.q, state.q_dot, q_ddot, base)
    return tool_transform(robot).T @ motion.V_n, tool_acceleration(robot, motion.V_n, motion.V_n_dot)
