"""Identifies stiffness, damping and delay of the drives from motor torques and positions only.

The linear model of the arm, :mod:`~vdfmu.extras.identify.motor_side`, is fitted to the spectra of periodic torques, all
joints at once. Stiffness, damping, viscous friction and rotor of each joint, the payload and one delay are free. Dry
friction is a sum of shapes over the measured motion of each motor, whose sizes are free too.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt

from vdfmu.arm.robot import Robot
from vdfmu.base.arrays import Floats
from vdfmu.extras.identify.log import Log
from vdfmu.extras.identify.motor_side import Complex, Drives, MotorResponse, MotorSide, times
from vdfmu.extras.identify.periodic import PeriodicTorques, Periods, aligned, periods_of

SURE, SHARE = 0.025, 0.5
"""Largest standard deviation of an identifiable stiffness, and smallest explained share of the link's torque."""
ROTOR = 0.3
"""Largest logarithm of an identified rotor inertia relative to the robot file's, which is three deviations of the
prior: rotors that fit a log with wrong signs or units are further off."""
FLOOR = 0.0025
"""Standard deviation of a stiffness, however small the noise, because the linear model simplifies springs and friction:
chosen with fifteen simulated logs with bristles and tested with others, see `benchmarks/stiffness.py`."""
GAIN_OFF, LINKS_OFF = 0.05, 0.06
"""Standard deviations of torque constants, and of mass and inertia of each link, for absolute intervals."""
_PRIOR = {"stiffness": 1.0, "damping": 20.0, "viscous": 1e3, "rotor": 0.1, "delay": 3.0}
"""Prior standard deviations: of log stiffness and log rotor inertia, multiples of damping and viscous friction, and
ms."""
_FRICTION = 10.0
"""Prior standard deviation of a friction term's size, relative to f_s."""
_STARTS = (0.0, -0.35, 0.3)
"""Log ratios of stiffness to the file's at which fits start: factors of 0.7 to 1.35."""
_TRIAL, _LONGEST, _TRIES = 12, 40, 6
"""Number of steps from each start, most steps from the best, and most reductions of a step."""
_DONE = 1e-4
_NEAR = 0.25
"""Half-width, in log frequency, of the mean over neighbouring lines: a quarter of an octave."""
_BLOCKS = 24
"""Number of bands of lines whose residuals are treated as independent in the deviations."""


@dataclass(frozen=True, eq=False)
class StiffnessLevel:
    """Results for n joints from the periods of one level of torque."""

    f: Floats
    """Lines (f,) [Hz]."""
    swing: Floats
    """RMS of the motor torques, motor-side, (n,) [N.m]."""
    spring: Floats
    """RMS of the spring torques at which the stiffness is valid, (n,) [N.m or N]."""
    drives: Drives
    deviation: Floats
    absolute: Floats
    """Relative standard deviations of the stiffness, (n,): with the robot file's links and torque constants, and with
    these uncertain too."""
    uncertainty: Floats
    """Covariance of log stiffness, absolute, (n, n)."""
    share: Floats
    """Share of the links' squared torques that the model explains, (n,)."""
    rotor: Floats
    """Rotor inertias relative to the robot file's, (n,)."""
    antiresonance: Floats
    """See :meth:`MotorSide.antiresonances`, (n,) [Hz]."""
    delay: float
    delay_deviation: float
    """Delay of positions relative to torques [s]."""
    measured: Complex
    fitted: Complex
    """Response of each rotor to its own torque, other rotors held, (f, n) [rad/(N.m) or m/N]."""

    @property
    def stiffness(self) -> Floats:
        """Stiffness, link-side, (n,) [N.m/rad or N/m]."""
        return self.drives.stiffness

    @property
    def explained(self) -> npt.NDArray[np.bool_]:
        """Joints whose torques the model explains with a rotor near the robot file's, (n,)."""
        return (self.share > SHARE) & (np.abs(np.log(self.rotor)) < ROTOR)

    @property
    def identifiable(self) -> npt.NDArray[np.bool_]:
        """Joints whose stiffness the log determines, (n,)."""
        return self.explained & (self.deviation < SURE) & (self.antiresonance <= self.f[-1])


