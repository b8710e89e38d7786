"""Estimation of the parameters of an arm from a log, by least squares of torques and deformations.

For each joint there are two equations, link-side, with base parameters pi of the links and rotor inertias J = I_m ell:

    ell tau - J (kappa_ddot + carried) - xi(kappa_dot) - tau_s = 0      rotor (7), (10)-(11), friction (54)
    kappa - q - theta_err - D(tau_s) - offset = 0                       spring (2)-(3), where q is measured
    tau_s = Y pi + R J                                                  links (44)-(47)

Positions go through a Butterworth filter, forward and backward, so without phase, and are differentiated by central
differences of fourth order; then both equations through a second one, four times as narrow, which acts on both sides
alike, and one row is kept for every sample of its band, so that the noise of rows is independent. Each equation of
each joint is weighted by its own residual. Torques may be late: ``delay`` is a parameter, the same for all joints.
What a log cannot tell, by the standard deviation that the Jacobian gives, keeps its value of the robot file.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from scipy.optimize import least_squares
from scipy.signal import butter, sosfiltfilt

from vdfmu.arrays import Floats
from vdfmu.equations.harmonic_drive import deformation, deformation_derivative, kinematic_error
from vdfmu.equations.regressor import body_parameters, regressor
from vdfmu.errors import UsageError
from vdfmu.identify.base import Base, base_parameters
from vdfmu.identify.log import Log
from vdfmu.model import Robot
from vdfmu.model.parameters import PARAMETERS

DRIVES = ("I_m", "f_c", "f_s", "v_s", "f_v")
SPRINGS = ("K_f0", "c_f", "K_w0", "c_w")
_POWER, _BANDS = 0.999, 3.0
"""The band of the second filter: times the frequency below which this part of the velocities' power is."""
_WIDE = 20.0
_ORDER = 4
_TRIM = 3.0
"""Ends of the log that are left out, in periods of the band: transients of the filters."""
_UNKNOWN = 0.15
"""Standard deviation, relative, from which on a parameter is not identified."""
_STILL = 1e-4
"""Range of a joint [rad or m] below which it did not move."""
_ROUNDS = 3
"""Of weights."""
_STEPS = 30
"""Of the search in each."""


@dataclass(frozen=True)
class Identified:
    """What was estimated.

    Attributes
    ----------
    names, units : tuple of str
        Drives and springs by joint, ``f_c[1]``, then the base parameters of the links.
    values, deviation, nominal : (m,) arrays
        With standard deviations, and the values of the robot file.
    held : mapping of str to str
        What is not identified and keeps its value: why, and the way out.
    stiffness, stiffness_deviation : (n,) arrays [N.m/rad or N/m]
        Of the springs, link-side: torque by deformation at the root mean square of the spring torques.
    delay : float [s]
        By which torques are later than positions.
    band : float [Hz]
    t : (k,) [s]
        Times of the rows.
    torque, torque_error : (k, n) [N.m or N]
        Measured torques, link-side, filtered, and what the model leaves of them.
    deformation_error : (k, n) [rad or m] or None
    base : Base
    """

    names: tuple[str, ...]
    units: tuple[str, ...]
    values: Floats
    deviation: Floats
    nominal: Floats
    held: Mapping[str, str]
    stiffness: Floats
    stiffness_deviation: Floats
    delay: float
    band: float
    t: Floats
    torque: Floats
    torque_error: Floats
    deformation_error: Floats | None
    base: Base

    def interval(self, factor: float = 1.96) -> tuple[Floats, Floats]:
        """Return the ends of the confidence intervals, 95 % by default."""
        return self.values - factor * self.deviation, self.values + factor * self.deviation

    def of(self, robot: Robot) -> list[float]:
        """Return the values that another robot has for the parameters, in the same order."""
        n = len(self.names) - len(self.base.names)
        drives = [
            float(getattr(robot, name)[int(i[:-1]) - 1])
            for name, _, i in (v.partition("[") for v in self.names[:n])
        ]
        return [*drives, *(self.base.matrix @ body_parameters(robot)).tolist()]

    @property
    def advice(self) -> list[str]:
        """What the log lacks altogether."""
        if self.deformation_error is not None:
            return []
        return [
            "the log has no positions of links, so stiffnesses are those of the robot file, by which links are placed: "
            "log them by encoders behind the gears, or with the rotors' by a camera or tracker"
        ]


