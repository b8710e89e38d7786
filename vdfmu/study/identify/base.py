"""Base parameters: the combinations of inertial parameters that move a torque (Gautier and Khalil 1990)."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from vdfmu.arm.equations.rigid_body import BODY, PAIRS, body_parameters
from vdfmu.arm.robot import Robot
from vdfmu.base.arrays import Floats
from vdfmu.study.identify.regressor import regressor

_STATES = 100
"""States from which the columns are made: ten times as many rows as columns for ten joints."""
_ZERO = 1e-8
"""Part of a column's size below which the remainder is rounding."""


class BaseParameters(NamedTuple):
    """Base parameters ``matrix @ phi``: columns of the regressor (p,), matrix (p, 10 n), names and units."""

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
