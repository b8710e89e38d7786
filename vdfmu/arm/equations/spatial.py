"""Rotations, transforms and 6-vectors: Eq. (32), (33) and (63)."""

from __future__ import annotations

from typing import Any

import numpy as np

from vdfmu.compiler.scalar import inward as inward
from vdfmu.compiler.scalar import outward as outward
from vdfmu.compiler.scalar import zeros

_AXES = {"revolute": np.array([0.0, 0.0, 0.0, 0.0, 0.0, 1.0]), "prismatic": np.array([0.0, 0.0, 1.0, 0.0, 0.0, 0.0])}


def joint_axis(joint_type: str) -> np.ndarray:
    """Motion axis z (6,) of a joint in its own frame {B}, linear part first; of a revolute joint the z of Eq. (29)."""
    return _AXES[joint_type]


def skew(a: Any) -> np.ndarray:
    """Matrix of the cross product, ``skew(a) @ b = a x b``, Eq. (63)."""
    S = zeros((3, 3), a)
    S[0, 1], S[0, 2] = -a[2], a[1]
    S[1, 0], S[1, 2] = a[2], -a[0]
    S[2, 0], S[2, 1] = -a[1], a[0]
    return S


def rotation_z(angle: Any) -> np.ndarray:
    """Rotation matrix about the z axis by `angle` [rad]."""
    c, s = np.cos(angle), np.sin(angle)
    R = zeros((3, 3), c)
    R[0, 0], R[0, 1] = c, -s
    R[1, 0], R[1, 1] = s, c
    R[2, 2] = 1.0
    return R


def homogeneous_transform(R_AB: np.ndarray, p_AB: np.ndarray) -> np.ndarray:
    """Generalized coordinate transformation from {B} to {A}, Eq. (33); arguments: see :func:`force_transform`."""
    T_AB = zeros((4, 4), R_AB, p_AB)
    T_AB[:3, :3] = R_AB
    T_AB[:3, 3] = p_AB
    T_AB[3, 3] = 1.0
    return T_AB


def force_transform(R_AB: np.ndarray, p_AB: np.ndarray) -> np.ndarray:
    """Generalized force transformation U_AB, Eq. (32): ``F_A = U_AB @ F_B`` and ``V_B = U_AB.T @ V_A``.

    Parameters
    ----------
    R_AB : (3, 3) rotation of {B} in {A}
    p_AB : (3,) [m] origin of {B} in {A}
    """
    U_AB = zeros((6, 6), R_AB, p_AB)
    U_AB[:3, :3] = R_AB
    U_AB[3:, :3] = skew(p_AB) @ R_AB
    U_AB[3:, 3:] = R_AB
    return U_AB


def transform_mass_matrix(R_AB: np.ndarray, p_AB: np.ndarray, M_B: np.ndarray) -> np.ndarray:
    """Mass matrix of a body or of an articulated body in {A}, ``M_A = U_AB @ M_B @ U_AB.T``, for symmetric `M_B`.

    Computed by blocks, first the rotation and then the translation, it takes half the operations.
    """
    P_AB = skew(p_AB)
    linear, mixed, angular = (R_AB @ M_B[i, j] @ R_AB.T for i, j in _BLOCKS)
    M_A = zeros((6, 6), R_AB, p_AB, M_B)
    M_A[:3, :3] = linear
    M_A[:3, 3:] = mixed - linear @ P_AB
    M_A[3:, :3] = M_A[:3, 3:].T
    M_A[3:, 3:] = angular + P_AB @ M_A[:3, 3:] + (P_AB @ mixed).T
    return M_A


def blocks(M_B: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return the blocks (3, 3) of a symmetric mass matrix: linear, mixed and angular."""
    linear, mixed, angular = (M_B[i, j] for i, j in _BLOCKS)
    return linear, mixed, angular


def whole(parts: tuple[np.ndarray, np.ndarray, np.ndarray]) -> np.ndarray:
    """Return the symmetric mass matrix with these :func:`blocks`."""
    linear, mixed, angular = parts
    return np.block([[linear, mixed], [mixed.T, angular]])


_BLOCKS = ((slice(0, 3), slice(0, 3)), (slice(0, 3), slice(3, 6)), (slice(3, 6), slice(3, 6)))


def cross_motion(V_B: np.ndarray) -> np.ndarray:
    """Spatial cross product of a velocity with a motion vector, both in {B}: the rate of change of a moving frame.

    If {B} moves relative to {A} with ``z q_dot``, then ``d/dt(U_AB.T) = -cross_motion(z * q_dot) @ U_AB.T``.
    The paper uses it without mention, because (47) needs the derivative of (31).
    """
    v, w = V_B[:3], V_B[3:]
    X = zeros((6, 6), V_B)
    X[:3, :3] = skew(w)
    X[:3, 3:] = skew(v)
    X[3:, 3:] = skew(w)
    return X