@dataclass
class _Problem:
    """The rows, and the parameters' places in one vector."""

    robot: Robot
    base: Base
    Y: Floats
    R: Floats
    acceleration: Floats
    tau: Floats
    tau_dot: Floats
    stretch: Floats | None
    velocity: Floats
    narrow: Callable[[Floats], Floats]
    start: Floats = field(default_factory=lambda: np.zeros(0))
    names: list[str] = field(default_factory=list[str])
    units: list[str] = field(default_factory=list[str])
    places: dict[str, slice] = field(default_factory=dict[str, slice])

    def __post_init__(self) -> None:
        robot, values = self.robot, []
        for name in (*DRIVES, *(SPRINGS if self.stretch is not None else ())):
            self._place(name, robot.n)
            values.append(getattr(robot, name))
            for i, kind in enumerate(robot.joint_types):
                self.names.append(f"{name}[{i + 1}]")
                self.units.append(PARAMETERS[name].unit(kind))
        self._place("links", len(self.base.names))
        self.names += self.base.names
        self.units += self.base.units
        values.append(self.base.matrix @ body_parameters(robot))
        self.shown = len(self.names)
        self._place("delay", 1)
        self._place("offset", robot.n if self.stretch is not None else 0)
        values.append(np.zeros(1 + self.places["offset"].stop - self.places["offset"].start))
        self.start = np.concatenate(values).astype(float)

    def _place(self, name: str, count: int) -> None:
        begin = max((each.stop for each in self.places.values()), default=0)
        self.places[name] = slice(begin, begin + count)

    def errors(self, x: Floats) -> list[Floats]:
        """Residuals (k, n) of torques, link-side, and of deformations."""
        robot, at = self.robot, self.places
        J = x[at["I_m"]] * robot.ell
        sign, share, v = self._dry(x)
        dry = (x[at["f_c"]] + (x[at["f_s"]] - x[at["f_c"]]) * share) * sign
        tau_s = self._springs(x)
        late = x[at["delay"]] * self.tau_dot
        torque = self.tau + late - J * self.acceleration - self.narrow(dry + x[at["f_v"]] * v) - tau_s
        if self.stretch is None:
            return [torque]
        return [torque, self.stretch - deformation(self._robot(x), tau_s) - x[at["offset"]]]

    def jacobian(self, x: Floats) -> list[Floats]:
        """Return the derivatives (k, n, p) of the residuals by all parameters."""
        robot, at, n = self.robot, self.places, self.robot.n
        each = np.arange(n)
        sign, share, v = self._dry(x)
        step = x[at["f_s"]] - x[at["f_c"]]
        by_spring = np.zeros((*self.tau.shape, len(x)))
        by_spring[:, :, at["links"]] = self.Y
        by_spring[:, :, at["I_m"]] = self.R * robot.ell
        torque = -by_spring
        torque[:, each, at["I_m"].start + each] -= robot.ell * self.acceleration
        for name, slope in (
            ("f_c", (1.0 - share) * sign), ("f_s", share * sign), ("f_v", v),
            ("v_s", step * share * sign * 2.0 * v**2 / x[at["v_s"]] ** 3),
        ):  # fmt: skip
            torque[:, each, at[name].start + each] = -self.narrow(slope)
        torque[:, :, at["delay"].start] = self.tau_dot
        if self.stretch is None:
            return [torque]
        springs, tau_s = self._robot(x), self._springs(x)
        stretch = -np.asarray(deformation_derivative(springs, tau_s), dtype=float)[:, :, None] * by_spring
        for name in SPRINGS:
            here = getattr(springs, name)
            ends = [
                deformation(springs.with_parameters(**{name: here * f}), tau_s)
                for f in (1.0 + 1e-5, 1.0 - 1e-5)
            ]
            stretch[:, each, at[name].start + each] = -(ends[0] - ends[1]) / (2e-5 * here)
        stretch[:, each, at["offset"].start + each] = -1.0
        return [torque, stretch]

    def stiffness(self, x: Floats) -> tuple[Floats, Floats]:
        """Secant stiffness (n,) at the root mean square of the spring torques, and its slopes (n, p)."""
        torque = np.sqrt(np.mean(self._springs(x) ** 2, axis=0))
        slopes = np.zeros((self.robot.n, len(x)))

        def secant(x: Floats) -> Floats:
            return torque / np.asarray(deformation(self._robot(x), torque), dtype=float)

        for name in SPRINGS if self.stretch is not None else ():
            for k in range(self.places[name].start, self.places[name].stop):
                ends = [x.copy(), x.copy()]
                ends[0][k], ends[1][k] = 1.00001 * x[k], 0.99999 * x[k]
                slopes[:, k] = (secant(ends[0]) - secant(ends[1])) / (2e-5 * x[k])
        return secant(x), slopes

    def _dry(self, x: Floats) -> tuple[Floats, Floats, Floats]:
        """Sign and Stribeck share of the friction (54), and the velocity, (m, n) each."""
        v = self.velocity
        return np.tanh(v / self.robot.eps), np.exp(-((v / x[self.places["v_s"]]) ** 2)), v

    def _springs(self, x: Floats) -> Floats:
        return self.Y @ x[self.places["links"]] + self.R @ (x[self.places["I_m"]] * self.robot.ell)

    def _robot(self, x: Floats) -> Robot:
        return self.robot.with_parameters(**{n: x[self.places[n]] for n in SPRINGS if n in self.places})


