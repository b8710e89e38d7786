"""The plant: links, drives and friction as one differential equation, Eq. (4)-(11), (29)-(47), (54)-(56)."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from vdfmu.arm.drive.dahl import dahl_energy, dahl_loss, dahl_rate
from vdfmu.arm.drive.limits import motor_torque, stop_energy, stop_torque
from vdfmu.arm.drive.thermal import temperature_rate
from vdfmu.arm.drive.winding import current_rate, winding_torque
from vdfmu.arm.equations.flexible_joint import (
    elastic_energy,
    rotor_acceleration,
    rotor_force,
    rotor_position,
    rotor_torque,
    rotor_velocities,
    spring_rate,
    stretch_rate,
)
from vdfmu.arm.equations.forward_dynamics import Rotors, apparent_load, forward_dynamics
from vdfmu.arm.equations.friction import bristles_rate, friction_loss, joint_friction
from vdfmu.arm.equations.inverse_dynamics import (
    Cut,
    inverse_dynamics,
    joint_torques,
    link_forces,
    link_motion,
    whole,
)
from vdfmu.arm.equations.kinematics import end_effector_pose, joint_placements, tool_transform
from vdfmu.arm.equations.rigid_body import link_body, mass_matrix
from vdfmu.arm.world.attachment import FREE, Base, Ends, tool_acceleration


class PlantState(NamedTuple):
    """State of the plant, each (n,): link positions, link and rotor velocities, link-side spring torques.

    Those of options are None without them: link-side torques of hysteresis and bristles, currents of the motors,
    temperatures of the joints.
    """

    q: Any
    q_dot: Any
    kappa_dot: Any
    tau_s: Any
    tau_h: Any = None
    tau_z: Any = None
    i_m: Any = None
    T_j: Any = None


OPTION_STATES = {"tau_h": "hysteresis", "tau_z": "bristles", "i_m": "winding", "T_j": "thermal"}
"""State to the option of the robot that has it."""


class Outputs(NamedTuple):
    """What the plant shows beside its state: rotor positions, end-effector pose in {I}, energies [J]."""

    kappa: Any
    p_O: Any
    R_O: Any
    E_kin: Any
    E_pot: Any
    E_spring: Any


def state_names(robot: Any) -> list[str]:
    """Names of a robot's states, in their order."""
    return [
        name
        for name in PlantState._fields
        if name not in OPTION_STATES or getattr(robot, OPTION_STATES[name])
    ]


def split_state(robot: Any, x: np.ndarray) -> PlantState:
    """View of a state vector ``x = [q, q_dot, kappa_dot, tau_s, ..]`` : (4 n,), longer with options."""
    names = state_names(robot)
    return PlantState(**dict(zip(names, np.split(x, len(names)), strict=True)))


def drive_torque(robot: Any, state: PlantState) -> Any:
    """Torque of the drives on the links, of springs and hysteresis: (n,) [N m or N], link-side."""
    return state.tau_s + state.tau_h if robot.hysteresis else state.tau_s


