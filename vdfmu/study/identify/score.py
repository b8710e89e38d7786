"""What an identified arm leaves of a log that it was not fitted to, beside a rigid model without physics."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from vdfmu.arm.robot import Robot
from vdfmu.base.arrays import Floats
from vdfmu.base.errors import UsageError
from vdfmu.study.identify.fit import Identified
from vdfmu.study.identify.log import Log
from vdfmu.study.identify.regressor import regressor
from vdfmu.study.identify.rows import Rows, file_torques, rows_of

_FEWEST = 10
"""Rows of a log to be scored."""


class LogScore(NamedTuple):
    """Errors by joint, each (n,), of torques link-side [N.m or N] and of deformations [rad or m]."""

    torque: Floats
    """Root mean square of the measured torques."""
    torque_left: Floats
    torque_most: Floats
    """Root mean square and largest size of what the model leaves of them."""
    rigid_left: Floats
    """Root mean square of what five terms leave that were fitted to the same log as the model: a constant,
    acceleration, speed, its sign, and the robot file's gravity."""
    deformation: Floats
    deformation_left: Floats
    deformation_most: Floats
    """The same of deformations about their mean, after the delay of encoders; NaN of joints without encoders of links.
    """
    rows: Rows
    torque_error: Floats
    deformation_error: Floats
    """(k, n): What is left in the rows."""
    load: Floats
    """(k, n): Spring torques of the model [N.m or N]."""


def score(found: Identified, robot: Robot, fitted: Log, log: Log) -> LogScore:
    """Score on a log the parameters that were identified on another, in the same band.

    A constant between the encoders is the log's own: incremental encoders count from where they start.
    """
    if (log.q is None) != (fitted.q is None):
        sides = ["without" if each.q is None else "with" for each in (fitted, log)]
        raise UsageError(
            f"{log.where}: expected a log {sides[0]} encoders behind the gears, as {fitted.where}, got one {sides[1]} "
            "them."
        )
    rows = rows_of(log, robot, found.band, found.lag, _FEWEST)
    errors = rows.problem.errors(found.x)
    left, tau = errors[0], rows.problem.tau
    before = rows if fitted is log else rows_of(fitted, robot, found.band, found.lag, _FEWEST)
    terms, own = _terms(rows, robot), _terms(before, robot)
    rigid = np.array([
        _rms(tau[:, i] - terms[i] @ np.linalg.lstsq(own[i], before.problem.tau[:, i], rcond=None)[0])
        for i in range(robot.n)
    ])  # fmt: skip
    bent, error = np.full((2, *tau.shape), np.nan)
    if rows.problem.stretch is not None:
        seen = rows.problem.seen
        bent[:, seen] = (rows.problem.stretch - found.x[rows.problem.places["delay_q"]] * rows.problem.speed)[:, seen]
        error[:, seen] = errors[1][:, seen]
    bent, error = bent - bent.mean(axis=0), error - error.mean(axis=0)
    return LogScore(
        _rms(tau), _rms(left), np.abs(left).max(axis=0), rigid,
        _rms(bent), _rms(error), np.abs(error).max(axis=0), rows, left, error,
        rows.problem.spring_torques(found.x),
    )  # fmt: skip


def _rms(values: Floats) -> Any:
    return np.sqrt(np.mean(values**2, axis=0))


def _terms(rows: Rows, robot: Robot) -> list[Floats]:
    """Five terms of the torque of each joint (k, 5)."""
    p = rows.problem
    sign, still = p.narrow(np.tanh(p.velocity / robot.eps)), np.zeros_like(p.position)
    weight = file_torques(robot, p.position, regressor(robot, p.position, still, still, still, still))
    return [
        np.stack([np.ones(len(p.tau)), p.acceleration[:, i], p.speed[:, i], sign[:, i], weight[:, i]], axis=1)
        for i in range(robot.n)
    ]