def identify(log: Log, robot: Robot, *, band: float | None = None) -> Identified:
    """Estimate drives, friction, springs and base parameters from a log.

    Parameters
    ----------
    log : Log
    robot : Robot
        Kinematics, ratios, width of the friction's sign, kinematic error; and the values to start at, which what is not
        identified keeps.
    band : float, optional [Hz]
        Of the equations; default three times the frequency below which 99.9 % of the velocities' power lie.

    Raises
    ------
    UsageError
        For joints that did not move, a log that is too short for the band, or the split arrangement of friction.
    """
    if robot.friction != "lumped":
        raise UsageError(f"{robot.name}: expected friction in the lumped arrangement, got {robot.friction}.")
    moved = np.ptp(log.kappa, axis=0)
    if (still := np.flatnonzero(moved < _STILL)).size:
        which = ", ".join(str(i + 1) for i in still)
        raise UsageError(
            f"{log.where}: joint {which} did not move: nothing can be told of it. Log a motion of all."
        )
    problem, rows, t, band = _prepare(log, robot, band)
    x, covariance, held = _solve(problem)
    errors, shown, deviation = problem.errors(x), problem.shown, np.sqrt(np.diag(covariance))
    stiffness, slopes = problem.stiffness(x)
    return Identified(
        tuple(problem.names), tuple(problem.units), x[:shown], deviation[:shown], problem.start[:shown], held,
        stiffness, np.sqrt(np.einsum("ij,jk,ik->i", slopes, covariance, slopes)),
        float(x[problem.places["delay"]][0]), band, t[rows], problem.tau, errors[0],
        errors[1] if len(errors) > 1 else None, problem.base,
    )  # fmt: skip


