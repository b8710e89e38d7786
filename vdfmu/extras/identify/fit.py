"""Estimates the parameters of an arm by least squares from the torques and deformations in a log and a robot file.

Each joint has two equations, link-side, with base parameters pi of the links and rotor inertias J = I_m ell:

    ell (tau - tau_0) - J (kappa_ddot + carried) - xi(kappa_dot) - tau_s = 0      rotor (7), (10)-(11), friction (54)
    kappa - q - theta_err - D(tau_s) - offset - delay_q kappa_dot = 0             spring (2)-(3), where q is measured
    tau_s = Y pi + R J + torque of a counterbalance                               links (44)-(47)

with tau delayed by ``delay_tau`` relative to positions. Positions are filtered with a zero-phase (forward and backward)
Butterworth filter and differentiated by central differences of fourth order. Then both equations are filtered with a
second one, a sixtieth as wide, and thinned to its sampling rate. Friction and springs, whose laws are nonlinear, are
evaluated at all samples before it. The robot file is treated as a measurement with errors; see
:mod:`~vdfmu.extras.identify.search` for it and for weights and intervals.
"""

from __future__ import annotations

from collections.abc import Mapping
from contextlib import suppress
from dataclasses import dataclass, replace
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt

from vdfmu.arm.equations.rigid_body import body_parameters
from vdfmu.arm.robot import Robot, check_robot
from vdfmu.arm.robot.parameters import PARAMETERS
from vdfmu.base.arrays import Floats
from vdfmu.base.errors import ModelError, UsageError
from vdfmu.base.toml_file import ROUNDING, toml_text
from vdfmu.extras.identify.log import Log
from vdfmu.extras.identify.problem import (
    DRIVES,
    SPRINGS,
    BaseParameters,
    IdentificationProblem,
    link_covariance,
    link_errors,
    regressor,
)
from vdfmu.extras.identify.rows import Rows, file_torques, rows_of
from vdfmu.extras.identify.search import Weak, solve, with_links

PRIOR = 0.2
"""Relative errors of a robot file: masses, moments of inertia, and centres of mass relative to radii of gyration."""
NORMAL_95 = 1.96
"""Standard deviations that contain 95 % of normal errors."""
_HELD = 1e-3
"""Relative error of a robot file that is so small that links keep its values."""
_STILL = 1e-4
"""Range of a joint [rad or m] below which it counts as not moved."""
_APART = 0.5
"""Range of kappa - q, relative to kappa's, beyond which one of them is wrong."""


@dataclass(frozen=True)
class Identified:
    """Estimated parameters and their deviations."""

    names: tuple[str, ...]
    """Names: drives and springs by joint, ``f_c[1]``, then the base parameters of the links."""
    units: tuple[str, ...]
    values: Floats
    deviation: Floats
    nominal: Floats
    """Estimates, standard deviations, and values of the robot file, (m,)."""
    held: Mapping[str, str]
    """Parameters that are not identified and keep their values, to the reason and the fix."""
    weak: Mapping[str, Weak]
    """Parameters that stay near the robot file's value because the log hardly determines them."""
    torque_level: Floats
    """Root mean square of the spring torques, (n,) [N.m or N]."""
    stiffness: Floats
    stiffness_deviation: Floats
    """Secant stiffness of the springs at that torque, link-side, (n,) [N.m/rad or N/m]."""
    x: Floats
    """All parameters in SI units, including the constants between encoders, (p,)."""
    x_held: Floats
    """All parameters with the links of the robot file."""
    lag: Floats
    """Corrected delays of link encoders [s], (n,)."""
    band: float
    """[Hz]."""
    t: Floats
    """Times of the rows [s], (k,)."""
    torque: Floats
    torque_error: Floats
    """Measured torques, link-side and filtered, and their residuals, (k, n) [N.m or N]."""
    deformation_error: Floats | None
    """Residuals of deformations, (k, n) [rad or m]; 0 for a joint whose link is not measured."""
    seen: npt.NDArray[np.bool_]
    """Whether each joint's link is measured, (n,)."""
    base: BaseParameters
    prior: float
    """Relative errors of the links in the robot file."""

    def interval(self, factor: float = NORMAL_95) -> tuple[Floats, Floats]:
        """Return the ends of the confidence intervals, 95 % by default."""
        return self.values - factor * self.deviation, self.values + factor * self.deviation

    @property
    def links(self) -> slice:
        """Indices of the base parameters."""
        first = self.names.index(self.base.names[0])
        return slice(first, first + len(self.base.names))

    @property
    def delay(self) -> float:
        """Delay of torques relative to positions [s]."""
        return float(self.values[self.names.index("delay_tau")])

    def of(self, robot: Robot) -> list[float]:
        """Return another robot's values of the parameters, in the same order; 0 for sensors."""
        values = np.zeros(len(self.names))
        values[self.links] = self.base.matrix @ body_parameters(robot)
        for k, name in enumerate(self.names):
            quantity, _, joint = name.partition("[")
            if quantity in PARAMETERS:
                values[k] = getattr(robot, quantity)[int(joint[:-1]) - 1]
        return values.tolist()

    @property
    def advice(self) -> list[str]:
        """Notes on data that are missing in the log."""
        notes: list[str] = []
        if unseen := _numbers(~self.seen):
            notes.append(
                f"the log has no link positions of joint {unseen}, so stiffnesses are the robot file's, and their "
                "errors are not in the intervals: log them by encoders behind the gears, or by a camera or tracker"
            )
        return notes


