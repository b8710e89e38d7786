"""Contact of the end effector with a plane, and a screw that it drives. Not in the paper."""

from __future__ import annotations

from typing import Any

import numpy as np

from vdfmu.compiler.scalar import maximum


def normal_force(k: Any, c: Any, depth: Any, depth_dot: Any) -> Any:
    """Force of Hunt and Crossley (1975), ``k depth max(0, 1 + c depth_dot)`` for a depth above 0: [N].

    As at the end stops of joints, it pushes and never pulls, and does not jump at contact. A body that arrives with a
    speed v leaves with ``v (1 - 2/3 c v)``, to first order in ``c v``. `k` is in N/m, `c` in s/m, `depth` in m.
    """
    return k * maximum(depth, 0.0) * maximum(1.0 + c * depth_dot, 0.0)


def friction_force(mu: Any, eps: Any, N: Any, v: np.ndarray) -> np.ndarray:
    """Coulomb friction ``mu N v / sqrt(|v|^2 + eps^2)`` along a sliding velocity `v` (3,) [m/s]: (3,) [N].

    The square root regularises the direction: below eps the contact creeps with the viscous coefficient ``mu N / eps``.
    """
    return (mu * N / np.sqrt(v @ v + eps * eps)) * v


def screw_torque(T_0: Any, T_1: Any, eps: Any, turn: Any, speed: Any) -> Any:
    """Torque that turns a screw in its thread in either direction: ``(T_0 + T_1 turn) tanh(speed / eps)``: [N m].

    It grows with the engaged thread; `turn` [rad] is counted from the beginning of the thread.
    """
    return (T_0 + T_1 * maximum(turn, 0.0)) * np.tanh(speed / eps)
