"""The classic Newton-Euler recursion in 3-vectors, for the comparison in section IV-A of the paper.

Written from the textbook recursion (Luh, Walker and Paul 1980) instead of the paper's 6-vectors. It shares only the
links' bodies with :mod:`vdfmu.arm.equations.inverse_dynamics`, so that their agreement is a real check.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from vdfmu.compiler.scalar import zeros

_AXIS = np.array([0.0, 0.0, 1.0])


def _cross(a: Any, b: Any) -> np.ndarray:
    return np.array([a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]])


def newton_euler(
    robot: Any, q: np.ndarray, q_dot: np.ndarray, q_ddot: np.ndarray, F_e: np.ndarray | None = None
) -> np.ndarray:
    """Joint torques from the recursion on 3-vectors in link frames. Parameters, result: :func:`.inverse_dynamics`."""
    n = robot.n
    rotations, arms, centres, forces, moments = [], [], [], [], []

    # forward: angular velocity w, angular acceleration dw, acceleration a of the origin, all in the link frame
    w, dw, a = np.zeros(3), np.zeros(3), np.asarray(robot.gravity)
    for i in range(n):
        prismatic = robot.joint_types[i] == "prismatic"
        R, p = robot.rotation[i], robot.offset[i]
        if prismatic:
            p = p + R @ (_AXIS * q[i])
        else:
            c, s = np.cos(q[i]), np.sin(q[i])
            R = np.stack([R[:, 0] * c + R[:, 1] * s, R[:, 1] * c - R[:, 0] * s, R[:, 2]], axis=1)
        a = R.T @ (a + _cross(dw, p) + _cross(w, _cross(w, p)))
        w_parent, dw_parent = R.T @ w, R.T @ dw
        if prismatic:
            w, dw = w_parent, dw_parent
            a = a + 2.0 * _cross(w, _AXIS * q_dot[i]) + _AXIS * q_ddot[i]
        else:
            w = w_parent + _AXIS * q_dot[i]
            dw = dw_parent + _cross(w_parent, _AXIS * q_dot[i]) + _AXIS * q_ddot[i]
        mass, r, inertia = robot.body(i)
        a_centre = a + _cross(dw, r) + _cross(w, _cross(w, r))
        rotations.append(R)
        arms.append(p)
        centres.append(r)
        forces.append(mass * a_centre)
        moments.append(inertia @ dw + _cross(w, inertia @ w))

    # backward: force f and moment m that link i-1 exerts on link i, about the origin of {B_i}
    tau = zeros((n,), q, q_dot, q_ddot, robot.mass)
    f, m = np.zeros(3), np.zeros(3)
    if F_e is not None:
        f = robot.tool_rotation @ np.asarray(F_e[:3])
        m = robot.tool_rotation @ np.asarray(F_e[3:]) + _cross(robot.tool_offset, f)
    for i in reversed(range(n)):
        if i < n - 1:
            f = rotations[i + 1] @ f
            m = rotations[i + 1] @ m + _cross(arms[i + 1], f)
        m = m + moments[i] + _cross(centres[i], forces[i])
        f = f + forces[i]
        tau[i] = f[2] if robot.joint_types[i] == "prismatic" else m[2]
    return tau
