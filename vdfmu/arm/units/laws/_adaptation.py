"""Laws by which the estimated parameters of bodies change, sample by sample."""

from __future__ import annotations

from typing import Any

import numpy as np

from vdfmu.arm.equations.friction import linear_friction
from vdfmu.arm.equations.rigid_body import PAIRS, body_parameters
from vdfmu.compiler.scalar.generic import clip, zeros


def start_parameters(robot: Any) -> np.ndarray:
    """Parameters of the bodies as the robot has them, (n, 10)."""
    return body_parameters(robot).reshape(-1, 10)


def start_joints(robot: Any) -> np.ndarray:
    """Inertia of the rotors, viscous and dry friction, link-side: (n, 3)."""
    return np.hstack([(robot.I_m * robot.ell)[:, None], linear_friction(robot)])


def parameter_scales(robot: Any) -> np.ndarray:
    """Size of the parameters, (n, 10): m, m l and m l^2, with l the radius of gyration about the origin of {B}."""
    phi = start_parameters(robot)
    m, moment = phi[:, :1], phi[:, 4:5] + phi[:, 6:7] + phi[:, 9:10]
    length = np.sqrt(0.5 * moment / m)
    return np.hstack([m, np.repeat(m * length, 3, axis=1), np.repeat(m * length**2, 6, axis=1)])


def projected(phi: Any, s: Any, rate: Any, scale: Any, middle: Any, span: Any) -> Any:
    """Gradient law with projection (Zhu 2010): ``phi <- phi + rate scale^2 s`` within ``middle +- span scale``."""
    return clip(phi + rate * scale**2 * s, middle - span * scale, middle + span * scale)


def natural(phi: Any, s: Any, rate: Any) -> Any:
    """Natural law (Lee, Kwon and Park 2018) for one body: ``P_dot = rate P S P``, P the pseudo-inertia (4, 4).

    S is the symmetric matrix with ``tr(P S) = phi @ s``. The step ``(1 + rate P S / 2) P (1 + rate S P / 2)`` is of
    first order and leaves P positive, so the estimate stays that of a body, whatever the step.
    """
    P, S = zeros((4, 4), phi), zeros((4, 4), s)
    for k, (i, j) in enumerate(PAIRS, 4):
        P[i, j] = P[j, i] = -phi[k]
        S[i, j] = S[j, i] = -s[k] if i == j else -0.5 * s[k]
    P[:3, :3] = P[:3, :3] + 0.5 * (phi[4] + phi[6] + phi[9]) * np.eye(3)
    S[:3, :3] = S[:3, :3] + (s[4] + s[6] + s[9]) * np.eye(3)
    P[:3, 3] = P[3, :3] = phi[1:4]
    S[:3, 3] = S[3, :3] = 0.5 * s[1:4]
    P[3, 3], S[3, 3] = phi[0], s[0]
    X = np.eye(4) + 0.5 * rate * (P @ S)
    P = X @ P @ X.T
    inertia = (P[0, 0] + P[1, 1] + P[2, 2]) * np.eye(3) - P[:3, :3]
    return np.array([P[3, 3], P[0, 3], P[1, 3], P[2, 3], *(inertia[i, j] for i, j in PAIRS)])