def _prepare(log: Log, robot: Robot, band: float | None) -> tuple[_Problem, slice, Floats, float]:
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
    if log.q is not None:
        q = np.asarray(sosfiltfilt(wide, log.q, axis=0), dtype=float)
    else:  # where the springs of the robot file have the links, as far as they are not fast
        rigid = regressor(robot, kappa, kappa_dot, kappa_ddot, kappa_dot, kappa_ddot)
        tau_s = rigid.links @ body_parameters(robot) + rigid.rotors @ (robot.I_m * robot.ell)
        q = kappa - error - deformation(robot, tau_s)
    q_dot = _slope(q, h)
    parts = regressor(robot, q, q_dot, _slope(q_dot, h), kappa_dot, kappa_ddot)
    base = base_parameters(robot)
    tau = log.tau * robot.ell
    stretch = None if log.q is None else filtered(log.kappa - log.q - error)
    problem = _Problem(
        robot, base, filtered(parts.links[:, :, base.columns]), filtered(parts.rotors),
        filtered(kappa_ddot + parts.carried), filtered(tau), _slope(sosfiltfilt(narrow, tau, axis=0), h)[rows], stretch,
        kappa_dot, filtered,
    )  # fmt: skip
    return problem, rows, log.t, band


def _solve(problem: _Problem) -> tuple[Floats, Floats, dict[str, str]]:
    """Return all parameters, their covariance, and what is held.

    Gauss-Newton in logarithms of drives and springs, which are positive, and in parts of the sizes of all else.
    """
    x, count = problem.start.copy(), problem.places["links"].start
    free = np.ones(len(x), bool)
    free[:count] = x[:count] > 0.0
    held = {
        problem.names[i]: "0 in the robot file, where the search would start; give a value"
        for i in np.flatnonzero(~free)
    }
    sizes = _sizes(problem)
    weights = _weights(problem, x, free, sizes)
    while True:
        if name := _hold(problem, x, free, sizes, weights, held):
            place = problem.names.index(name)
            x[place], free[place] = problem.start[place], False
            continue
        before = x
        for _ in range(_ROUNDS):
            x = _fitted(problem, x, free, sizes, weights)
            weights = [np.sqrt(np.mean(e**2, axis=0)) for e in problem.errors(x)]
        if not (name := _hold(problem, x, free, sizes, weights, held)):
            scale = _scale(problem, x, sizes)[free]
            whole = np.zeros((len(x), len(x)))
            whole[np.ix_(free, free)] = _covariance(problem, x, free, sizes, weights) * np.outer(scale, scale)
            return x, whole, held
        place = problem.names.index(name)
        x = before
        x[place], free[place] = problem.start[place], False


def _scale(problem: _Problem, x: Floats, sizes: Floats) -> Floats:
    """Return what a change by 1 of the search's variables is: of positive parameters their value."""
    count = problem.places["links"].start
    return np.concatenate([x[:count], sizes[count:]])


def _slopes(problem: _Problem, x: Floats, free: Any, sizes: Floats, weights: list[Any]) -> Floats:
    scale = _scale(problem, x, sizes)[free]
    each = zip(problem.jacobian(x), weights, strict=True)
    return np.concatenate(
        [(e / np.reshape(w, (-1, 1))).reshape(-1, len(x))[:, free] * scale for e, w in each]
    )


def _weights(problem: _Problem, x: Floats, free: Any, sizes: Floats) -> list[Any]:
    """Return the noise of each equation: what the linear problem at the start leaves."""
    found = []
    for error, slope in zip(problem.errors(x), problem.jacobian(x), strict=True):
        scale = _scale(problem, x, sizes)[free]
        left = [e - s @ np.linalg.lstsq(s, e, rcond=None)[0] for e, s in
                ((error[:, i], slope[:, i, free] * scale) for i in range(error.shape[1]))]  # fmt: skip
        found.append(np.array([np.sqrt(np.mean(e**2)) for e in left]))
    return found