class Stiffness(NamedTuple):
    """Result of :func:`identify_stiffness`."""

    side: MotorSide
    levels: list[StiffnessLevel]
    """Results from small to large torques."""

    @property
    def identifiable(self) -> npt.NDArray[np.bool_]:
        """Joints whose stiffness the log determines at any level, (n,)."""
        return np.any([level.identifiable for level in self.levels], axis=0)

    def best(self, i: int) -> int:
        """Return the index of the highest level at which joint `i` is identifiable, else of the highest."""
        return max((k for k, level in enumerate(self.levels) if level.identifiable[i]), default=len(self.levels) - 1)


def identify_stiffness(log: Log, robot: Robot, plan: PeriodicTorques) -> Stiffness:
    """Identify the springs of an arm from a log of periodic torques.

    `plan` are the torques that were added to the motors'. UsageError if the log does not contain them.
    """
    begin = aligned(log, plan)
    pose = log.kappa[begin:].mean(axis=0)
    side = MotorSide(robot, pose)
    levels = [_Fit(each, side).level() for each in periods_of(log, plan, robot, begin)]
    return Stiffness(side, levels)


class _Trial(NamedTuple):
    """The fit at parameters (p,): residuals (r, f, n), their derivatives (r, f, n, p) and variances (f, n)."""

    x: Floats
    answer: MotorResponse
    errors: Complex
    slopes: Complex
    variance: Floats
    cost: float


