"""The flexible joint as a subsystem: Eq. (4)-(11) and (56), and the spring with its torque as the state.

The joint's base is part of the link before it and its output link part of the link after it (Table 1 gives their masses
together), so that (5), (6) and (8) are (31) and (47), and (9) is (45). What remains is the rotor: a body that turns
about its axis on the base, with its mass included in the base's link. The options of a drive add to the torques of
spring, friction and motor.
"""

from __future__ import annotations

from collections.abc import Mapping
from types import MappingProxyType
from typing import Any, NamedTuple

import numpy as np

from vdfmu.arm.drive.option import JointMotion, Parallel, Sliding, Spring
from vdfmu.arm.drive.options import options_of
from vdfmu.arm.equations.friction import friction_loss, friction_terms, friction_velocity, joint_friction, sliding_at
from vdfmu.arm.equations.harmonic_drive import (
    deformation,
    deformation_derivative,
    kinematic_error,
    kinematic_error_slope,
    spring_energy,
)
from vdfmu.arm.equations.rigid_body import coriolis_force
from vdfmu.arm.equations.spatial import force_transform, joint_axis
from vdfmu.compiler.scalar import outward, total

Z_TAU = joint_axis("revolute")
"""Axis z_tau of every rotor in {D}."""


class PlantState(NamedTuple):
    """State of the plant, each (n,): position and velocity of links, velocity of rotors, spring torque, options."""

    q: Any
    q_dot: Any
    kappa_dot: Any
    tau_s: Any
    options: Mapping[str, Any] = MappingProxyType({})


def state_names(robot: Any) -> list[str]:
    """Return the names of a robot's states, in order."""
    added = [option.state.name for option, _ in options_of(robot) if option.state]
    return ["q", "q_dot", "kappa_dot", "tau_s", *added]


def split_state(robot: Any, x: np.ndarray) -> PlantState:
    """View of a state vector ``x = [q, q_dot, kappa_dot, tau_s, ..]`` : (4 n,), longer with options."""
    names = state_names(robot)
    parts = np.split(x, len(names))
    return PlantState(*parts[:4], options=dict(zip(names[4:], parts[4:], strict=True)))


# the rotor as a body


def rotor_velocity(V_B: np.ndarray, U_BD: np.ndarray, ell: Any, kappa_dot: Any) -> np.ndarray:
    """Velocity of the motor rotor, ``V_D = z ell kappa_dot + U_BD.T V_B``, Eq. (4), on a base with `V_B`: (6,) each."""
    return Z_TAU * (ell * kappa_dot) + U_BD.T @ V_B


def rotor_transform(robot: Any, i: int) -> np.ndarray:
    """Force transformation U_BD from the rotor frame {D_i} to the frame {B_(i-1)} of the carrying link: (6, 6).

    {D_i} has the place and axes of {B_i} at q_i = 0. It does not turn with the rotor, whose inertia is the same in
    every frame about its axis, so the transformation is constant.
    """
    return force_transform(robot.rotation[i], robot.offset[i])


def rotor_reaction(robot: Any, i: int, F_Dk: np.ndarray) -> np.ndarray:
    """Force of rotor i on its link, ``U_BD F_Dk`` of Eq. (11): (6,) in {B_(i-1)}; 0 for pure rotation (56)."""
    return rotor_transform(robot, i) @ F_Dk if robot.rotor_coupling else np.zeros(6)


def rotor_body(robot: Any, i: int) -> tuple[Any, np.ndarray, np.ndarray]:
    """Mass, centre of mass and inertia of rotor i in {D_i}, for Eq. (60)-(61).

    The mass and the transverse inertia belong to the link that carries the rotor, so they are 0 here. The axial inertia
    is ``J_r = I_m / ell`` [kg m2], which the link's own inertia must not contain.
    """
    return 0.0, np.zeros(3), robot.I_m[i] / robot.ell[i] * np.outer(Z_TAU[3:], Z_TAU[3:])


def rotor_force(robot: Any, i: int, V_D: np.ndarray, tau_k: Any) -> np.ndarray:
    """Force from the base to the rotor, F_Dk of Eq. (10), for a known torque about its axis: (6,) in {D_i}.

    Of (7) only the gyroscopic moment remains: the axial part of ``M_D V_D_dot`` is tau_k, and the mass is 0.
    """
    return Z_TAU * tau_k + coriolis_force(*rotor_body(robot, i), V_D)


