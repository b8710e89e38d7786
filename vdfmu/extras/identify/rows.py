"""The rows of an identification: a filtered, differentiated and thinned log."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from scipy.interpolate import CubicSpline
from scipy.signal import butter, sosfiltfilt

from vdfmu.arm.drive.counterbalance import counterbalance_torque
from vdfmu.arm.equations.harmonic_drive import deformation, kinematic_error
from vdfmu.arm.equations.rigid_body import body_parameters
from vdfmu.arm.robot import Robot
from vdfmu.base.arrays import Floats
from vdfmu.base.errors import UsageError
from vdfmu.extras.identify.faults import fastest
from vdfmu.extras.identify.log import Log
from vdfmu.extras.identify.problem import IdentificationProblem, Regressor, TorqueParts, base_parameters, regressor

_BANDS = 3.0
"""Band of the second filter, as a multiple of the frequency below which velocities have nearly all of their power."""
_WIDE = 60.0
"""Band of the first filter relative to the second, wide because fast motion also affects friction at low
frequencies."""
_ORDER = 4
_TRIM = 3.0
"""Ends of the log that are unused because of filter transients, in periods of the band."""
_FEWEST = 50
"""Number of rows of an identification."""
_ZEROS, _EVEN = 8, 0.05
"""Number of encoder zeros to try, and largest unevenness of encoder steps."""
_ENOUGH = 100
"""For a short log the band is widened until this many rows remain."""


class Rows(NamedTuple):
    """Rows of a log, and the identification problem defined by them."""

    problem: IdentificationProblem
    t: Floats
    """Times of the rows (k,) [s]."""
    band: float
    """[Hz]."""
    lag: Floats
    """Delay of link encoders that was corrected beforehand, (n,) [s]."""


def rows_of(
    log: Log, robot: Robot, band: float | None, lag: Floats | None = None, fewest: int = _FEWEST, share: float = 1.0
) -> Rows:
    """Return the rows of a log, in a band narrowed by `share`. If the delay of link encoders is None, estimate it."""
    h = log.step
    if band is None:
        last = max(fastest(column) for column in np.diff(log.kappa, axis=0).T)
        whole = h * (len(log.t) - 1)
        band = max(_BANDS * last, 0.5 * _ENOUGH + 2.0 * _TRIM) / whole
        band = min(band, 0.1 / h)
    elif band > 0.1 / h:
        raise UsageError(f"band: expected at most a tenth of {log.where}'s rate, {0.1 / h:.4g} Hz, got {band:g} Hz.")
    trim = int(np.ceil(_TRIM / band / h))
    stride = max(1, int(0.5 / band / h))
    rows = slice(trim, len(log.t) - trim, stride)
    count = len(range(*rows.indices(len(log.t))))
    if count < fewest:
        raise UsageError(
            f"{log.where}: expected a log of at least {(fewest * stride + 2 * trim) * h:.3g} s for the band of "
            f"{band:.3g} Hz, got {log.t[-1] - log.t[0]:.3g} s."
        )
    first, narrow = (butter(_ORDER, f, fs=1.0 / h, output="sos") for f in (min(_WIDE * band, 0.4 / h) * share, band))

    def filtered(signal: Floats) -> Floats:
        return sosfiltfilt(narrow, signal, axis=0)[rows]

    tau = log.tau * robot.ell
    kappa = np.asarray(sosfiltfilt(first, log.kappa, axis=0), dtype=float)
    kappa_dot = slope(kappa, h)
    kappa_ddot = slope(kappa_dot, h)
    error = kinematic_error(robot, kappa)
    seen: Any = np.zeros(robot.n, bool) if log.q is None else np.isfinite(log.q).all(axis=0)
    q = np.zeros_like(kappa)
    if not seen.all():  # link positions from the robot file's springs, which are accurate for slow motions
        tau_s = file_torques(robot, kappa, regressor(robot, kappa, kappa_dot, kappa_ddot, kappa_dot, kappa_ddot))
        q = kappa - error - deformation(robot, tau_s)
    measured: Any = q if log.q is None else np.where(seen, log.q, 0.0)
    speed = filtered(kappa_dot)
    stretch = filtered(log.kappa - measured - error) if seen.any() else None
    if lag is None:
        lag = np.zeros(robot.n) if stretch is None else _lag(stretch, speed, filtered(tau))
    smooth = sosfiltfilt(first, measured, axis=0)
    for i in np.flatnonzero(seen):
        q[:, i] = CubicSpline(log.t, smooth[:, i])(log.t + lag[i])
    q_dot = slope(q, h)
    parts = regressor(robot, q, q_dot, slope(q_dot, h), kappa_dot, kappa_ddot)
    base = base_parameters(robot)
    step = _step_sizes(measured)
    torques = TorqueParts(parts.links[:, :, base.columns], parts.rotors, counterbalance_hold(robot, q))
    problem = IdentificationProblem(
        robot,
        base,
        h,
        torques,
        TorqueParts(*map(filtered, torques)),
        filtered(kappa_ddot + parts.carried),
        filtered(tau),
        slope(sosfiltfilt(narrow, tau, axis=0), h)[rows],
        stretch,
        lambda: [filtered(error) for error in _steps(step, q)],
        step,
        seen,
        filtered(q),
        speed,
        kappa_dot,
        filtered,
    )
    return Rows(problem, log.t[rows], band, lag)


def counterbalance_hold(robot: Robot, q: Floats) -> Floats:
    """Spring torques (m, n) of counterbalances of 1 N at positions (m, n)."""
    if not robot.counterbalance:
        return np.zeros_like(q)
    return -counterbalance_torque(robot.with_parameters(F_cb=np.sign(robot.F_cb)), q.T).T


def file_torques(robot: Robot, q: Floats, parts: Regressor) -> Floats:
    """Return the robot file's spring torques (m, n) at positions (m, n), with its regressor there."""
    links = parts.links @ body_parameters(robot) + parts.rotors @ (robot.I_m * robot.ell)
    return links + counterbalance_hold(robot, q) * robot.F_cb