class _Fit:
    """The fit of one level."""

    def __init__(self, data: Periods, side: MotorSide) -> None:
        self.data, self.side = data, side
        self.n = n = side.robot.n
        self.w = 2.0 * np.pi * data.f
        self.start = side.start()
        self.viscous = np.maximum(self.start.viscous, self.start.damping)
        shapes = data.friction.shape[-1]
        self.size = 4 * n + 2 + n * shapes
        payload = max(self.start.payload, float(side.robot.mass[-1]))
        widths = [np.full(n, _PRIOR[name]) for name in ("stiffness", "damping", "viscous", "rotor")]
        friction = np.tile(_FRICTION * np.maximum(side.robot.f_s, 1e-9), shapes)
        self.prior = np.concatenate([*widths, [payload, _PRIOR["delay"]], friction])
        self.middle = np.concatenate([np.zeros(n), np.ones(n), np.ones(n), np.zeros(n + 2 + n * shapes)])
        self.middle[4 * n] = self.start.payload
        f = np.log(data.f)
        near = (np.abs(f[:, None] - f) < _NEAR).astype(float)
        self.near = near / near.sum(axis=1, keepdims=True)
        self.noise = self.near @ data.torque_noise, self.near @ data.kappa_noise

    def drives(self, x: Floats) -> Drives:
        """Return the drives of parameters (p,)."""
        K, d, F, J = np.split(x[: 4 * self.n], 4)
        start = self.start
        return Drives(
            start.stiffness * np.exp(K),
            start.damping * d,
            self.viscous * F,
            start.rotor * np.exp(J),
            float(x[4 * self.n]),
        )

    def late(self, x: Floats) -> Complex:
        """Return the phase factor (f, 1) by which torques lead positions."""
        return np.exp(1e-3j * self.w * x[4 * self.n + 1])[:, None]

    def dry(self, x: Floats) -> Complex:
        """Return torques (r, f, n) of dry friction."""
        return (self.data.friction * x[4 * self.n + 2 :].reshape(-1, self.n).T).sum(axis=-1)

    def errors(self, x: Floats) -> tuple[MotorResponse, Complex]:
        """Return the response of the model, and the torque residuals."""
        answer = self.side.answer(self.w, self.drives(x), self.data.kappa)
        return answer, self.data.torque - self.late(x) * (answer.torque + self.dry(x))

    def state(self, x: Floats) -> _Trial:
        """Return residuals, derivatives and variances."""
        answer, errors = self.errors(x)
        n, w, side, drives = self.n, self.w, self.side, self.drives(x)
        each, kappa = np.arange(n), self.data.kappa
        turning, square = 1j * w[:, None], (w**2)[:, None]
        slopes = np.zeros((*errors.shape, self.size), complex)
        spring = (np.eye(n) - answer.reaction)[None] * answer.bent[:, :, None, :]
        slopes[..., :n] = spring * drives.stiffness
        slopes[..., n : 2 * n] = spring * (turning * self.start.damping)[None, :, None, :]
        slopes[:, :, each, 2 * n + each] = turning * self.viscous * kappa
        carried = side.carried / side.robot.ell[:, None]
        whole = kappa + times(carried[None], answer.q)
        moved = (np.eye(n) + answer.reaction @ carried.T)[None] * whole[:, :, None, :]
        slopes[..., 3 * n : 4 * n] = -square[:, :, None] * drives.rotor * moved
        slopes[..., 4 * n] = self.by_link(answer, *side.payload)
        slopes[..., 4 * n + 1] = 1e-3 * turning * (answer.torque + self.dry(x))
        for k in range(self.data.friction.shape[-1]):
            slopes[:, :, each, 4 * n + 2 + k * n + each] = self.data.friction[..., k]
        variance = self.variance(drives, errors)
        return _Trial(x, answer, errors, -self.late(x)[..., None] * slopes, variance, self.cost(x, errors, variance))

    def by_link(self, answer: MotorResponse, M: Floats, G: Floats) -> Complex:
        """Return the change (r, f, n) of the torques by a change of the links' matrices."""
        return times(answer.reaction, times(-((self.w**2)[:, None, None]) * M + G, answer.q))

    def variance(self, drives: Drives, errors: Complex) -> Floats:
        """Return variances (f, n) of the residuals: those of the noise, or larger if nearby residuals are larger."""
        torque, kappa = self.noise
        noise = torque + (np.abs(self.side.impedance(self.w, drives)) ** 2 @ kappa[..., None])[..., 0]
        more = self.near @ ((np.abs(errors) ** 2).mean(axis=0) / noise)
        return noise * np.maximum(more, 1.0)

    def cost(self, x: Floats, errors: Complex, variance: Floats) -> float:
        """Return the negative log posterior, except for a constant, with fixed variances."""
        return float((np.abs(errors) ** 2 / variance).sum() + (((x - self.middle) / self.prior) ** 2).sum() / 2.0)

    def search(self, x: Floats, most: int) -> _Trial:
        """Return the best state by steps of Levenberg and Marquardt; variances follow the residuals."""
        damped, calm, state = 1e-3, 0, self.state(x)
        for _ in range(most):
            slopes, errors = _weighted(state)
            H = slopes.T @ slopes
            g = -slopes.T @ errors - (state.x - self.middle) / self.prior**2
            here = self.cost(state.x, state.errors, state.variance)
            for _ in range(_TRIES):
                step = np.linalg.solve(H + np.diag(1.0 / self.prior**2 + damped * np.diag(H)), g)
                step[: self.n] = np.clip(step[: self.n], -0.2, 0.2)
                step[3 * self.n : 4 * self.n] = np.clip(step[3 * self.n : 4 * self.n], -0.1, 0.1)
                if self.cost(state.x + step, self.errors(state.x + step)[1], state.variance) < here:
                    damped = max(damped / 5.0, 1e-9)
                    break
                damped *= 8.0
            else:
                break
            state = self.state(state.x + step)
            calm = calm + 1 if np.abs(step[: self.n]).max() < _DONE else 0
            if calm > 1:
                break
        return state

    def level(self) -> StiffnessLevel:
        """Return the result, from the best of several starts."""
        n, realisations = self.n, len(self.data.torque)
        shift = np.zeros(self.size)
        trials: list[tuple[float, Floats]] = []
        for each in _STARTS:
            shift[:n] = each
            state = self.search(self.middle + shift, _TRIAL)
            trials.append((float(np.log(state.variance).sum() * realisations + state.cost), state.x))
        state = self.search(min(trials, key=lambda each: each[0])[1], _LONGEST)
        drives, answer = self.drives(state.x), state.answer
        covariance, scales = self._deviations(state)
        deviation = np.sqrt(np.diag(covariance))
        stiff = deviation[:n]
        uncertainty = covariance[:n, :n] + FLOOR**2 * np.eye(n) + scales
        spring = (drives.stiffness + 1j * self.w[:, None] * drives.damping) * answer.bent
        diagonal = self.side.impedance(self.w, drives)[:, np.arange(n), np.arange(n)]
        motion = self.data.kappa
        coupled = answer.torque - diagonal * motion
        clean = self.data.torque / self.late(state.x) - self.dry(state.x) - coupled
        with np.errstate(invalid="ignore"):  # NaN, and so not drawn, for a motor at rest
            measured = (np.abs(motion) ** 2).sum(axis=0) / (clean * motion.conj()).sum(axis=0)
        left = (np.abs(state.errors) ** 2).sum(axis=(0, 1)) / (np.abs(answer.link) ** 2).sum(axis=(0, 1))
        return StiffnessLevel(
            self.data.f, self.data.swing, np.sqrt(2.0 * (np.abs(spring) ** 2).sum(axis=1).mean(axis=0)), drives,
            np.hypot(stiff, FLOOR), np.sqrt(np.diag(uncertainty)), uncertainty,
            1.0 - left, drives.rotor / self.start.rotor, self.side.antiresonances(drives),
            1e-3 * float(state.x[4 * n + 1]), 1e-3 * float(deviation[4 * n + 1]),
            measured, 1.0 / diagonal,
        )  # fmt: skip

    def _deviations(self, state: _Trial) -> tuple[Floats, Floats]:
        """Return the covariance (p, p), and the part of stiffness (n, n) due to torque constants and links.

        The covariance is the larger of the inverse curvature and White's (1982) sandwich estimate, in which the
        residuals of a realisation in a band of lines are one sample, because neighbouring lines are alike.
        """
        n, (r, f, _) = self.n, state.errors.shape
        slopes, errors = _weighted(state)
        precision = np.diag(1.0 / self.prior**2)
        C: Any = np.linalg.inv(slopes.T @ slopes + precision)
        scores = (slopes * errors[:, None]).reshape(2, r, f, n, -1).sum(axis=(0, 3))
        blocks = [scores[:, block].sum(axis=1) for block in np.array_split(np.arange(f), _BLOCKS)]
        summed = np.concatenate(blocks)
        inflation = len(summed) / max(len(summed) - self.size, r)
        sandwich = C @ (summed.T @ summed * inflation + precision) @ C
        widen = np.sqrt(np.maximum(1.0, np.diag(sandwich) / np.diag(C)))
        late, answer = self.late(state.x), state.answer
        whole = -late * (answer.torque + self.dry(state.x))
        scales = [-late * self.by_link(answer, *self.side.scaled_link(i)) * LINKS_OFF for i in range(n)]
        scales += [whole * np.eye(n)[i] * GAIN_OFF for i in range(n)]
        ways = np.stack(scales, axis=-1) * np.sqrt(2.0 / state.variance)[..., None]
        gain = C[:n] @ slopes.T @ _real(ways)
        return C * np.outer(widen, widen), gain @ gain.T


def _real(values: Complex) -> Any:
    """Return real and imaginary parts of (r, f, n, p) as rows (2 r f n, p)."""
    return np.concatenate([values.real.reshape(-1, values.shape[-1]), values.imag.reshape(-1, values.shape[-1])])


def _weighted(state: _Trial) -> tuple[Floats, Floats]:
    """Return derivatives (2 r f n, p) and residuals (2 r f n,), divided by their standard deviations."""
    weight = np.sqrt(2.0 / state.variance)
    return _real(state.slopes * weight[..., None]), _real((state.errors * weight)[..., None])[:, 0]