def rotor_velocities(robot: Any, V_B: list[np.ndarray], kappa_dot: Any, V_S: Any) -> list[np.ndarray]:
    """Velocity of every rotor, Eq. (4): n times (6,) [m/s, rad/s] in {D_i}.

    `V_B` are the velocities of the links, `V_S` is the velocity of the base of the first joint. Because U_BD is
    constant, the same formula returns V_D_dot for the accelerations V_B_dot and kappa_ddot.
    """

    def rotor(V_A: Any, i: int) -> tuple[Any, Any]:
        return V_B[i], rotor_velocity(V_A, rotor_transform(robot, i), robot.ell[i], kappa_dot[i])

    if robot.rotor_coupling:
        return outward(rotor, V_S, robot.n)[1]
    at_rest = np.zeros(6)  # (56): independent of the motion of their bases
    return [rotor_velocity(at_rest, rotor_transform(robot, i), robot.ell[i], kappa_dot[i]) for i in range(robot.n)]


def inertia_torques(robot: Any, V_D_dot: list[np.ndarray], kappa_ddot: Any) -> Any:
    """Component of ``M_D V_D_dot`` of every rotor (7) along its axis: (n,) [N m], motor-side; V_D_dot by kappa_ddot."""
    if not robot.rotor_coupling:
        return robot.I_m * kappa_ddot  # (56)
    return robot.I_m / robot.ell * np.array([V_Dk_dot[5] for V_Dk_dot in V_D_dot])  # (7)


def rotor_forces(robot: Any, motion: Any, kappa_dot: Any, kappa_ddot: Any) -> list[np.ndarray]:
    """Force from the base to every rotor for a given motion, Eq. (7) and (10): n times (6,) [N, N m] in {D_i}.

    `motion` is the :class:`~vdfmu.arm.equations.inverse_dynamics.ChainMotion` of the links; `kappa_dot` and
    `kappa_ddot` [rad/s, rad/s2] are divided by ell.
    """
    V_D = rotor_velocities(robot, motion.V_B, kappa_dot, motion.base.V_S)
    V_D_dot = rotor_velocities(robot, motion.V_B_dot, kappa_ddot, motion.base.V_S_dot)
    tau_k = inertia_torques(robot, V_D_dot, kappa_ddot)
    return [rotor_force(robot, i, V_D[i], tau_k[i]) for i in range(robot.n)]


def driven_rotor_forces(robot: Any, motion: Any, kappa_dot: Any, tau_k: Any) -> list[np.ndarray]:
    """Force from the base to every rotor for torques `tau_k` [N m] about their axes, Eq. (4) and (10): as above."""
    V_D = rotor_velocities(robot, motion.V_B, kappa_dot, motion.base.V_S)
    return [rotor_force(robot, i, V_D[i], tau_k[i]) for i in range(robot.n)]


def axial_torques(F_Dk: list[np.ndarray]) -> np.ndarray:
    """Torque about the axis of every rotor, ``z.T F_Dk``: (n,) [N m], motor-side."""
    return np.array([Z_TAU @ F for F in F_Dk])


def rotor_acceleration(robot: Any, tau_k: Any, motion: Any = None) -> Any:
    """Acceleration kappa_ddot (n,) [rad/s2 or m/s2] of the rotors from the torque about their axes, Eq. (7) and (10).

    ``I_m kappa_ddot + I_m / ell z.T (U_BD.T V_A_dot) = tau_k`` [N m], with {A} on the link that carries the rotor.
    Without the `motion` of the links the rotors turn only about their axes, Eq. (56).
    """
    kappa_ddot = tau_k / robot.I_m
    if motion is None or not robot.rotor_coupling:
        return kappa_ddot

    def rotor(V_A_dot: Any, i: int) -> tuple[Any, Any]:
        return motion.V_B_dot[i], (rotor_transform(robot, i).T @ V_A_dot)[5]

    carried = np.array(outward(rotor, motion.base.V_S_dot, robot.n)[1])
    return kappa_ddot - carried / robot.ell


# the spring


def stretch_rate(robot: Any, state: PlantState) -> Any:
    """Rate of the drives' deformation, the derivative of ``kappa - q - theta_err(kappa)``: (n,) [rad/s or m/s]."""
    slope = kinematic_error_slope(robot, rotor_position(robot, state.q, state.tau_s))
    return state.kappa_dot * (1.0 - slope) - state.q_dot


def spring(robot: Any, tau_s: Any) -> Spring:
    """Deformation, compliance and energy of the springs, (2)-(3) with options, (n,) each."""
    springs = Spring(deformation(robot, tau_s), deformation_derivative(robot, tau_s), spring_energy(robot, tau_s))
    for option, _ in options_of(robot):
        springs = option.spring(springs, robot, tau_s)
    return springs


def spring_rate(robot: Any, state: PlantState) -> Any:
    """Rate of the spring torque, from the derivative of ``kappa - q - theta_err(kappa) = D(tau_s)``.

    Returns (n,) [N m/s or N/s]. With the torque as state, the implicit equations (2)-(3) and the pole of the tangent
    vanish.
    """
    return stretch_rate(robot, state) / spring(robot, state.tau_s).compliance


