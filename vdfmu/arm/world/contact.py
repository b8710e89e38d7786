"""Contact of the end effector with a plane, and a screw that it drives. Not in the paper."""

from __future__ import annotations

from typing import Any

import numpy as np

from vdfmu.compiler.scalar import maximum


def normal_force(k: Any, c: Any, depth: Any, depth_dot: Any) -> Any:
    """Force of Hunt and Crossley (1975), ``k depth max(0, 1 + c depth_dot)`` for a depth above 0: [N].

    As at the end stops of joints, it pushes and never pulls, and has no jump at contact. A body that arrives with a
    speed v leaves with ``v (1 - 2/3 c v)``, to first order in ``c v``.

    Parameters
    ----------
    k : float [N/m] stiffness
    c : float [s/m] damping over stiffness and depth
    depth, depth_dot : float [m, m/s]
    """
    return k * maximum(depth, 0.0) * maximum(1.0 + c * depth_dot, 0.0)


def friction_force(mu: Any, eps: Any, N: Any, v: np.ndarray) -> np.ndarray:
    """Coulomb friction ``mu N v / sqrt(|v|^2 + eps^2)`` along a sliding velocity: (3,) [N].

    The root regularises the direction: within eps of rest it creeps, with the viscous coefficient ``mu N / eps``.

    Parameters
    ----------
    mu : float [1] coefficient of friction
    eps : float [m/s]
    N : float [N] normal force
    v : (3,) [m/s] velocity in the plane
    """
    return (mu * N / np.sqrt(v @ v + eps * eps)) * v


def screw_torque(T_0: Any, T_1: Any, eps: Any, turn: Any, speed: Any) -> Any:
    """Torque that turns a screw in its thread, either way: ``(T_0 + T_1 turn) tanh(speed / eps)``: [N m].

    It grows with the length of thread that is in.

    Parameters
    ----------
    T_0, T_1 : float [N m, N m/rad]
    eps : float [rad/s]
    turn, speed : float [rad, rad/s], from where the thread begins
    """
    return (T_0 + T_1 * maximum(turn, 0.0)) * np.tanh(speed / eps)
