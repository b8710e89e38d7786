"""The Lagrangian formulation: mass matrix, Christoffel symbols, gravity torques, for contrast with (44)-(47).

Everything is expressed in {I}. The Christoffel symbols need the derivative of every entry of every link's
Jacobian with respect to every joint: the cost grows with the fourth power of n, the growth that the paper's
introduction names.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from vdfmu.arm.equations.rigid_body import link_body
from vdfmu.compiler.scalar.generic import zeros


def _cross(a: Any, b: Any) -> np.ndarray:
    return np.stack(
        [
            a[..., 1] * b[..., 2] - a[..., 2] * b[..., 1],
            a[..., 2] * b[..., 0] - a[..., 0] * b[..., 2],
            a[..., 0] * b[..., 1] - a[..., 1] * b[..., 0],
        ],
        axis=-1,
    )


def _geometry(robot: Any, q: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Axes (n, 3), joint origins (n, 3), centres of mass (n, 3) and inertias (n, 3, 3), all in {I}."""
    n = robot.n
    like = (q, robot.mass, robot.offset)
    axes, origins, centres = zeros((n, 3), *like), zeros((n, 3), *like), zeros((n, 3), *like)
    inertias = zeros((n, 3, 3), *like)
    R, p = np.eye(3), np.zeros(3)
    for i in range(n):
        p = p + R @ robot.offset[i]
        R = R @ robot.rotation[i]
        if robot.joint_types[i] == "prismatic":
            p = p + R[:, 2] * q[i]
        else:
            c, s = np.cos(q[i]), np.sin(q[i])
            R = np.stack([R[:, 0] * c + R[:, 1] * s, R[:, 1] * c - R[:, 0] * s, R[:, 2]], axis=1)
        axes[i], origins[i] = R[:, 2], p
        _, r_B, I_B = link_body(robot, i)
        centres[i] = p + R @ r_B
        inertias[i] = R @ I_B @ R.T
    return axes, origins, centres, inertias


def _link_jacobians(robot: Any, axes: np.ndarray, origins: np.ndarray, centre: np.ndarray, link: int):
    """Jacobians (link + 1, 3) of the centre of mass and of the angular velocity of one link."""
    linear, angular = zeros((link + 1, 3), axes), zeros((link + 1, 3), axes)
    for j in range(link + 1):
        if robot.joint_types[j] == "prismatic":
            linear[j] = axes[j]
        else:
            linear[j] = _cross(axes[j], centre - origins[j])
            angular[j] = axes[j]
    return linear, angular


def lagrange_mass_matrix(robot: Any, q: np.ndarray) -> np.ndarray:
    """Mass matrix M(q) as the sum of the links' kinetic energies, (n, n)."""
    axes, origins, centres, inertias = _geometry(robot, q)
    M = zeros((robot.n, robot.n), axes)
    for k in range(robot.n):
        linear, angular = _link_jacobians(robot, axes, origins, centres[k], k)
        M[: k + 1, : k + 1] = (
            M[: k + 1, : k + 1] + link_body(robot, k)[0] * (linear @ linear.T) + angular @ inertias[k] @ angular.T
        )
    return M


def mass_matrix_derivative(robot: Any, q: np.ndarray) -> np.ndarray:
    """Return the derivative dM[i, j, k] = d M[i, j] / d q[k], (n, n, n).

    A rotation of joint k turns everything beyond it: an axis z_j (j > k) changes by z_k x z_j, a point p by
    z_k x (p - p_k), an inertia I by (z_k x) I - I (z_k x); a translation moves points by z_k and turns
    nothing.
    """
    n = robot.n
    axes, origins, centres, inertias = _geometry(robot, q)
    dM = zeros((n, n, n), axes)
    for link in range(n):
        rows = link + 1
        linear, angular = _link_jacobians(robot, axes, origins, centres[link], link)
        for k in range(rows):
            prismatic = robot.joint_types[k] == "prismatic"
            d_linear, d_angular = zeros((rows, 3), axes), zeros((rows, 3), axes)
            d_inertia = zeros((3, 3), axes)
            if prismatic:
                for j in range(k + 1):  # the arm from a joint at or before k to the centre changes by z_k
                    if robot.joint_types[j] == "revolute":
                        d_linear[j] = _cross(axes[j], axes[k])
            else:
                d_centre = _cross(axes[k], centres[link] - origins[k])
                for j in range(rows):
                    revolute = robot.joint_types[j] == "revolute"
                    if j <= k:
                        if revolute:
                            d_linear[j] = _cross(axes[j], d_centre)
                    elif revolute:  # the whole arm beyond k turns rigidly
                        d_linear[j] = _cross(axes[k], linear[j])
                        d_angular[j] = _cross(axes[k], axes[j])
                    else:
                        d_linear[j] = _cross(axes[k], axes[j])
                turned = _cross(axes[k][None, :], inertias[link].T).T  # (z_k x) I
                d_inertia = turned + turned.T
            product = link_body(robot, link)[0] * (d_linear @ linear.T) + d_angular @ inertias[link] @ angular.T
            dM[:rows, :rows, k] = dM[:rows, :rows, k] + product + product.T + angular @ d_inertia @ angular.T
    return dM


def christoffel_symbols(robot: Any, q: np.ndarray) -> np.ndarray:
    """Christoffel symbols of the first kind, c[i, j, k] = (dM_ij/dq_k + dM_ik/dq_j - dM_jk/dq_i) / 2."""
    dM = mass_matrix_derivative(robot, q)
    return 0.5 * (dM + dM.transpose(0, 2, 1) - dM.transpose(2, 0, 1))


def lagrange_inverse_dynamics(robot: Any, q: np.ndarray, q_dot: np.ndarray, q_ddot: np.ndarray) -> np.ndarray:
    """Joint torques ``M q_ddot + c(q_dot, q_dot) + G``, (n,), link-side. The cost is O(n^4)."""
    n = robot.n
    M = lagrange_mass_matrix(robot, q)
    coriolis = (christoffel_symbols(robot, q).reshape(n * n, n) @ q_dot).reshape(n, n) @ q_dot
    axes, origins, centres, _ = _geometry(robot, q)
    G = zeros((n,), axes, robot.gravity)
    for k in range(n):
        linear, _ = _link_jacobians(robot, axes, origins, centres[k], k)
        G[: k + 1] = G[: k + 1] + link_body(robot, k)[0] * (linear @ robot.gravity)
    return M @ q_ddot + coriolis + G
