"""Estimation of the parameters of an arm from a log, by least squares of torques and deformations.

For each joint there are two equations, link-side, with base parameters pi of the links and rotor inertias J = I_m ell:

    ell tau - J (kappa_ddot + carried) - xi(kappa_dot) - tau_s = 0      rotor (7), (10)-(11), friction (54)
    kappa - q - theta_err - D(tau_s) - offset = 0                       spring (2)-(3), where q is measured
    tau_s = Y pi + R J                                                  links (44)-(47)

Positions go through a Butterworth filter, forward and backward, so without phase, and are differentiated by central
differences of fourth order; then both equations through a second one, four times as narrow, which acts on both sides
alike, and one row is kept for every sample of its band, so that the noise of rows is independent. Each equation of
each joint is weighted by its own residual. Torques may be late: ``delay`` is a parameter, the same for all joints.
Parameters that a log cannot determine, by the standard deviation from the Jacobian, keep the robot file's values.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt
from scipy.signal import butter, sosfiltfilt

from vdfmu.arm.equations.harmonic_drive import deformation, kinematic_error
from vdfmu.arm.robot import Robot
from vdfmu.base.arrays import Floats
from vdfmu.base.errors import UsageError
from vdfmu.study.identify.base import BaseParameters, base_parameters
from vdfmu.study.identify.log import Log
from vdfmu.study.identify.problem import IdentificationProblem
from vdfmu.study.identify.regressor import body_parameters, regressor
from vdfmu.study.identify.search import solve

_POWER, _BANDS = 0.999, 3.0
"""The band of the second filter: times the frequency below which this part of the velocities' power is."""
_WIDE = 20.0
_ORDER = 4
_TRIM = 3.0
"""Ends of the log that are left out, in periods of the band: transients of the filters."""
_STILL = 1e-4
"""Range of a joint [rad or m] below which it did not move."""
_APART = 0.5
"""Range of kappa - q, as a share of kappa's, beyond which one of them is wrong."""
_LEFT = 0.3
"""Share of the root mean square of a torque that the model leaves, beyond which a note says so."""


@dataclass(frozen=True)
class Identified:
    """Estimated parameters and their deviations."""

    names: tuple[str, ...]
    """Drives and springs by joint, ``f_c[1]``, then the base parameters of the links."""
    units: tuple[str, ...]
    values: Floats
    deviation: Floats
    nominal: Floats
    """(m,): Estimates, standard deviations, and values of the robot file."""
    held: Mapping[str, str]
    """Parameters that are not identified and keep their values: why, and the way out."""
    torque_level: Floats
    """(n,) [N.m or N]: Root mean square of the spring torques."""
    stiffness: Floats
    stiffness_deviation: Floats
    """(n,) [N.m/rad or N/m]: Springs, link-side: torque by deformation at that torque."""
    delay: float
    """Delay of torques after positions [s]."""
    band: float
    """[Hz]."""
    t: Floats
    """Times of the rows, (k,) [s]."""
    torque: Floats
    torque_error: Floats
    """(k, n) [N.m or N]: Measured torques, link-side, filtered, and the rest that the model does not explain."""
    deformation_error: Floats | None
    """(k, n) [rad or m]; 0 for a joint whose link is not measured."""
    seen: npt.NDArray[np.bool_]
    """(n,): Joints whose links are measured."""
    base: BaseParameters

    def interval(self, factor: float = 1.96) -> tuple[Floats, Floats]:
        """Return the ends of the confidence intervals, 95 % by default."""
        return self.values - factor * self.deviation, self.values + factor * self.deviation

    def of(self, robot: Robot) -> list[float]:
        """Return the values that another robot has for the parameters, in the same order."""
        n = len(self.names) - len(self.base.names)
        drives = [
            float(getattr(robot, name)[int(i[:-1]) - 1]) for name, _, i in (v.partition("[") for v in self.names[:n])
        ]
        return [*drives, *(self.base.matrix @ body_parameters(robot)).tolist()]

    @property
    def advice(self) -> list[str]:
        """Data that the log lacks altogether, or that do not fit."""
        left, whole = ((each**2).mean(axis=0) for each in (self.torque_error, self.torque))
        notes = [
            f"joint {i + 1}: the model leaves more than {100 * _LEFT:.0f} % of the torque; check units, signs and "
            "order of the columns"
            for i in np.flatnonzero(left > _LEFT**2 * whole)
        ]
        if unseen := _numbers(~self.seen):
            notes.append(
                f"the log has no positions of links of joint {unseen}, so stiffnesses are those of the robot file, by "
                "which links are placed: log them by encoders behind the gears, or with the rotors' by a camera or "
                "tracker"
            )
        return notes


