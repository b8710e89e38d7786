"""The plant: links, drives and friction as one differential equation, Eq. (4)-(11), (29)-(47), (54)-(56)."""

from __future__ import annotations

from collections.abc import Mapping
from types import MappingProxyType
from typing import Any, NamedTuple

import numpy as np

from vdfmu.arm.drive.option import JointMotion
from vdfmu.arm.drive.options import OPTION_STATES, options_of
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
from vdfmu.arm.equations.friction import friction_level, friction_loss, friction_velocity, joint_friction
from vdfmu.arm.equations.inverse_dynamics import inverse_dynamics, joint_torques, link_forces, link_motion
from vdfmu.arm.equations.kinematics import end_effector_pose, joint_placements, tool_transform
from vdfmu.arm.equations.rigid_body import link_body, mass_matrix
from vdfmu.arm.world.attachment import AT_REST, FREE, NO_WRENCH, Base, Ends, tool_acceleration


class PlantState(NamedTuple):
    """State of the plant, each (n,): link positions, link and rotor velocities, link-side spring torques.

    And the states of options by name, such as link-side torques of hysteresis.
    """

    q: Any
    q_dot: Any
    kappa_dot: Any
    tau_s: Any
    options: Mapping[str, Any] = MappingProxyType({})


class Outputs(NamedTuple):
    """Outputs of the plant in addition to its state: rotor positions, end-effector pose in {I}, energies [J]."""

    kappa: Any
    p_O: Any
    R_O: Any
    E_kin: Any
    E_pot: Any
    E_spring: Any


def state_names(robot: Any) -> list[str]:
    """Names of a robot's states, in their order."""
    added = [name for name, option in OPTION_STATES.items() if getattr(robot, option)]
    return ["q", "q_dot", "kappa_dot", "tau_s", *added]


def split_state(robot: Any, x: np.ndarray) -> PlantState:
    """View of a state vector ``x = [q, q_dot, kappa_dot, tau_s, ..]`` : (4 n,), longer with options."""
    names = state_names(robot)
    parts = np.split(x, len(names))
    return PlantState(*parts[:4], options=dict(zip(names[4:], parts[4:], strict=True)))


def drive_torque(robot: Any, state: PlantState) -> Any:
    """Torque of the drives on the links, of springs and of options: (n,) [N m or N], link-side."""
    load = state.tau_s
    for option, own in options_of(robot, state.options):
        load = load + option.torque(robot, own)
    return load


def plant_torques(robot: Any, state: PlantState, tau: Any) -> tuple[Any, Any]:
    """Torques on the links, ``tau_s - xi_l`` and what end stops add, and on the rotors about their axes, each (n,).

    Returns
    -------
    tau_l : (n,) [N m or N], link-side
    tau_k : (n,) [N m], motor-side, ``z.T F_Dk = tau - tau_s / ell - xi_m`` after (11)
    """
    load = drive_torque(robot, state)
    xi_l, xi_m = joint_friction(robot, state.q_dot, state.kappa_dot, load, state.options)
    tau_l = load - xi_l
    for option, own in options_of(robot, state.options):
        tau_l = tau_l + option.stop_torque(robot, state.q, state.q_dot)
        tau = option.motor(tau, robot, state.kappa_dot, own)
    return tau_l, rotor_torque(robot, tau, load, xi_m)


def _stretch(robot: Any, state: PlantState) -> Any:
    """Rate at which the drives are deformed: (n,) [rad/s or m/s]."""
    kappa = rotor_position(robot, state.q, state.tau_s)
    return stretch_rate(robot, kappa, state.kappa_dot, state.q_dot)


def drive_losses(robot: Any, state: PlantState) -> Any:
    """Power that friction and hysteresis turn into heat, never negative: (n,) [W]."""
    load, stretch = drive_torque(robot, state), _stretch(robot, state)
    loss = friction_loss(robot, state.q_dot, state.kappa_dot, load, state.options)
    for option, own in options_of(robot, state.options):
        loss = loss + option.loss(robot, stretch, own)
    return loss