def identify(log: Log, robot: Robot, *, band: float | None = None, prior: float = PRIOR) -> Identified:
    """Estimate drives, friction, springs, base parameters and faults of sensors from a log.

    The robot provides kinematics, ratios, the width of the regularised friction and the kinematic error; its values are
    the start, and parameters that are not identified keep them. By default the band [Hz] of the equations is three
    times the frequency below which the velocities have 99.9 % of their power, or wider if the log is short. `prior` is
    the relative error of the robot file: of masses, moments of inertia, and centres of mass relative to radii of
    gyration; infinity if nothing is known. UsageError for joints that did not move, or whose rotor and link moved
    differently, for a log that is too short for the band, and for the split arrangement of friction.
    """
    check_settings(robot, band, prior)
    moved = np.ptp(log.kappa, axis=0)
    if still := _numbers(moved < _STILL):
        raise UsageError(f"{log.where}: joint {still} did not move, so it is unknown. Log a motion of all joints.")
    if log.q is not None and (apart := _numbers(np.ptp(np.nan_to_num(log.kappa - log.q), axis=0) > _APART * moved)):
        raise UsageError(
            f"{log.where}: joint {apart}: expected rotors, divided by the ratio, and links to move alike. "
            "Check units, ratios, signs and order of the columns kappa and q."
        )
    problem, t, band, lag = rows_of(log, robot, band)
    narrower = rows_of(log, robot, band, lag, share=0.5).problem
    estimate = solve(problem, link_covariance(robot, problem.base, prior), narrower)
    x, shown = estimate.x, problem.shown
    near = link_covariance(robot, problem.base, min(prior, _HELD))
    assert near is not None
    held = x if prior <= _HELD else with_links(problem, near)
    errors, deviation = problem.errors(x), np.sqrt(np.diag(estimate.covariance))
    level, stiffness, slopes = problem.stiffness(x)
    return Identified(
        tuple(problem.names[k] for k in shown),
        tuple(problem.units[k] for k in shown),
        x[shown],
        deviation[shown],
        problem.start[shown],
        estimate.held,
        estimate.weak,
        level,
        stiffness,
        np.sqrt(np.einsum("ij,jk,ik->i", slopes, estimate.covariance, slopes)),
        x,
        held,
        lag,
        band,
        t,
        problem.tau,
        errors[0],
        errors[1] if len(errors) > 1 else None,
        problem.seen,
        problem.base,
        prior,
    )