def rotor_position(robot: Any, q: Any, tau_s: Any) -> Any:
    """Rotor position kappa from ``kappa = q + D(tau_s) + theta_err(kappa)`` : (n,) [rad or m].

    theta_err is a contraction (``2 ell A < 1/2`` is checked on loading), so Newton's method from q + D squares the
    error, which is at most 1/2 A, in every iteration; after four it is below rounding.
    """
    kappa = free = q + spring(robot, tau_s).deformation
    for _ in range(4):
        residual = kappa - free - kinematic_error(robot, kappa)
        kappa = kappa - residual / (1.0 - kinematic_error_slope(robot, kappa))
    return kappa


# torques of drives on links and rotors, and the options' states


def rotor_torque(robot: Any, tau: Any, tau_s: Any, xi_m: Any) -> Any:
    """Torque on the rotors about their axes, ``z.T F_Dk = tau - tau_t - xi_m`` after Eq. (11), ``tau_t = tau_s / ell``.

    (n,) [N m], motor-side. In pure rotation (56) it is ``I_m kappa_ddot``.
    """
    return tau - tau_s / robot.ell - xi_m


def _parallel(robot: Any, state: PlantState) -> Parallel:
    """Sum of the options' laws that act in parallel with the springs."""
    laws = [(option.parallel, inner) for option, inner in options_of(robot, state.options) if option.parallel]
    if not laws:
        return Parallel()
    stretch = stretch_rate(robot, state)
    return Parallel(*map(sum, zip(*(law(robot, stretch, inner) for law, inner in laws), strict=True)))


def drive_torque(robot: Any, state: PlantState) -> Any:
    """Torque of the drives on the links, of springs and of options: (n,) [N m or N], link-side."""
    return state.tau_s + _parallel(robot, state).torque


def link_torques(robot: Any, q: Any, q_dot: Any = None) -> Any:
    """Torque of options that act only on the links: (n,) [N m or N], link-side. Without `q_dot` no end stop acts."""
    return sum(option.link(robot, q, q_dot).torque for option, _ in options_of(robot) if option.link)


def plant_torques(robot: Any, state: PlantState, tau: Any) -> tuple[Any, Any]:
    """Torques with options on links, ``tau_s - xi_l`` of (9), and rotors, ``z.T F_Dk = tau - tau_s / ell - xi_m`` (11).

    (n,) each: tau_l [N m or N], link-side, tau_k [N m], motor-side.
    """
    load = drive_torque(robot, state)
    xi_l, xi_m = joint_friction(robot, state.q_dot, state.kappa_dot, load, state.options)
    tau_l = load - xi_l + link_torques(robot, state.q, state.q_dot)
    for option, inner in options_of(robot, state.options):
        tau = option.motor(tau, robot, state.kappa_dot, inner)
    return tau_l, rotor_torque(robot, tau, load, xi_m)


def drive_losses(robot: Any, state: PlantState) -> Any:
    """Power that friction and hysteresis dissipate, never negative: (n,) [W]."""
    load = drive_torque(robot, state)
    friction = friction_loss(robot, state.q_dot, state.kappa_dot, load, state.options)
    return friction + _parallel(robot, state).loss


def option_rates(robot: Any, state: PlantState, tau: Any) -> dict[str, Any]:
    """Rates of the options' states by name, (n,) each. `tau` is as in the plant."""
    rates: dict[str, Any] = {}
    if not state.options:
        return rates
    stretch, loss = stretch_rate(robot, state), drive_losses(robot, state)
    motion = JointMotion(*_sliding(robot, state), stretch=stretch, tau=tau, loss=loss)
    for option, inner in options_of(robot, state.options):
        if option.state and option.rate:
            rates[option.state.name] = option.rate(robot, motion, inner)
        motion = motion._replace(tau=option.motor(motion.tau, robot, state.kappa_dot, inner))
    return rates


def _sliding(robot: Any, state: PlantState) -> Sliding:
    velocity = friction_velocity(robot, state.q_dot, state.kappa_dot)
    return sliding_at(robot, velocity, state.kappa_dot, drive_torque(robot, state))


def rest_state(robot: Any, tau_s: Any) -> dict[str, Any]:
    """Options' states at rest, (n,) each, without temperatures. Hysteresis and bristles are relaxed, springs loaded."""
    rest = {option.state.name: option.rest(robot, tau_s) for option, _ in options_of(robot) if option.state}
    return {name: value for name, value in rest.items() if value is not None}


def stored_energy(robot: Any, state: PlantState) -> Any:
    """Elastic energy of drives, end stops and counterbalances: a number [J]."""
    links = [option.link(robot, state.q, state.q_dot) for option, _ in options_of(robot) if option.link]
    friction = friction_terms(robot, _sliding(robot, state), state.options)
    energies = (_parallel(robot, state).energy, friction.energy, *(link.energy for link in links))
    return sum(map(total, energies), total(spring(robot, state.tau_s).energy))