def option_rates(robot: Any, state: PlantState, tau: Any) -> dict[str, Any]:
    """Return the rates of the states that options add, (n,) each, by the state's name. `tau` as in the plant."""
    rates: dict[str, Any] = {}
    if not state.options:
        return rates
    velocity = friction_velocity(robot, state.q_dot, state.kappa_dot)
    motion = JointMotion(
        kappa_dot=state.kappa_dot,
        stretch=_stretch(robot, state),
        velocity=velocity,
        level=friction_level(robot, velocity),
        tau=tau,
        loss=drive_losses(robot, state),
    )
    for option, own in options_of(robot, state.options):
        if option.state:
            rates[option.state.name] = option.rate(robot, motion, own)
        motion = motion._replace(tau=option.motor(motion.tau, robot, state.kappa_dot, own))
    return rates


def rest_state(robot: Any, tau_s: Any) -> dict[str, Any]:
    """States that options add, where springs and motors hold the arm at rest: (n,) each, except for temperatures.

    Hysteresis and bristles are relaxed: the springs carry the load.
    """
    rest = {option.state.name: option.rest(robot, tau_s) for option, _ in options_of(robot) if option.state}
    return {name: value for name, value in rest.items() if value is not None}


def plant_derivative(robot: Any, x: np.ndarray, tau: np.ndarray, F_e: np.ndarray, ends: Ends = FREE) -> np.ndarray:
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
    q, q_dot, kappa_dot, tau_s, _ = state = split_state(robot, x)
    tau_l, tau_k = plant_torques(robot, state, tau)
    rotors = Rotors(kappa_dot, tau_k)
    q_ddot = forward_dynamics(robot, q, q_dot, tau_l, F_e, rotors, ends)  # links: (9), (11), (44)-(47)
    motion = link_motion(robot, q, q_dot, q_ddot, ends.base)
    kappa_ddot = rotor_acceleration(robot, tau_k, motion)  # rotors: (4), (7), (10), (56)
    kappa = rotor_position(robot, q, tau_s)
    tau_s_dot = spring_rate(robot, kappa, kappa_dot, q_dot, tau_s)  # springs: (2)-(3)
    return np.concatenate([q_dot, q_ddot, kappa_ddot, tau_s_dot, *option_rates(robot, state, tau).values()])


def balance(
    robot: Any, x: np.ndarray, x_dot: np.ndarray, tau: np.ndarray, F_e: np.ndarray, ends: Ends = FREE
) -> np.ndarray:
    """Return the plant's equations in implicit form, which are short to differentiate: 0 for its own x_dot.

    Those of the links are ``tau_s - xi_l - ID(q, q_dot, q_ddot)`` [N m or N], with end stops; the others are the
    differences of rates.

    Parameters
    ----------
    x, tau, F_e, ends : as in :func:`plant_derivative`
    x_dot : as x

    Returns
    -------
    residual : as x
    """
    state, rate = split_state(robot, x), split_state(robot, x_dot)
    tau_l, tau_k = plant_torques(robot, state, tau)
    motion = link_motion(robot, state.q, state.q_dot, rate.q_dot, ends.base)
    F_e = F_e + ends.M_e @ tool_acceleration(robot, motion.V_B[-1], motion.V_B_dot[-1])
    V_D = rotor_velocities(robot, motion.V_B, state.kappa_dot, ends.base.V_S)  # (4)
    F_Dk = [rotor_force(robot, i, V_D[i], tau_k[i]) for i in range(robot.n)]  # (7), (10)
    links = tau_l - joint_torques(robot, state.q, link_forces(robot, motion, F_e, F_Dk))  # (11), (44)-(47)
    rotors = rotor_acceleration(robot, tau_k, motion) - rate.kappa_dot
    kappa = rotor_position(robot, state.q, state.tau_s)
    springs = spring_rate(robot, kappa, state.kappa_dot, state.q_dot, state.tau_s) - rate.tau_s
    added = [own - rate.options[name] for name, own in option_rates(robot, state, tau).items()]
    return np.concatenate([state.q_dot - rate.q, links, rotors, springs, *added])


