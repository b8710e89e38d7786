"""The plant: links, drives and friction as one differential equation, Eq. (4)-(11), (29)-(47), (54)-(56)."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from vdfmu.equations.flexible_joint import rotor_acceleration, rotor_position, spring_rate
from vdfmu.equations.forward_dynamics import forward_dynamics
from vdfmu.equations.friction import joint_friction
from vdfmu.equations.harmonic_drive import spring_energy
from vdfmu.equations.inverse_dynamics import inverse_dynamics
from vdfmu.equations.kinematics import end_effector_pose, joint_placements, link_motion
from vdfmu.equations.limits import motor_torque, stop_energy, stop_torque
from vdfmu.equations.rigid_body import link_body, mass_matrix

__all__ = ["Outputs", "State", "equilibrium_torque", "plant_derivative", "plant_outputs", "split_state"]


class State(NamedTuple):
    """State of the plant, each (n,): link positions, link and rotor velocities, link-side spring torques."""

    q: Any
    q_dot: Any
    kappa_dot: Any
    tau_s: Any


class Outputs(NamedTuple):
    """What the plant shows beside its state: rotor positions, end-effector pose in {I}, energies [J]."""

    kappa: Any
    p_O: Any
    R_O: Any
    E_kin: Any
    E_pot: Any
    E_spring: Any


def split_state(x: np.ndarray) -> State:
    """View of a state vector ``x = [q, q_dot, kappa_dot, tau_s]`` : (4 n,)."""
    return State(*np.split(x, 4))


def plant_derivative(robot: Any, x: np.ndarray, tau: np.ndarray, F_e: np.ndarray) -> np.ndarray:
    """Right-hand side of the plant.

    Parameters
    ----------
    x : (4 n,) state
    tau : (n,) [N m] motor torques, motor-side
    F_e : (6,) [N, N m] wrench that the arm exerts on its surroundings, in {O}

    Returns
    -------
    x_dot : (4 n,)
    """
    q, q_dot, kappa_dot, tau_s = split_state(x)
    xi_l, xi_m = joint_friction(robot, q_dot, kappa_dot)
    if robot.limits:
        xi_l, tau = xi_l - stop_torque(robot, q, q_dot), motor_torque(robot, tau, kappa_dot)
    kappa = rotor_position(robot, q, tau_s)
    q_ddot = forward_dynamics(robot, q, q_dot, tau_s - xi_l, F_e)  # links: (9), (44)-(47)
    kappa_ddot = rotor_acceleration(robot, tau, tau_s, xi_m)  # rotors: (10), (56)
    tau_s_dot = spring_rate(robot, kappa, kappa_dot, q_dot, tau_s)  # springs: (2)-(3)
    return np.concatenate([q_dot, q_ddot, kappa_ddot, tau_s_dot])


def equilibrium_torque(robot: Any, q: np.ndarray, F_e: np.ndarray | None = None) -> np.ndarray:
    """Spring torques that hold the arm at rest at `q` under the wrench `F_e` : (n,) [N m or N], link-side."""
    zero = np.zeros(robot.n)
    return inverse_dynamics(robot, q, zero, zero, F_e)


def plant_outputs(robot: Any, x: np.ndarray) -> Outputs:
    """Return the outputs of the plant. They depend on its state alone: the plant has no direct feed-through.

    The rotor's kinetic energy is ``J_r (ell kappa_dot)^2 / 2 = I_m ell kappa_dot^2 / 2``, as ``I_m = J_r
    ell``. The potential energy is zero with all centres of mass at the height of the origin of {I}.
    """
    q, q_dot, kappa_dot, tau_s = split_state(x)
    motion = link_motion(robot, q, q_dot, np.zeros(robot.n))
    p_O, R_O = end_effector_pose(robot, q)
    E_kin = 0.5 * (robot.I_m * robot.ell) @ (kappa_dot * kappa_dot)
    E_pot = 0.0
    p, R = np.zeros(3), np.eye(3)
    for i, (R_AB, p_AB) in enumerate(joint_placements(robot, q)):
        V_B = motion.V_B[i]
        m_B, r_B, I_B = link_body(robot, i)
        E_kin = E_kin + 0.5 * (V_B @ (mass_matrix(m_B, r_B, I_B) @ V_B))
        p = p + R @ p_AB
        R = R @ R_AB
        E_pot = E_pot + m_B * (robot.gravity @ (p + R @ r_B))
    E_spring = np.sum(spring_energy(robot, tau_s))
    if robot.limits:
        E_spring = E_spring + np.sum(stop_energy(robot, q))
    return Outputs(rotor_position(robot, q, tau_s), p_O, R_O, E_kin, E_pot, E_spring)