def _step_sizes(measured: Floats) -> Floats:
    """Return the encoder steps (n,) in positions (m, n) [rad or m]; 0 if values are not multiples of one step."""
    step = np.zeros(measured.shape[1])
    for i, column in enumerate(measured.T):
        apart = np.diff(np.unique(column))
        if len(apart) and np.abs(apart / apart.min() - np.rint(apart / apart.min())).max() < _EVEN:
            step[i] = apart.min()
    return step


def _steps(step: Floats, q: Floats) -> list[Floats]:
    """Yield quantisation errors (m, n) of encoders with steps (n,) along smooth positions, for random offsets."""
    random = np.random.default_rng(0)
    zeros = random.uniform(size=(_ZEROS, 1, q.shape[1])) * step
    safe = np.where(step > 0.0, step, 1.0)
    return [np.where(step > 0.0, np.rint((q + zero) / safe) * safe - zero - q, 0.0) for zero in zeros]


def _lag(stretch: Floats, speed: Floats, tau: Floats) -> Floats:
    """Return the delay of link encoders [s], assuming that springs deform under the motor torques."""
    ones = np.ones(len(tau))
    each = zip(stretch.T, speed.T, tau.T, strict=True)
    return np.array([np.linalg.lstsq(np.stack([v, ones, t], axis=1), s, rcond=None)[0][0] for s, v, t in each])


def slope(signal: Floats, h: float) -> Floats:
    """Differentiate by central differences of fourth order; the two rows at each end are of lower order."""
    rate = np.gradient(signal, h, axis=0)
    rate[2:-2] = (8.0 * (signal[3:-1] - signal[1:-3]) - (signal[4:] - signal[:-4])) / (12.0 * h)
    return rate