def identify(log: Log, robot: Robot, *, band: float | None = None) -> Identified:
    """Estimate drives, friction, springs and base parameters from a log.

    The robot has kinematics, ratios, width of the friction's sign and kinematic error; its values are the start, and
    parameters that are not identified keep them. The band [Hz] of the equations is by default three times the frequency
    below which 99.9 % of the velocities' power lie. UsageError for joints that did not move, or whose rotor and link
    did not move alike; a log that is too short for the band, or tells nothing; the split arrangement of friction.
    """
    if robot.friction != "lumped":
        raise UsageError(f"{robot.name}: expected friction in the lumped arrangement, got {robot.friction}.")
    moved = np.ptp(log.kappa, axis=0)
    if still := _numbers(moved < _STILL):
        raise UsageError(f"{log.where}: joint {still} did not move: nothing can be told of it. Log a motion of all.")
    if log.q is not None and (apart := _numbers(np.ptp(np.nan_to_num(log.kappa - log.q), axis=0) > _APART * moved)):
        raise UsageError(
            f"{log.where}: joint {apart}: expected rotors, divided by the ratio, and links to move alike, to what the "
            "springs give way. Check units, ratios, signs and order of the columns kappa and q."
        )
    if band is not None and not band > 0.0:
        raise UsageError(f"band: expected more than 0 Hz, got {band:g} Hz.")
    problem, rows, t, band = _prepare(log, robot, band)
    x, covariance, held = solve(problem)
    errors, shown, deviation = problem.errors(x), problem.shown, np.sqrt(np.diag(covariance))
    level, stiffness, slopes = problem.stiffness(x)
    return Identified(
        tuple(problem.names), tuple(problem.units), x[:shown], deviation[:shown], problem.start[:shown], held,
        level, stiffness, np.sqrt(np.einsum("ij,jk,ik->i", slopes, covariance, slopes)),
        float(x[problem.places["delay"]][0]), band, t[rows], problem.tau, errors[0],
        errors[1] if len(errors) > 1 else None, problem.seen, problem.base,
    )  # fmt: skip


def _numbers(chosen: Any) -> str:
    """Return the numbers of joints."""
    return ", ".join(str(i + 1) for i in np.flatnonzero(chosen))


def _prepare(log: Log, robot: Robot, band: float | None) -> tuple[IdentificationProblem, slice, Floats, float]:
    h = log.step
    if band is None:
        power = np.abs(np.fft.rfft(np.diff(log.kappa, axis=0), axis=0)) ** 2
        share = np.cumsum(power, axis=0) / power.sum(axis=0)
        last = max(int(np.searchsorted(column, _POWER)) for column in share.T)
        band = _BANDS * last / (h * (len(log.t) - 1))
    band = min(band, 0.1 / h)
    trim = int(np.ceil(_TRIM / band / h))
    stride = max(1, int(0.5 / band / h))
    rows = slice(trim, len(log.t) - trim, stride)
    count = len(range(*rows.indices(len(log.t))))
    if count < 50:
        raise UsageError(
            f"{log.where}: expected a log of at least {(50 * stride + 2 * trim) * h:.3g} s for the band of "
            f"{band:.3g} Hz, got {log.t[-1] - log.t[0]:.3g} s."
        )
    wide, narrow = (butter(_ORDER, f, fs=1.0 / h, output="sos") for f in (min(_WIDE * band, 0.4 / h), band))

    def filtered(signal: Floats) -> Floats:
        return sosfiltfilt(narrow, signal, axis=0)[rows]

    kappa = np.asarray(sosfiltfilt(wide, log.kappa, axis=0), dtype=float)
    kappa_dot = _slope(kappa, h)
    kappa_ddot = _slope(kappa_dot, h)
    error = kinematic_error(robot, kappa)
    seen: Any = np.zeros(robot.n, bool) if log.q is None else np.isfinite(log.q).all(axis=0)
    q = np.zeros_like(kappa)
    if not seen.all():  # links by the springs of the robot file, unless they are fast
        rigid = regressor(robot, kappa, kappa_dot, kappa_ddot, kappa_dot, kappa_ddot)
        tau_s = rigid.links @ body_parameters(robot) + rigid.rotors @ (robot.I_m * robot.ell)
        q = kappa - error - deformation(robot, tau_s)
    measured: Any = q if log.q is None else np.where(seen, log.q, 0.0)
    q = np.where(seen, sosfiltfilt(wide, measured, axis=0), q)
    q_dot = _slope(q, h)
    parts = regressor(robot, q, q_dot, _slope(q_dot, h), kappa_dot, kappa_ddot)
    base = base_parameters(robot)
    tau = log.tau * robot.ell
    stretch = filtered(log.kappa - measured - error) if seen.any() else None
    problem = IdentificationProblem(
        robot, base, filtered(parts.links[:, :, base.columns]), filtered(parts.rotors),
        filtered(kappa_ddot + parts.carried), filtered(tau), _slope(sosfiltfilt(narrow, tau, axis=0), h)[rows], stretch,
        seen, kappa_dot, filtered,
    )  # fmt: skip
    return problem, rows, log.t, band


def _slope(signal: Floats, h: float) -> Floats:
    """Differentiate by central differences of fourth order, at the ends of second."""
    found = np.gradient(signal, h, axis=0)
    found[2:-2] = (8.0 * (signal[3:-1] - signal[1:-3]) - (signal[4:] - signal[:-4])) / (12.0 * h)
    return found
