"""Torques of the rigid arm as a product with its inertial parameters, which are linear in them (Atkeson et al. 1986).

A body has ten parameters: mass m, first moments m c, and the inertia about the origin of its frame {B}. For many states
at once: arrays have one row a state.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from vdfmu.arm.equations.rigid_body import PAIRS
from vdfmu.base.arrays import Floats


class Regressor(NamedTuple):
    """Spring torques ``links @ phi + rotors @ J``, link-side, and the effect on a rotor of the link that carries it."""

    links: Floats
    """(m, n, 10 n), by the parameters of the bodies one after the other."""
    rotors: Floats
    """(m, n, n), by the rotors' inertias J = I_m ell, link-side: their reaction (11) on the links; 0 in pure
    rotation."""
    carried: Floats
    """(m, n) [rad/s2]: acceleration that adds to kappa_ddot in the rotor's torque ``J (kappa_ddot + carried)``."""


def regressor(robot: Any, q: Floats, q_dot: Floats, q_ddot: Floats, kappa_dot: Floats, kappa_ddot: Floats) -> Regressor:
    """Regressor of the arm at m states, (m, n) each [rad or m, per s, per s2]; of rotors divided by ell."""
    m, n = q.shape
    slides = [kind == "prismatic" for kind in robot.joint_types]
    z = np.array([0.0, 0.0, 1.0])
    links, rotors, carried = np.zeros((m, n, 10 * n)), np.zeros((m, n, n)), np.zeros((m, n))

    # forward: angular velocity w, its derivative dw, and acceleration a of the origin, against gravity
    w, dw = np.zeros((m, 3)), np.zeros((m, 3))
    a = np.broadcast_to(np.asarray(robot.gravity, dtype=float), (m, 3))
    turns: list[Floats] = []
    arms: list[Floats] = []
    bodies: list[Floats] = []
    moments: list[Floats] = []
    for i in range(n):
        fixed = robot.rotation[i]
        spin, spin_dot = w @ fixed, dw @ fixed  # of the rotor's base, in {D_i}
        speed = robot.ell[i] * kappa_dot[:, i] + spin[:, 2]
        change = robot.ell[i] * kappa_ddot[:, i] + spin_dot[:, 2]
        moments.append((change[:, None] * z + speed[:, None] * np.cross(spin, z)) / robot.ell[i] ** 2 @ fixed.T)
        carried[:, i] = spin_dot[:, 2] / robot.ell[i]
        c, s = (np.ones(m), np.zeros(m)) if slides[i] else (np.cos(q[:, i]), np.sin(q[:, i]))
        turn = np.zeros((m, 3, 3))
        turn[:, 0, 0], turn[:, 0, 1], turn[:, 1, 0], turn[:, 1, 1], turn[:, 2, 2] = c, -s, s, c, 1.0
        R = fixed @ turn
        along, rate, rate_dot = (x[:, i, None] * z for x in (q, q_dot, q_ddot))
        p = robot.offset[i] + (along @ fixed.T if slides[i] else 0.0 * along)
        a = _into(R, a + np.cross(dw, p) + np.cross(w, np.cross(w, p)))
        w, dw = _into(R, w), _into(R, dw)
        if slides[i]:
            a = a + 2.0 * np.cross(w, rate) + rate_dot
        else:
            dw = dw + np.cross(w, rate) + rate_dot
            w = w + rate
        turns.append(R)
        arms.append(p)
        bodies.append(_body(a, w, dw))

    # backward: forces and moments of each body, and moments of the rotors, at the joints before it
    for j in range(n):
        _project(bodies[j], j, slides, turns, arms, links[:, :, 10 * j : 10 * j + 10])
        if robot.rotor_coupling and j > 0:
            wrench = np.zeros((m, 6, 1))
            wrench[:, 3:, 0] = moments[j]
            _project(wrench, j - 1, slides, turns, arms, rotors[:, :, j : j + 1])
    return Regressor(links, rotors, carried if robot.rotor_coupling else np.zeros((m, n)))


def _body(a: Floats, w: Floats, dw: Floats) -> Floats:
    """Force and moment about the origin of a body by its parameters, (m, 6, 10)."""
    W = np.zeros((len(a), 6, 10))
    S = _skew(dw) + _skew(w) @ _skew(w)
    W[:, :3, 0] = a
    W[:, :3, 1:4] = S
    W[:, 3:, 1:4] = -_skew(a)
    for k, (i, j) in enumerate(PAIRS, 4):
        unit = np.zeros((3, 3))
        unit[i, j] = unit[j, i] = 1.0
        W[:, 3:, k] = dw @ unit + np.cross(w, w @ unit)
    return W


def _project(W: Floats, link: int, slides: list[bool], turns: list[Floats], arms: list[Floats], into: Floats) -> None:
    """Carry wrenches (m, 6, k) on a link to the joints that bear it."""
    for i in range(link, -1, -1):
        into[:, i] += W[:, 2 if slides[i] else 5]
        f, n = turns[i] @ W[:, :3], turns[i] @ W[:, 3:]
        W = np.concatenate([f, n + _skew(arms[i]) @ f], axis=1)


def _into(R: Floats, v: Any) -> Any:
    """Coordinates in the frames whose axes are the columns of R."""
    return np.einsum("mji,mj->mi", R, v)


def _skew(v: Floats) -> Floats:
    S = np.zeros((*v.shape[:-1], 3, 3))
    S[..., 0, 1], S[..., 0, 2], S[..., 1, 2] = -v[..., 2], v[..., 1], -v[..., 0]
    return S - np.swapaxes(S, -1, -2)