def _fitted(problem: _Problem, x: Floats, free: Any, sizes: Floats, weights: list[Any]) -> Floats:
    """Return the least squares with these weights."""
    count = problem.places["links"].start

    def whole(part: Floats) -> Floats:
        full = np.zeros(len(x))
        full[free] = part
        return np.concatenate(
            [x[:count] * np.exp(np.clip(full[:count], -5.0, 5.0)), x[count:] + sizes[count:] * full[count:]]
        )

    def residual(part: Floats) -> Floats:
        each = zip(problem.errors(whole(part)), weights, strict=True)
        return np.concatenate([(e / w).ravel() for e, w in each])

    def slopes(part: Floats) -> Floats:
        return _slopes(problem, whole(part), free, sizes, weights)

    start = np.zeros(int(free.sum()))
    jac: Any = slopes
    found: Any = least_squares(residual, start, jac, method="lm", xtol=1e-6, ftol=1e-9, max_nfev=_STEPS)
    return whole(found.x)


def _covariance(problem: _Problem, x: Floats, free: Any, sizes: Floats, weights: list[Any]) -> Floats:
    """Covariance of the search's variables."""
    slopes = _slopes(problem, x, free, sizes, weights)
    V: Any
    _, S, V = np.linalg.svd(np.linalg.qr(slopes, mode="r"))
    inverse = V.T / np.maximum(S, 1e-12 * S[0])
    return inverse @ inverse.T * (len(slopes) / max(1, len(slopes) - slopes.shape[1]))


def _hold(
    problem: _Problem, x: Floats, free: Any, sizes: Floats, weights: list[Any], held: dict[str, str]
) -> str | None:
    """Return the parameter that is known least, if that is too little, and note why."""
    covariance = _covariance(problem, x, free, sizes, weights)
    spread, places = np.sqrt(np.diag(covariance)), np.flatnonzero(free)
    shown = places < problem.shown
    worst = int(np.argmax(np.where(shown, spread, 0.0)))
    if spread[worst] < _UNKNOWN:
        return None
    correlation = covariance[worst] / (spread * spread[worst])
    correlation[worst] = 0.0
    correlation[~shown] = 0.0
    partner = int(np.argmax(np.abs(correlation)))
    name = problem.names[places[worst]]
    share = f"{100 * spread[worst]:.0f} %" if spread[worst] < 10.0 else "more than ten times"
    held[name] = (
        f"its standard deviation is {share} of its size, its correlation with {problem.names[places[partner]]} "
        f"{correlation[partner]:+.2f}; {_way_out(name)}"
    )
    return name


def _sizes(problem: _Problem) -> Floats:
    """Sizes of parameters: of those of the links the largest of the same unit, of a delay 1 ms, of an offset 1e-4."""
    sizes, links = np.abs(problem.start), problem.places["links"]
    for i in range(links.start, links.stop):
        same = [j for j in range(links.start, links.stop) if problem.units[j] == problem.units[i]]
        sizes[i] = max(np.abs(problem.start[same]).max(), 1e-9)
    sizes[problem.places["delay"]], sizes[problem.places["offset"]] = 1e-3, 1e-4
    return sizes


def _way_out(name: str) -> str:
    return {
        "I_m": "log faster motions",
        "f_s": "log slow motions, below v_s",
        "v_s": "log slow motions, about v_s",
        "f_v": "log motions at several speeds",
        "c_f": "log larger torques",
        "c_w": "log torques through 0",
        "K_w0": "log torques through 0",
    }.get(name.split("[")[0], "log a motion that moves more joints, further")


def _slope(signal: Floats, h: float) -> Floats:
    """Differentiate by central differences of fourth order, at the ends of second."""
    found = np.gradient(signal, h, axis=0)
    found[2:-2] = (8.0 * (signal[3:-1] - signal[1:-3]) - (signal[4:] - signal[:-4])) / (12.0 * h)
    return found
