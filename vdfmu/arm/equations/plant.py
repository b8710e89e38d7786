"""The plant: links, drives and friction as one differential equation, Eq. (4)-(11), (29)-(47), (54)-(56)."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from vdfmu.arm.equations.flexible_joint import (
    PlantState,
    driven_rotor_forces,
    link_torques,
    option_rates,
    plant_torques,
    rotor_acceleration,
    rotor_position,
    rotor_velocities,
    split_state,
    spring_rate,
    stored_energy,
)
from vdfmu.arm.equations.forward_dynamics import forward_dynamics
from vdfmu.arm.equations.inverse_dynamics import (
    AT_REST,
    NO_WRENCH,
    Base,
    inverse_dynamics,
    joint_torques,
    link_forces,
    link_motion,
    link_velocities,
)
from vdfmu.arm.equations.kinematics import link_outputs, total


class Outputs(NamedTuple):
    """Outputs of the plant in addition to its state: rotor positions, end-effector pose in {I}, energies [J]."""

    kappa: Any
    p_O: Any
    R_O: Any
    E_kin: Any
    E_pot: Any
    E_spring: Any


def driven(robot: Any, state: PlantState, tau: Any, base: Base, load: Any) -> tuple[Any, Any, list[np.ndarray], Any]:
    """Return tau_l and tau_k of :func:`.plant_torques`, F_Dk (10), and the load as a `Hanging` or None."""
    tau_l, tau_k = plant_torques(robot, state, tau)  # (9), (11), (54)-(55)
    links = link_velocities(robot, state.q, state.q_dot, base)  # (29)-(31)
    F_Dk = driven_rotor_forces(robot, links, state.kappa_dot, tau_k)  # (4), (10)
    return tau_l, tau_k, F_Dk, None if load is None else load.hanging(robot, links.V_n)


def plant_derivative(
    robot: Any, x: np.ndarray, tau: np.ndarray, F_e: np.ndarray, base: Base = AT_REST, load: Any = None
) -> np.ndarray:
    """Right-hand side of the plant, x_dot.

    Parameters
    ----------
    x : (4 n,) state, longer with options
    tau : (n,) [N m] motor torques, motor-side; with `winding` their commands
    F_e : (6,) [N, N m] wrench of the arm on its surroundings, in {O}; with a load, its wrench at `A_O = 0`
    load : vdfmu.arm.world.attachment.Load, optional
        A load with a mass at the end effector.
    """
    state = split_state(robot, x)
    tau_l, tau_k, F_Dk, hanging = driven(robot, state, tau, base, load)
    q_ddot = forward_dynamics(robot, state.q, state.q_dot, tau_l, F_e, F_Dk, base, hanging)  # (9), (11), (44)-(47)
    motion = link_motion(robot, state.q, state.q_dot, q_ddot, base)
    kappa_ddot = rotor_acceleration(robot, tau_k, motion)  # rotors: (4), (7), (10), (56)
    tau_s_dot = spring_rate(robot, state)  # springs: (2)-(3)
    return np.concatenate([state.q_dot, q_ddot, kappa_ddot, tau_s_dot, *option_rates(robot, state, tau).values()])


def balance(
    robot: Any,
    x: np.ndarray,
    x_dot: np.ndarray,
    tau: np.ndarray,
    F_e: np.ndarray,
    base: Base = AT_REST,
    load: Any = None,
) -> np.ndarray:
    """Residual of the plant's implicit equations, 0 at the right x_dot. Its symbolic derivatives are short expressions.

    For links it is ``tau_s - xi_l - ID(q, q_dot, q_ddot)`` [N m or N] plus the torques of options, for the other states
    the difference of rates. Parameters: see :func:`plant_derivative`.
    """
    state, rate = split_state(robot, x), split_state(robot, x_dot)
    tau_l, tau_k = plant_torques(robot, state, tau)  # (9), (11), (54)-(55)
    motion = link_motion(robot, state.q, state.q_dot, rate.q_dot, base)  # (29)-(31)
    F_Dk = driven_rotor_forces(robot, motion, state.kappa_dot, tau_k)  # (4), (7), (10)
    if load is not None:
        F_e = F_e + load.wrench(robot, motion)
    links = tau_l - joint_torques(robot, link_forces(robot, motion, F_e, F_Dk))  # (11), (44)-(47)
    rotors = rotor_acceleration(robot, tau_k, motion) - rate.kappa_dot
    springs = spring_rate(robot, state) - rate.tau_s
    added = [option_rate - rate.options[name] for name, option_rate in option_rates(robot, state, tau).items()]
    return np.concatenate([state.q_dot - rate.q, links, rotors, springs, *added])


def equilibrium_torque(robot: Any, q: np.ndarray, F_e: np.ndarray = NO_WRENCH, base: Base = AT_REST) -> np.ndarray:
    """Spring torques that hold the arm at rest at `q` under the wrench `F_e` : (n,) [N m or N], link-side."""
    zero = np.zeros(robot.n)
    return inverse_dynamics(robot, q, zero, zero, F_e, base=base) - link_torques(robot, q)


_ORIGIN = np.zeros(3)


def plant_outputs(robot: Any, x: np.ndarray, p_S: Any = _ORIGIN, base: Base = AT_REST) -> Outputs:
    """Return the outputs of the plant, which depend only on its state and on the motion of its base.

    The rotor's kinetic energy is ``J_r s^2 / 2`` with ``J_r = I_m / ell`` and s its speed about its axis, the z
    component of V_D (4); in pure rotation (56) that is ``ell kappa_dot``. The potential energy is zero with all
    centres of mass at the height of the origin of {I}. `p_S` (3,) [m] is the place of the base in {I}.
    """
    state = split_state(robot, x)
    motion = link_velocities(robot, state.q, state.q_dot, base)
    links = link_outputs(robot, state.q, motion.V_B, p_S, base.R_S)
    V_D = rotor_velocities(robot, motion.V_B, state.kappa_dot, base.V_S)  # (4)
    spin = np.array([V_Dk[5] for V_Dk in V_D]) / robot.ell
    E_kin = total(0.5 * (robot.I_m * robot.ell) * (spin * spin))
    return Outputs(
        kappa=rotor_position(robot, state.q, state.tau_s),
        p_O=links.p_O,
        R_O=links.R_O,
        E_kin=total(links.kinetic, E_kin),
        E_pot=total(links.potential),
        E_spring=stored_energy(robot, state),
    )