def _torques(robot: Any, state: PlantState, tau: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Torques on the links, ``tau_s - xi_l`` and what end stops add, and on the rotors about their axes, each (n,)."""
    load = drive_torque(robot, state)
    xi_l, xi_m = joint_friction(robot, state.q_dot, state.kappa_dot, load, state.tau_z, state.T_j)
    tau_l = load - xi_l
    if robot.limits:
        tau_l = tau_l + stop_torque(robot, state.q, state.q_dot)
        tau = motor_torque(robot, tau, state.kappa_dot)
    if robot.winding:
        tau = winding_torque(robot, state.i_m)
    return tau_l, rotor_torque(robot, tau, load, xi_m)  # after (11)


def _stretch(robot: Any, state: PlantState) -> Any:
    """Rate at which the drives are deformed: (n,) [rad/s or m/s]."""
    kappa = rotor_position(robot, state.q, state.tau_s)
    return stretch_rate(robot, kappa, state.kappa_dot, state.q_dot)


def drive_losses(robot: Any, state: PlantState) -> Any:
    """Power that friction and hysteresis turn into heat, never negative: (n,) [W]."""
    load = drive_torque(robot, state)
    loss = friction_loss(robot, state.q_dot, state.kappa_dot, load, state.tau_z, state.T_j)
    if robot.hysteresis:
        loss = loss + dahl_loss(_stretch(robot, state), state.tau_h, robot.f_h)
    return loss


def option_rates(robot: Any, x: np.ndarray, tau: np.ndarray) -> dict[str, Any]:
    """Return the rates of the states that options add, (n,) each, by the state's name. `x`, `tau` as in the plant."""
    state = split_state(robot, x)
    rates: dict[str, Any] = {}
    if robot.hysteresis:
        rates["tau_h"] = dahl_rate(robot.K_h, _stretch(robot, state), state.tau_h, robot.f_h)
    if robot.bristles:
        rates["tau_z"] = bristles_rate(robot, state.q_dot, state.kappa_dot, state.tau_z)
    if robot.winding:
        wanted = motor_torque(robot, tau, state.kappa_dot) if robot.limits else tau
        rates["i_m"] = current_rate(robot, wanted, state.kappa_dot, state.i_m)
    if robot.thermal:
        rates["T_j"] = temperature_rate(robot, drive_losses(robot, state), state.T_j)
    return rates


def rest_state(robot: Any, tau_s: Any) -> dict[str, Any]:
    """States that options add, where springs and motors hold the arm at rest: (n,) each, but for temperatures.

    Hysteresis and bristles are relaxed: the springs carry the load.
    """
    rest = {"tau_h": np.zeros(robot.n), "tau_z": np.zeros(robot.n)}
    if robot.winding:
        rest["i_m"] = tau_s / (robot.ell * robot.k_t)
    return rest


def plant_derivative(
    robot: Any, x: np.ndarray, tau: np.ndarray, F_e: np.ndarray, ends: Ends = FREE
) -> np.ndarray:
    """Right-hand side of the plant.

    Parameters
    ----------
    x : (4 n,) state, longer with options
    tau : (n,) [N m] motor torques, motor-side; with `winding` those that are asked for
    F_e : (6,) [N, N m] wrench that the arm exerts on its surroundings, in {O}
    ends : Ends
        Motion of the base, and mass of the load.

    Returns
    -------
    x_dot : as x
    """
    q, q_dot, kappa_dot, tau_s, *_ = state = split_state(robot, x)
    tau_l, tau_k = _torques(robot, state, tau)
    kappa = rotor_position(robot, q, tau_s)
    if robot.rotor_coupling:  # links and rotors as bodies: (4), (7), (9)-(11), (44)-(47)
        q_ddot = forward_dynamics(robot, q, q_dot, tau_l, F_e, Rotors(kappa_dot, tau_k), ends)
        kappa_ddot = rotor_acceleration(robot, tau_k, link_motion(robot, q, q_dot, q_ddot, base=ends.base))
    else:  # rotors in pure rotation: (56), and (46) without their reaction
        q_ddot = forward_dynamics(robot, q, q_dot, tau_l, F_e, ends=ends)
        kappa_ddot = rotor_acceleration(robot, tau_k)
    tau_s_dot = spring_rate(robot, kappa, kappa_dot, q_dot, tau_s)  # springs: (2)-(3)
    return np.concatenate([q_dot, q_ddot, kappa_ddot, tau_s_dot, *option_rates(robot, x, tau).values()])


def balance(
    robot: Any,
    x: np.ndarray,
    q_ddot: np.ndarray,
    tau: np.ndarray,
    F_e: np.ndarray,
    cut: Cut = whole,
    ends: Ends = FREE,
) -> tuple[np.ndarray, np.ndarray]:
    """Return the plant's equations of motion in implicit form, which are short to differentiate.

    Parameters
    ----------
    x, tau, F_e, ends : as in :func:`plant_derivative`
    q_ddot : (n,) [rad/s2 or m/s2]
    cut : see :data:`~vdfmu.arm.equations.inverse_dynamics.Cut`

    Returns
    -------
    links : (n,) [N m or N] ``tau_s - xi_l - ID(q, q_dot, q_ddot)``, with end stops, 0 for the plant's own q_ddot
    rotors : (n,) [rad/s2 or m/s2] kappa_ddot while the links accelerate by q_ddot
    """
    state = split_state(robot, x)
    tau_l, tau_k = _torques(robot, state, tau)
    motion = link_motion(robot, state.q, state.q_dot, q_ddot, cut, ends.base)
    if ends.M_e is not None:
        F_e = F_e + ends.M_e @ tool_acceleration(robot, motion.V_B[-1], motion.V_B_dot[-1])
    F_Dk = None
    if robot.rotor_coupling:
        V_D = rotor_velocities(robot, motion.V_B, state.kappa_dot, ends.base and ends.base.V_S)
        F_Dk = [rotor_force(robot, i, V_D[i], tau_k[i]) for i in range(robot.n)]
    torques = joint_torques(robot, link_forces(robot, motion, F_e, F_Dk, cut))
    return tau_l - torques, rotor_acceleration(robot, tau_k, motion if robot.rotor_coupling else None)


def equilibrium_torque(
    robot: Any, q: np.ndarray, F_e: np.ndarray | None = None, R_S: np.ndarray | None = None
) -> np.ndarray:
    """Spring torques that hold the arm at rest at `q` under the wrench `F_e` : (n,) [N m or N], link-side.

    `R_S` : (3, 3) rotation in {I} of a base, at rest here; None: that of {I}.
    """
    zero = np.zeros(robot.n)
    base = None if R_S is None else Base(R_S.T @ robot.gravity, np.zeros(6), np.zeros(6))
    return inverse_dynamics(robot, q, zero, zero, F_e, base=base)


class BasePose(NamedTuple):
    """Place p_S [m] and rotation R_S of the base frame {S} in {I}, and its velocity V_S in {S}."""

    p_S: Any
    R_S: Any
    V_S: Any


def plant_outputs(robot: Any, x: np.ndarray, base: BasePose | None = None) -> Outputs:
    """Return the outputs of the plant. They depend on its state, and on the motion of its base, alone.

    The rotor's kinetic energy is ``J_r s^2 / 2`` with ``J_r = I_m / ell`` and s its speed about its axis, the z
    component of V_D (4); in pure rotation (56) that is ``ell kappa_dot``. The potential energy is zero with all
    centres of mass at the height of the origin of {I}.
    """
    q, q_dot, kappa_dot, tau_s, *_ = state = split_state(robot, x)
    p_O, R_O = end_effector_pose(robot, q)
    p, R, moving = np.zeros(3), np.eye(3), None
    if base is not None:
        p, R = base.p_S, base.R_S
        p_O, R_O = p + R @ p_O, R @ R_O
        moving = Base(R.T @ robot.gravity, base.V_S, np.zeros(6))
    motion = link_motion(robot, q, q_dot, np.zeros(robot.n), base=moving)
    spin = kappa_dot
    if robot.rotor_coupling:
        V_D = rotor_velocities(robot, motion.V_B, kappa_dot, moving and moving.V_S)
        spin = np.array([V_Dk[5] for V_Dk in V_D]) / robot.ell
    E_kin = 0.5 * (robot.I_m * robot.ell) @ (spin * spin)
    E_pot = 0.0
    for i, (R_AB, p_AB) in enumerate(joint_placements(robot, q)):
        V_B = motion.V_B[i]
        m_B, r_B, I_B = link_body(robot, i)
        E_kin = E_kin + 0.5 * (V_B @ (mass_matrix(m_B, r_B, I_B) @ V_B))
        p = p + R @ p_AB
        R = R @ R_AB
        E_pot = E_pot + m_B * (robot.gravity @ (p + R @ r_B))
    E_spring = np.sum(elastic_energy(robot, tau_s))
    if robot.hysteresis:
        E_spring = E_spring + np.sum(dahl_energy(robot.K_h, state.tau_h))
    if robot.bristles:
        E_spring = E_spring + np.sum(dahl_energy(robot.sigma_0, state.tau_z))
    if robot.limits:
        E_spring = E_spring + np.sum(stop_energy(robot, q))
    return Outputs(rotor_position(robot, q, tau_s), p_O, R_O, E_kin, E_pot, E_spring)


def base_load(
    robot: Any, x: np.ndarray, tau: np.ndarray, F_e: np.ndarray, ends: Ends
) -> tuple[np.ndarray, np.ndarray]:
    """Return what the plant is for its base: M_S : (6, 6) and F_S0 : (6,) of :func:`apparent_load`.

    Parameters
    ----------
    x, tau, F_e, ends : as in :func:`plant_derivative`
    """
    state = split_state(robot, x)
    tau_l, tau_k = _torques(robot, state, tau)
    rotors = Rotors(state.kappa_dot, tau_k) if robot.rotor_coupling else None
    return apparent_load(robot, state.q, state.q_dot, tau_l, F_e, rotors, ends)


def tool_motion(
    robot: Any, x: np.ndarray, tau: np.ndarray, F_e: np.ndarray, ends: Ends
) -> tuple[np.ndarray, np.ndarray]:
    """Return velocity V_O and acceleration A_O of the end-effector frame {O}, (6,) each, in {O}.

    V_O is relative to the frame in which ``ends.base`` has no linear velocity; A_O is that of
    :func:`~vdfmu.arm.world.attachment.tool_acceleration`.
    """
    n, state = robot.n, split_state(robot, x)
    q_ddot = plant_derivative(robot, x, tau, F_e, ends)[n : 2 * n]
    motion = link_motion(robot, state.q, state.q_dot, q_ddot, base=ends.base)
    V_B, V_B_dot = motion.V_B[-1], motion.V_B_dot[-1]
    return tool_transform(robot).T @ V_B, tool_acceleration(robot, V_B, V_B_dot)
