"""Gains of the controller by one rule, for any arm: poles of each joint, placed as far out as sampling and delay allow.

A joint is two inertias on a spring: its rotor J, the links M that it sees, and the stiffness K at rest. The gains

    K_v = N J / h
    K_p = the smaller of K_v^2 / (4 zeta^2 (J + M)) and K / 4

give the rotor alone, with the torque held over a step h and a sample of delay, the poles of ``z^2 - z + N``, and the
whole joint, on a stiff spring, two poles with the damping ratio zeta = 1/2. N starts at 0.4 and falls by a tenth until
the joint's sampled loop, with and without a sample of delay, has the required modulus margin for every M that it sees.
"""

from __future__ import annotations

from dataclasses import replace
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from vdfmu.arm.dynamics import mass_matrix
from vdfmu.arm.equations.harmonic_drive import deformation_derivative
from vdfmu.arm.robot import Robot
from vdfmu.base.arrays import Floats
from vdfmu.base.errors import UsageError
from vdfmu.base.state_space import Linear, held
from vdfmu.engine.linear.loops import Loop

_DAMPING = 0.5
_DAMPED = 2.0
"""Rate [1/s] with which all that a joint does decays by itself, beside what the controller does: friction of the drive,
without which no gains keep a delayed loop from driving the spring's mode."""
_FIRST, _FALL, _LAST = 0.4, 0.9, 1e-4
"""N of the first try, the factor from one try to the next, and N where the search ends."""
_INERTIAS = 5
"""Inertias of the links that a joint's loop is tried with, from the smallest to the largest."""


class Gains(NamedTuple):
    """Gains (n,), link-side, and the modulus margin that each joint by itself has with one sample of delay."""

    K_p: Floats
    K_v: Floats
    modulus: Floats


def joint_gains(
    J: float, K: float, inertias: Floats, step: float, margin: float = 0.5, name: str = "the joint"
) -> tuple[float, float, float]:
    """Gains of one joint, K_p and K_v, and its modulus margin, which is at least `margin`.

    The joint has the rotor inertia `J` [kg m2 or kg] and the stiffness `K` [N m/rad or N/m], link-side, and sees the
    `inertias` (m,) of links; messages have its `name`. UsageError if the smallest gains of the search miss the margin.
    """
    tries = np.geomspace(inertias.min(), inertias.max(), _INERTIAS)
    N = _FIRST
    while True:
        K_v = N * J / step
        K_p = min(K_v**2 / (4 * _DAMPING**2 * (J + float(tries[-1]))), K / 4)
        feedback = -np.array([[K_p, 0.0, 0.0, K_v]])  # on q, kappa, q_dot, kappa_dot
        least = np.inf
        for M in tries:
            A, B = _two_inertias(J, float(M), K)
            loop = Loop(held(Linear(A - _DAMPED * np.eye(len(A)), B), step), feedback, step, slow=0.0)
            least = min(least, *(float(each.modulus[0]) for each in (loop, _late(loop))))
            if least < margin:
                break
        if least >= margin:
            return K_p, K_v, least
        if N < _LAST:
            raise UsageError(
                f"{name}: expected gains with a modulus margin of {margin:g}, got {least:.3g} with the smallest, K_p = "
                f"{K_p:.3g} and K_v = {K_v:.3g}. Give a smaller step or margin, or check the joint's drive and inertia."
            )
        N *= _FALL


def arm_gains(robot: Robot, q: npt.ArrayLike, step: float, margin: float = 0.5) -> Gains:
    """Gains of an arm for a controller that acts on the rotors' velocity.

    The arm is at `q`, (m, n) [rad or m], along its motion, or all over the workspace: a joint sees the inertia of its
    links with all other joints held, and with all free. Each joint has at least `margin` by itself; else UsageError.
    """
    M = mass_matrix(robot, np.atleast_2d(np.asarray(q, dtype=float)))
    held = np.diagonal(M, axis1=1, axis2=2)
    free = 1.0 / np.diagonal(np.linalg.inv(M), axis1=1, axis2=2)
    seen: Floats = np.concatenate([held, free]).astype(float)
    J = robot.I_m * robot.ell
    K = 1.0 / np.asarray(deformation_derivative(robot, np.zeros(robot.n)), dtype=float)
    each = [
        joint_gains(float(J[i]), float(K[i]), seen[:, i], step, margin, f"joint {robot.joint_labels[i]}")
        for i in range(robot.n)
    ]
    return Gains(*np.array(each).T)


def _two_inertias(J: float, M: float, K: float) -> Linear:
    """Links on a spring on a rotor: states q, kappa, q_dot, kappa_dot; input the torque on the rotor, link-side."""
    A = np.zeros((4, 4))
    A[0, 2] = A[1, 3] = 1.0
    A[2, :2] = -K / M, K / M
    A[3, :2] = K / J, -K / J
    return Linear(A, np.array([[0.0], [0.0], [0.0], [1.0 / J]]))


def _late(loop: Loop) -> Loop:
    """Return a loop with one input whose feedback comes a sample later: it is a further state."""
    (A, B), last = loop.plant, np.array([[0.0] * len(loop.plant.A) + [1.0]])
    plant = Linear(np.vstack([np.hstack([A, B]), 0.0 * last]), last.T)
    return replace(loop, plant=plant, K=np.append(loop.K, [[0.0]], axis=1))