def check_settings(robot: Robot, band: float | None, prior: float) -> None:
    """Raise UsageError for settings of an identification that are out of range, or a robot with split friction."""
    if robot.friction != "lumped":
        raise UsageError(f"{robot.name}: expected friction in the lumped arrangement, got {robot.friction}.")
    if band is not None and not band > 0.0:
        raise UsageError(f"band: expected more than 0 Hz, got {band:g} Hz.")
    if not prior > 0.0:
        raise UsageError(f"prior: expected a share above 0, or inf if nothing is known of the links, got {prior:g}.")


def _numbers(chosen: Any) -> str:
    return ", ".join(str(i + 1) for i in np.flatnonzero(chosen))


def identified_robot(fit: Identified, robot: Robot, where: str) -> tuple[Robot, list[str]]:
    """Return the robot with the identified values, whose sources name the log, and the notes.

    The links are those of `with_identified_links`. If these are not physical bodies, which a check of the verdict
    reports, the links are not changed. `robot` is the start of the identification, and `where` names the log in
    sources.
    """
    values = dict(zip(fit.names, fit.values, strict=True))
    sources, arrays, notes = dict(robot.sources), dict[str, Any](), list[str]()
    text = f"Identified from {where}"
    deviation = dict(zip(fit.names, fit.deviation, strict=True))
    for name in (*DRIVES, *SPRINGS, *(["F_cb"] if robot.counterbalance else [])):
        elements = [f"{name}[{i + 1}]" for i in range(robot.n)]
        arrays[name] = np.array([values.get(e, here) for e, here in zip(elements, getattr(robot, name), strict=True)])
        for i, each in enumerate(elements):
            if each not in fit.held and deviation.get(each, 0.0) > 0.0:
                path = PARAMETERS[name].path.replace("joints", f"joints[{i + 1}]", 1)
                source = f"{text}, +- {NORMAL_95 * deviation[each]:.2g} (95 %)"
                sources[path] = f"{source}, near {sources.get(path, 'the robot')}" if each in fit.weak else source
    made = robot.with_parameters(**arrays)
    if robot.payload:
        notes.append("the links stay as they are: the payload is identified with the last of them")
    else:
        with suppress(ModelError):
            made = with_identified_links(fit, made)
            nearest = f"{text}: with its base parameters, nearest to the robot file"
            sources |= {PARAMETERS[name].path: nearest for name in ("mass", "centroid", "inertia")}
    return replace(check_robot(made), sources=sources), notes


def with_identified_links(fit: Identified, robot: Robot) -> Robot:
    """Return the robot with links of the identified base parameters, which do not determine all masses and inertias.

    Those nearest to the robot's are chosen, of the same shape if possible. ModelError if they are not physical bodies.
    """
    phi, ways = body_parameters(robot), link_errors(robot, 1.0)
    base, matrix = fit.values[fit.links], fit.base.matrix
    steps: Any = np.linalg.lstsq(matrix @ ways, base - matrix @ phi, rcond=None)[0]
    m, x, y, z, *I = (phi + ways @ steps).reshape(-1, 10).T
    c = np.stack([x, y, z], axis=1) / m[:, None]
    rows = [[I[0], I[1], I[3]], [I[1], I[2], I[4]], [I[3], I[4], I[5]]]
    about_origin = np.moveaxis(np.array(rows), -1, 0)
    square = np.einsum("ni,ni->n", c, c)[:, None, None] * np.eye(3) - np.einsum("ni,nj->nij", c, c)
    inertia = about_origin - m[:, None, None] * square
    return check_robot(robot.with_parameters(mass=m, centroid=c, inertia=inertia))


def robot_text(robot: Robot, head: str) -> str:
    """Return the content of a robot file below a comment."""
    return f"# {head}\n# SI units, angles in rad.\n\n{toml_text(robot.to_dict(), ROUNDING)}"


_FEWEST = 10
"""Rows of a log to score."""


