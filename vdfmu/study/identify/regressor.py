"""Torques of the rigid arm as a product with its inertial parameters, which are linear in them (Atkeson et al. 1986).

A body has ten parameters: mass m, first moments m c, and the inertia about the origin of its frame {B}. For many states
at once: arrays have one row a state.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from vdfmu.arm.equations.rigid_body import BODY, PAIRS, body_parameters
from vdfmu.arm.robot import Robot
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


_STATES = 100
"""States from which the columns are made: ten times as many rows as columns for ten joints."""
_ZERO = 1e-8
"""Part of a column's size below which the remainder is rounding."""


class BaseParameters(NamedTuple):
    """Base parameters ``matrix @ phi``, the combinations that move a torque (Gautier and Khalil 1990).

    Columns of the regressor (p,), matrix (p, 10 n), names and units.
    """

    columns: list[int]
    matrix: Floats
    names: tuple[str, ...]
    units: tuple[str, ...]


def base_parameters(robot: Robot) -> BaseParameters:
    """Find the base parameters of an arm, from its structure: at random states, by projection column by column.

    A column of the regressor that the columns before it give is left out, and its parameter joins theirs.
    """
    n, random = robot.n, np.random.default_rng(0)
    q, q_dot, q_ddot = random.uniform(-2.0, 2.0, (3, max(_STATES, 20 * n), n))
    Y = regressor(robot, q, q_dot, q_ddot, 0.0 * q, 0.0 * q).links
    Y = Y.reshape(-1, 10 * n)
    columns: list[int] = []
    basis = np.zeros((len(Y), 0))
    size = np.linalg.norm(Y, axis=0)
    for k in np.flatnonzero(size > _ZERO * size.max()):
        left = Y[:, k] - basis @ (basis.T @ Y[:, k])
        left = left - basis @ (basis.T @ left)
        if np.linalg.norm(left) > _ZERO * size[k]:
            columns.append(int(k))
            basis = np.column_stack([basis, left / np.linalg.norm(left)])
    matrix: Any = np.linalg.lstsq(Y[:, columns], Y, rcond=None)[0]
    matrix[np.abs(matrix) < _ZERO] = 0.0
    parameters = [f"{name}{i + 1}" for i in range(n) for name in BODY]
    names = tuple(_combination(row, parameters) for row in matrix)
    kinds = ("kg", "kg.m", "kg.m2")
    units = tuple(kinds[min(2, (k % 10 + 2) // 3)] for k in columns)
    return BaseParameters(columns, matrix, names, units)


def link_errors(robot: Robot, share: float) -> Floats:
    """Return changes (10 n, 10 n) of inertial parameters, one a column, by a standard deviation of a robot file.

    Masses and moments of inertia are off by a share, centres of mass by that share of the link's radius of gyration.
    """
    ways = np.zeros((10 * robot.n, 10 * robot.n))
    here = body_parameters(robot)

    def change(k: int, i: int, **parameters: Floats) -> None:
        ways[:, 10 * i + k] = body_parameters(robot.with_parameters(**parameters)) - here

    for i in range(robot.n):
        mass, inertia = robot.mass[i], robot.inertia[i]
        one = np.eye(robot.n)[i]
        change(0, i, mass=robot.mass + share * mass * one)
        for j in range(3):
            reach = share * np.sqrt(np.trace(inertia) / (2.0 * mass))
            change(1 + j, i, centroid=robot.centroid + reach * np.outer(one, np.eye(3)[j]))
        size = share * np.sqrt(np.outer(np.diag(inertia), np.diag(inertia)))
        for k, (a, b) in enumerate(PAIRS, 4):
            moment = np.zeros((3, 3))
            moment[a, b] = moment[b, a] = size[a, b]
            change(k, i, inertia=robot.inertia + one[:, None, None] * moment)
    return ways


def link_covariance(robot: Robot, base: BaseParameters, share: float) -> Floats | None:
    """Return the covariance (p, p) of the base parameters of a robot file, None for an infinite share."""
    errors = base.matrix @ link_errors(robot, share) if np.isfinite(share) else None
    return None if errors is None else errors @ errors.T


def _combination(row: Floats, parameters: list[str]) -> str:
    """Name of a base parameter: ``Izz1 + 0.25 m2 - my2``."""
    text = ""
    for factor, name in zip(row, parameters, strict=True):
        if factor:
            size = "" if abs(abs(factor) - 1.0) < _ZERO else f"{abs(factor):.4g} "
            text += f" {'-' if factor < 0 else '+'} {size}{name}"
    return text.removeprefix(" + ").strip()
