"""The flexible joint as a subsystem: Eq. (4)-(11) and (56), and the spring with its torque as the state."""

from __future__ import annotations

from typing import Any

import numpy as np

from vdfmu.equations.harmonic_drive import deformation, deformation_derivative, kinematic_error
from vdfmu.equations.spatial import joint_axis

__all__ = [
    "joint_forces",
    "output_velocity",
    "rotor_acceleration",
    "rotor_position",
    "rotor_velocity",
    "spring_rate",
]

_z_tau = joint_axis("revolute")


def rotor_velocity(V_B: np.ndarray, U_BD: np.ndarray, ell: Any, kappa_dot: Any) -> np.ndarray:
    """Velocity of the motor rotor, ``V_D = z ell kappa_dot + U_BD.T V_B``, Eq. (4).

    Parameters
    ----------
    V_B : (6,) [m/s, rad/s] velocity of the joint base in {B}
    U_BD : (6, 6) force transformation from the rotor frame {D} to {B}
    kappa_dot : float [rad/s] rotor speed divided by ell
    """
    return _z_tau * (ell * kappa_dot) + U_BD.T @ V_B


def output_velocity(V_B: np.ndarray, U_BT: np.ndarray, q_dot: Any) -> np.ndarray:
    """Velocity of the joint output link, ``V_T = z q_dot + U_BT.T V_B``, Eq. (5)."""
    return _z_tau * q_dot + U_BT.T @ V_B


def joint_forces(
    F_T: np.ndarray,
    F_T_star: np.ndarray,
    F_D_star: np.ndarray,
    F_B_star: np.ndarray,
    U_BT: np.ndarray,
    U_BD: np.ndarray,
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return the forces inside the joint and on its base, Eq. (9)-(11), for net forces from (6)-(8).

    Parameters
    ----------
    F_T : (6,) [N, N m] force that the output link passes on at the driving cutting point, in {T}
    F_T_star, F_D_star, F_B_star : (6,) net forces of output link, rotor and base, in {T}, {D}, {B}

    Returns
    -------
    F_Tq : (6,) force from base to output link, in {T}; its z component is ``ell tau_t - xi(q_dot)``
    F_Dk : (6,) force from base to rotor, in {D}; its z component is ``tau - tau_t - xi(kappa_dot)``
    F_B : (6,) force on the base at the driven cutting point, in {B}
    """
    F_Tq = F_T_star + F_T  # (9)
    F_Dk = F_D_star  # (10)
    F_B = F_B_star + U_BT @ F_Tq + U_BD @ F_Dk  # (11)
    return F_Tq, F_Dk, F_B


def rotor_acceleration(robot: Any, tau: Any, tau_s: Any, xi_m: Any) -> Any:
    """Acceleration of the rotors, (10) with (56): ``I_m kappa_ddot = tau - tau_s / ell - xi_m``.

    Parameters
    ----------
    tau : (n,) [N m] motor torque, motor-side
    tau_s : (n,) [N m or N] spring torque, link-side; ``tau_t = tau_s / ell`` in (10)
    xi_m : (n,) [N m] friction on the rotor, motor-side

    Returns
    -------
    kappa_ddot : (n,) [rad/s2 or m/s2]
    """
    return (tau - tau_s / robot.ell - xi_m) / robot.I_m


def spring_rate(robot: Any, kappa: Any, kappa_dot: Any, q_dot: Any, tau_s: Any) -> Any:
    """Rate of the spring torque, from the derivative of ``kappa - q - theta_err(kappa) = D(tau_s)``.

    With the torque as state, the implicit equations (2)-(3) and the pole of the tangent are gone.

    Returns
    -------
    tau_s_dot : (n,) [N m/s or N/s]
    """
    phase = 2.0 * robot.ell * kappa + robot.theta_err_phase
    error_slope = 2.0 * robot.ell * robot.theta_err_amplitude * np.cos(phase)  # d theta_err / d kappa
    return (kappa_dot * (1.0 - error_slope) - q_dot) / deformation_derivative(robot, tau_s)


def rotor_position(robot: Any, q: Any, tau_s: Any) -> Any:
    """Rotor position kappa from ``kappa = q + D(tau_s) + theta_err(kappa)`` : (n,) [rad or m].

    theta_err is a contraction (``2 ell A < 1/2`` is checked on loading): Newton's method from q + D squares
    the error, at most 1/2 A, at every pass; four passes end below rounding.
    """
    free = q + deformation(robot, tau_s)
    kappa = free
    for _ in range(4):
        phase = 2.0 * robot.ell * kappa + robot.theta_err_phase
        slope = 2.0 * robot.ell * robot.theta_err_amplitude * np.cos(phase)
        kappa = kappa - (kappa - free - kinematic_error(robot, kappa)) / (1.0 - slope)
    return kappa