class LogScore(NamedTuple):
    """Errors by joint, each (n,), of torques link-side [N.m or N] and of deformations [rad or m]."""

    torque: Floats
    """RMS of the measured torques."""
    torque_left: Floats
    torque_most: Floats
    """RMS and largest absolute value of their residuals with the model."""
    held_left: Floats
    """The same for the links of the robot file with everything else fitted."""
    rigid_left: Floats
    """RMS of their residuals with five terms fitted to the same log as the model: a constant, acceleration, speed, its
    sign, and the robot file's gravity."""
    deformation: Floats
    deformation_left: Floats
    deformation_most: Floats
    """RMS values of deformations about their mean, corrected for encoder delay; NaN for joints without link encoders.
    """
    rows: Rows
    torque_error: Floats
    deformation_error: Floats
    """Residuals in the rows, (k, n)."""
    held_error: Floats
    """Torque residuals with the links of the robot file and everything else fitted, (k, n)."""
    rigid_deformation: Floats
    """Deformations about their mean, corrected for the encoder delay that fits rigid joints best, (k, n)."""
    load: Floats
    """Spring torques of the model, (k, n) [N.m or N]."""


def score(fit: Identified, robot: Robot, fitted: Log, log: Log) -> LogScore:
    """Score, on a log, parameters that were identified from another one, in the same band.

    Constants between encoders are fitted for each log, because incremental encoders count from their start.
    """
    if (log.q is None) != (fitted.q is None):
        sides = ["without" if each.q is None else "with" for each in (fitted, log)]
        raise UsageError(
            f"{log.where}: expected a log {sides[0]} encoders behind the gears, as in {fitted.where}, got one "
            f"{sides[1]} them."
        )
    rows = rows_of(log, robot, fit.band, fit.lag, _FEWEST)
    errors, held = rows.problem.errors(fit.x), rows.problem.errors(fit.x_held)[0]
    left, tau = errors[0], rows.problem.tau
    before = rows if fitted is log else rows_of(fitted, robot, fit.band, fit.lag, _FEWEST)
    terms, fitted_terms = _terms(rows, robot), _terms(before, robot)
    rigid = np.array(
        [
            _rms(tau[:, i] - terms[i] @ np.linalg.lstsq(fitted_terms[i], before.problem.tau[:, i], rcond=None)[0])
            for i in range(robot.n)
        ]
    )
    bent, error, stiff = np.full((3, *tau.shape), np.nan)
    if rows.problem.stretch is not None:
        seen = rows.problem.seen
        bent[:, seen] = (rows.problem.stretch - fit.x[rows.problem.places["delay_q"]] * rows.problem.speed)[:, seen]
        error[:, seen] = errors[1][:, seen]
        for i in np.flatnonzero(seen):
            stiff[:, i] = _about(rows.problem.stretch[:, i], rows.problem.speed[:, i], before.problem, int(i))
    bent, error = bent - bent.mean(axis=0), error - error.mean(axis=0)
    return LogScore(
        _rms(tau),
        _rms(left),
        np.abs(left).max(axis=0),
        _rms(held),
        rigid,
        _rms(bent),
        _rms(error),
        np.abs(error).max(axis=0),
        rows,
        left,
        error,
        held,
        stiff,
        rows.problem.spring_torques(fit.x),
    )


def _about(stretch: Floats, speed: Floats, fitted: IdentificationProblem, i: int) -> Floats:
    """Return deformations (k,) about their mean, corrected for the encoder delay that explains those of another log."""
    assert fitted.stretch is not None
    delay = np.polyfit(fitted.speed[:, i], fitted.stretch[:, i], 1)[0]
    left = stretch - delay * speed
    return left - left.mean()


def _rms(values: Floats) -> Any:
    return np.sqrt(np.mean(values**2, axis=0))


def _terms(rows: Rows, robot: Robot) -> list[Floats]:
    """Return the five terms of each joint's torque, (k, 5)."""
    p = rows.problem
    sign, still = p.narrow(np.tanh(p.velocity / robot.eps)), np.zeros_like(p.position)
    weight = file_torques(robot, p.position, regressor(robot, p.position, still, still, still, still))
    return [
        np.stack([np.ones(len(p.tau)), p.acceleration[:, i], p.speed[:, i], sign[:, i], weight[:, i]], axis=1)
        for i in range(robot.n)
    ]
