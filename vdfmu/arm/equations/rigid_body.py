"""Dynamics of one rigid body in its own frame {B}: Eq. (59)-(62), used by (6)-(8) and (47)."""

from __future__ import annotations

from typing import Any

import numpy as np

from vdfmu.arm.equations.spatial import skew
from vdfmu.compiler.scalar import zeros

BODY = ("m", "mx", "my", "mz", "Ixx", "Ixy", "Iyy", "Ixz", "Iyz", "Izz")
"""Ten linear parameters of (59): mass, first moments, and the inertia of a body about the origin of {B}."""
PAIRS = ((0, 0), (0, 1), (1, 1), (0, 2), (1, 2), (2, 2))
"""Rows and columns of its moments of inertia."""


def mass_matrix(m_B: Any, r_B: np.ndarray, I_B: np.ndarray) -> np.ndarray:
    """Mass matrix M_B, Eq. (60).

    Parameters
    ----------
    m_B : float [kg]
    r_B : (3,) [m] centre of mass in {B}
    I_B : (3, 3) [kg m2] inertia about the centre of mass, axes of {B}. The paper says
        "expressed in {B}" only; the term -m (r x)^2 of (60) is right for this reading.
    """
    r_cross = skew(r_B)
    M_B = zeros((6, 6), m_B, r_B, I_B)
    M_B[:3, :3] = m_B * np.eye(3)
    M_B[:3, 3:] = -m_B * r_cross
    M_B[3:, :3] = m_B * r_cross
    M_B[3:, 3:] = I_B - m_B * r_cross @ r_cross
    return M_B


def coriolis_matrix(m_B: Any, r_B: np.ndarray, I_B: np.ndarray, omega_B: np.ndarray) -> np.ndarray:
    """Skew-symmetric matrix of centrifugal and Coriolis terms C_B(omega_B), Eq. (61); `omega_B` (3,) [rad/s] in {B}."""
    r_cross, w_cross = skew(r_B), skew(omega_B)
    C_B = zeros((6, 6), m_B, r_B, I_B, omega_B)
    C_B[:3, :3] = m_B * w_cross
    C_B[:3, 3:] = -m_B * w_cross @ r_cross
    C_B[3:, :3] = m_B * r_cross @ w_cross
    C_B[3:, 3:] = w_cross @ I_B + I_B @ w_cross - m_B * r_cross @ w_cross @ r_cross
    return C_B


def coriolis_force(m_B: Any, r_B: np.ndarray, I_B: np.ndarray, V_B: np.ndarray) -> np.ndarray:
    """Return ``C_B(omega_B) @ V_B`` of Eq. (61) by cross products, in a third of the matrix's operations.

    With ``omega x`` factored out, the upper half of (61) is ``m omega x (v + omega x r)``; the lower half is the
    moment of that force about the origin plus ``omega x (I omega)``.
    """
    v, omega_cross = V_B[:3], skew(V_B[3:])
    force = m_B * (omega_cross @ (v + omega_cross @ r_B))
    return np.concatenate([force, skew(r_B) @ force + omega_cross @ (I_B @ V_B[3:])])


def gravity_force(m_B: Any, r_B: np.ndarray, g_B: np.ndarray) -> np.ndarray:
    """Force that holds the body against gravity, G_B, Eq. (62).

    `g_B` (3,) [m/s2] is ``R_BI @ g`` with g = [0, 0, +9.81] in {I}: with the sign of (62) G_B points up.
    """
    return np.concatenate([m_B * g_B, m_B * (skew(r_B) @ g_B)])


def bias_force(m_B: Any, r_B: np.ndarray, I_B: np.ndarray, g_B: np.ndarray, V_B: np.ndarray) -> np.ndarray:
    """Net force of a body at ``V_B_dot = 0``, the last two terms of :func:`net_force`: (6,) [N, N m] in {B}."""
    return coriolis_force(m_B, r_B, I_B, V_B) + gravity_force(m_B, r_B, g_B)


def net_force(
    m_B: Any, r_B: np.ndarray, I_B: np.ndarray, g_B: np.ndarray, V_B: np.ndarray, V_B_dot: np.ndarray
) -> np.ndarray:
    """Net force and torque of a body, F*_B = M_B V_B_dot + C_B V_B + G_B, Eq. (59) (also (6)-(8), (47)).

    F*_B is (6,) [N, N m] in {B}, V_B (6,) [m/s, rad/s] the velocity of {B} in {B}, V_B_dot the derivative of its
    coordinates.
    """
    M_B = mass_matrix(m_B, r_B, I_B)
    return M_B @ V_B_dot + coriolis_force(m_B, r_B, I_B, V_B) + gravity_force(m_B, r_B, g_B)


def body_parameters(robot: Any) -> np.ndarray:
    """Return the parameters :data:`BODY` of all links, (10 n,), a payload with the last."""
    parameters: list[float] = []
    for i in range(robot.n):
        m, c, inertia = robot.body(i)
        about_origin = inertia + m * (c @ c * np.eye(3) - np.outer(c, c))
        parameters += [m, *(m * c), *(about_origin[i, j] for i, j in PAIRS)]
    return np.array(parameters, dtype=float)


def principal(inertia: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Principal moments of inertia (3,), from small to large, and their right-handed axes as columns (3, 3)."""
    moments, axes = np.linalg.eigh((inertia + inertia.T) / 2.0)
    axes[:, 2] *= np.sign(np.linalg.det(axes))
    return moments, axes