def equilibrium_torque(robot: Any, q: np.ndarray, F_e: np.ndarray = NO_WRENCH, base: Base = AT_REST) -> np.ndarray:
    """Spring torques that hold the arm at rest at `q` under the wrench `F_e` : (n,) [N m or N], link-side."""
    zero = np.zeros(robot.n)
    return inverse_dynamics(robot, q, zero, zero, F_e, base=base)


_ORIGIN = np.zeros(3)


def plant_outputs(robot: Any, x: np.ndarray, p_S: Any = _ORIGIN, base: Base = AT_REST) -> Outputs:
    """Return the outputs of the plant. They depend on its state, and on the motion of its base, alone.

    The rotor's kinetic energy is ``J_r s^2 / 2`` with ``J_r = I_m / ell`` and s its speed about its axis, the z
    component of V_D (4); in pure rotation (56) that is ``ell kappa_dot``. The potential energy is zero with all
    centres of mass at the height of the origin of {I}.

    Parameters
    ----------
    x : as in :func:`plant_derivative`
    p_S : (3,) [m] place of the base in {I}
    base : Base
        Its motion, default at rest; its acceleration does not count.
    """
    q, q_dot, kappa_dot, tau_s, states = split_state(robot, x)
    p_O, R_O = end_effector_pose(robot, q)
    p, R = p_S, base.R_S
    p_O, R_O = p + R @ p_O, R @ R_O
    motion = link_motion(robot, q, q_dot, np.zeros(robot.n), base)
    V_D = rotor_velocities(robot, motion.V_B, kappa_dot, base.V_S)  # (4)
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
    for option, own in options_of(robot, states):
        E_spring = E_spring + np.sum(option.energy(robot, own))
    for option, _ in options_of(robot):
        E_spring = E_spring + np.sum(option.link_energy(robot, q))
    return Outputs(rotor_position(robot, q, tau_s), p_O, R_O, E_kin, E_pot, E_spring)


def base_load(robot: Any, x: np.ndarray, tau: np.ndarray, F_e: np.ndarray, ends: Ends) -> tuple[np.ndarray, np.ndarray]:
    """Return what the plant is for its base: M_S : (6, 6) and F_S0 : (6,) of :func:`apparent_load`.

    Parameters
    ----------
    x, tau, F_e, ends : as in :func:`plant_derivative`
    """
    state = split_state(robot, x)
    tau_l, tau_k = plant_torques(robot, state, tau)
    return apparent_load(robot, state.q, state.q_dot, tau_l, F_e, Rotors(state.kappa_dot, tau_k), ends)


def tool_motion(
    robot: Any, x: np.ndarray, tau: np.ndarray, F_e: np.ndarray, ends: Ends
) -> tuple[np.ndarray, np.ndarray]:
    """Return velocity V_O and acceleration A_O of the end-effector frame {O}, (6,) each, in {O}.

    V_O is relative to the frame in which ``ends.base`` has no linear velocity; A_O is that of
    :func:`~vdfmu.arm.world.attachment.tool_acceleration`.
    """
    state = split_state(robot, x)
    tau_l, tau_k = plant_torques(robot, state, tau)
    q_ddot = forward_dynamics(robot, state.q, state.q_dot, tau_l, F_e, Rotors(state.kappa_dot, tau_k), ends)
    motion = link_motion(robot, state.q, state.q_dot, q_ddot, ends.base)
    V_B, V_B_dot = motion.V_B[-1], motion.V_B_dot[-1]
    return tool_transform(robot).T @ V_B, tool_acceleration(robot, V_B, V_B_dot)
