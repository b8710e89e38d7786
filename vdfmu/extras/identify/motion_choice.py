"""Chooses the motion that determines an arm's parameters best, and predicts the intervals before the experiment.

Candidates are multisines with several highest frequencies, periods, poses and random phases, each as large as the
limits allow. Their logs follow from the equations of :mod:`~vdfmu.extras.identify.fit` without a simulation, because
links are assumed to follow the motion exactly. Candidates are ranked by the mean logarithm of standard deviations for
white noise. The best one is identified with noise on its log, like a measured log.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from itertools import product
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt

from vdfmu.arm.drive.limits import motor_rectangle, motor_torque
from vdfmu.arm.equations.flexible_joint import rotor_position
from vdfmu.arm.equations.friction import joint_friction
from vdfmu.arm.motion import Motion, check_motion
from vdfmu.arm.robot import Robot
from vdfmu.base.arrays import Floats
from vdfmu.base.errors import UsageError
from vdfmu.base.progress import counted
from vdfmu.base.toml_file import toml_text
from vdfmu.extras.identify.excitation import multisine
from vdfmu.extras.identify.fit import PRIOR, Identified, check_settings, identify
from vdfmu.extras.identify.log import Log
from vdfmu.extras.identify.problem import link_covariance, regressor
from vdfmu.extras.identify.rows import file_torques, rows_of, slope
from vdfmu.extras.identify.search import expected_deviations

_HIGHEST, _PERIODS, _SEEDS = (0.25, 0.5, 1.0, 2.0), (1, 3), 4
"""Highest frequencies [Hz], whole periods and seeds of the candidates."""
_LINES = 5
"""Number of frequencies of each candidate, at equal ratios from one in a period to the highest."""
_MARGIN = 0.9
"""Fraction of the robot's limits of range, speed and torque that is used."""
_FAR = np.pi
"""Largest amplitude of a revolute joint [rad]."""
_DEFAULTS = {"revolute": (1.0, 1.5, 5.0), "prismatic": (0.2, 0.5, 2.0)}
"""Amplitude [rad or m], speed and acceleration [per s, s2] of joints without limits."""
_OFF = 0.4
"""Largest offset of the candidates' poses from the middle, as a fraction of the range."""
_SHRINK = 8
"""Largest number of times that a motion is reduced until the motors can supply its torques."""
_SHORTEST = 5.0
"""Shortest useful duration of an experiment [s]."""
_COARSE, _ROWS = 40.0, 1000.0
"""Fewest samples of a candidate, in a period of the highest frequency and in total."""


@dataclass(frozen=True)
class SensorNoise:
    """Sensors of an experiment."""

    step: float = 0.002
    """Time between the rows of the log [s]."""
    bits: int = 17
    """Bits per turn of the encoders before and behind the gears, or per metre of a prismatic joint."""
    noise: float = 0.005
    """Standard deviation of white torque noise, relative to the largest torque of each joint."""
    links: bool = True
    """Whether there are encoders behind the gears."""

    def __post_init__(self) -> None:
        """Raise UsageError for impossible numbers of sensors."""
        problems = [
            f"{name}: expected {expected}, got {value:g}."
            for name, value, expected, fits in (
                ("step", self.step, "more than 0 and at most 0.1 s", 0.0 < self.step <= 0.1),
                ("bits", self.bits, "a whole number from 8 to 40", self.bits in range(8, 41)),
                ("noise", self.noise, "a share above 0 and below 1", 0.0 < self.noise < 1.0),
            )
            if not fits
        ]
        if problems:
            raise UsageError("\n".join(problems))

    def measured(self, log: Log, robot: Robot) -> Log:
        """Return an exact log with this noise added, always the same."""
        bit = _turns(robot) * 2.0**-self.bits
        noise = np.random.default_rng(0).normal(size=log.tau.shape) * self.noise * np.abs(log.tau).max(axis=0)
        kappa = np.round(log.kappa * robot.ell / bit) * bit / robot.ell
        q = None if log.q is None or not self.links else np.round(log.q / bit) * bit
        return log._replace(kappa=kappa, tau=log.tau + noise, q=q)

    def __str__(self) -> str:
        sides = "both sides of the gears" if self.links else "the motors"
        return (
            f"a row every {1e3 * self.step:g} ms, encoders of {self.bits} bits on {sides}, white noise of "
            f"{100 * self.noise:g} % of the largest torque"
        )


@dataclass(frozen=True, eq=False)
class Design:
    """An experiment."""

    motion: Motion
    table: dict[str, Any]
    """The motion's table ``[motion]``, see :func:`~vdfmu.extras.identify.excitation.multisine`."""
    expected: Identified
    """Predicted result of an identification."""
    notes: tuple[str, ...]

    def text(self, head: str) -> str:
        """Return the content of a motion file, under a comment."""
        return f"# {head}\n\n{toml_text({'motion': self.table})}"


class _Excitation(NamedTuple):
    """A kind of motion to try: table ``[motion]`` without amplitudes, and the motion with amplitude 1 about 0.

    `span` are the largest amplitudes (n,) about its pose [rad or m], `highest` the highest frequency [Hz].
    """

    table: dict[str, Any]
    unit: Motion
    span: Floats
    highest: float


class _Candidate(NamedTuple):
    table: dict[str, Any]
    motion: Motion
    log: Log
    """Exact log with fewer rows."""


def design(
    robot: Robot,
    *,
    duration: float = 60.0,
    start: npt.ArrayLike | None = None,
    sensors: SensorNoise | None = None,
    band: float | None = None,
    prior: float = PRIOR,
) -> Design:
    """Choose the motion that determines the parameters of an arm best, and predict the intervals.

    Parameters
    ----------
    robot : Robot
        The values known beforehand. The motion stays within 90 % of its end stops, speeds and torques; without limits,
        with a note, at most 1 rad or 0.2 m off the pose, 1.5 rad/s or 0.5 m/s, 5 rad/s2 or 2 m/s2. Collisions are not
        checked.
    duration : float [s]
        Duration of the motion, including its growth and fading.
    start : (n,) [rad or m], optional
        Pose about which the joints move; default several about the middle of the end stops, or about 0.
    sensors : SensorNoise, optional
        Default a row every 2 ms, 17 bits on both sides of the gears, and 0.5 % of the largest torque.
    band, prior
        See :func:`~vdfmu.extras.identify.fit.identify`.

    Raises
    ------
    UsageError
        For invalid arguments, and for a robot whose motors cannot hold it at any of the poses.
    """
    sensors = sensors or SensorNoise()
    check_settings(robot, band, prior)
    if not _SHORTEST <= duration < np.inf:
        raise UsageError(f"duration: expected at least {_SHORTEST:g} s, got {duration:g} s.")
    middle, reach, speed, acceleration = _limits(robot, start)
    candidates: list[_Candidate] = []
    tried = list(_multisines(robot, duration, middle, reach, start is None))
    for each in counted("motions", tried, len(tried)):
        amplitude = np.min([each.span, speed / each.unit.peaks[0], acceleration / each.unit.peaks[1]], axis=0)
        step = max(sensors.step, min(1.0 / (_COARSE * each.highest), duration / _ROWS))
        candidates += _fitted(robot, each, amplitude, step)
    if not candidates:
        raise UsageError(
            f"{robot.name}: the motors are too weak for any motion about this pose. Choose another pose, or check "
            "[joints.limits] of the robot file."
        )
    level = sensors.noise * np.max([np.abs(each.log.tau).max(axis=0) for each in candidates], axis=0)
    deviations = [
        _mean_deviation(robot, each.log, level, sensors, band, prior)
        for each in counted("intervals", candidates, len(candidates))
    ]
    best = candidates[int(np.argmin(deviations))]
    expected = predict(robot, best.motion, sensors=sensors, band=band, prior=prior)
    notes = [f"a prediction, for {sensors}: errors of the model make the intervals wider"]
    if not robot.limits:
        notes.append(
            "the robot file has no limits, so joints move at most 1 rad or 0.2 m off the pose, at 1.5 rad/s or 0.5 m/s "
            "and 5 rad/s2 or 2 m/s2: add [joints.limits]"
        )
    if left := len(tried) - len(candidates):
        notes.append(f"{left} of {len(tried)} motions are excluded because they need more torque than the motors have")
    notes.append("collisions are not checked: look at the motion before you run it")
    return Design(best.motion, best.table, expected, tuple(notes))


def predict(
    robot: Robot, motion: Motion, *, sensors: SensorNoise | None = None, band: float | None = None, prior: float = PRIOR
) -> Identified:
    """Return the predicted result of an identification by a motion; see :func:`design`."""
    sensors = sensors or SensorNoise()
    log = sensors.measured(exact_log(robot, motion, sensors.step), robot)
    return identify(log, robot, band=band, prior=prior)


def exact_log(robot: Robot, motion: Motion, step: float) -> Log:
    """Return the log, every `step` [s] and without noise, of a motion that the links follow exactly.

    In the rotors' reaction on the links each rotor turns like its link, see
    :func:`~vdfmu.arm.equations.feedforward.desired_drive_motion`.
    """
    t: Floats = step * np.arange(int(motion.duration / step * (1.0 + 1e-12)) + 1.0)
    q, q_dot, q_ddot, *_ = motion.at(t)
    parts = regressor(robot, q, q_dot, q_ddot, q_dot, q_ddot)
    tau_s = file_torques(robot, q, parts)
    kappa = rotor_position(robot, q, tau_s)
    kappa_dot = slope(kappa, step)
    _, xi_m = joint_friction(robot, q_dot, kappa_dot, tau_s)
    tau = robot.I_m * (slope(kappa_dot, step) + parts.carried) + tau_s / robot.ell + xi_m
    return Log(robot.name, t, kappa, tau, q)


def _turns(robot: Robot) -> Floats:
    """Return the range divided by an encoder's steps, (n,): a turn [rad], or a metre."""
    return np.where([kind == "prismatic" for kind in robot.joint_types], 1.0, 2.0 * np.pi)


def _limits(robot: Robot, start: npt.ArrayLike | None) -> tuple[Floats, Floats, Floats, Floats]:
    """Return a pose, and amplitudes about it, speeds and accelerations of each joint, (n,) each."""
    low, high = (robot.q_min, robot.q_max) if robot.limits else (np.zeros(robot.n),) * 2
    pose = np.asarray(0.5 * (low + high) if start is None else start, dtype=float)
    if pose.shape != (robot.n,) or not np.isfinite(pose).all():
        raise UsageError(f"start: expected a position for each of the {robot.n} joints of {robot.name}, got {start}.")
    if not robot.limits:
        reach, speed, acceleration = np.array([_DEFAULTS[kind] for kind in robot.joint_types]).T
        return pose, reach, speed, acceleration
    for i in np.flatnonzero((pose <= low) | (pose >= high)):
        raise UsageError(
            f"start: joint {robot.joint_labels[i]}: expected a position between its end stops, {low[i]:g} and "
            f"{high[i]:g}, got {pose[i]:g}."
        )
    reach = np.minimum(_MARGIN * np.minimum(pose - low, high - pose), np.where(_turns(robot) > 1.0, _FAR, np.inf))
    speed, _ = motor_rectangle(robot, robot.kappa_dot_max)
    return pose, reach, _MARGIN * speed, np.full(robot.n, np.inf)


def _multisines(robot: Robot, duration: float, middle: Floats, reach: Floats, moves: bool) -> Iterator[_Excitation]:
    """Yield multisines about `middle` (n,), or about several poses if it `moves`, within `reach` (n,) [rad or m]."""
    for highest, periods, seed in product(_HIGHEST, _PERIODS, range(_SEEDS)):
        pose = middle
        if moves and seed:
            pose = (middle + np.random.default_rng(seed).uniform(-_OFF, _OFF, robot.n) * reach).round(4)
        span = reach - np.abs(pose - middle) if robot.limits else reach
        period = duration / (periods + 2)
        lines = sorted({int(k) for k in np.rint(np.geomspace(1.0, max(1.0, highest * period), _LINES))})
        form: dict[str, Any] = {"lines": lines, "period": period, "periods": periods, "phases": "random", "seed": seed}
        table = {"kind": "multisine", "start": pose.tolist(), "amplitude": [], **form}
        yield _Excitation(table, multisine(0.0 * pose, 1.0, **form), span, highest)


def _fitted(robot: Robot, tried: _Excitation, amplitude: Floats, step: float) -> list[_Candidate]:
    """Return the candidate with amplitudes (n,), reduced until motors can supply its torques; empty if they cannot."""
    for _ in range(_SHRINK):
        amplitude = np.floor(1e4 * amplitude) / 1e4
        coefficients = tried.unit.coefficients * amplitude
        coefficients[:, 0] += tried.table["start"]
        motion = Motion(tried.unit.knots, coefficients)
        log = exact_log(robot, motion, step)
        held = over = 0.0
        if robot.limits:
            most = motor_torque(robot, np.copysign(robot.tau_stall, log.tau), slope(log.kappa, step))
            taken = np.abs(log.tau) / np.maximum(_MARGIN * np.abs(most), 1e-300)
            held, over = taken[0].max(), taken.max()
        if not amplitude.all() or held >= 1.0:
            return []
        if over <= 1.0:
            try:
                check_motion(motion, robot)
            except UsageError:
                return []
            return [_Candidate({**tried.table, "amplitude": amplitude.tolist()}, motion, log)]
        amplitude = amplitude * max(0.5, 0.95 * (1.0 - held) / (over - held))
    return []


def _mean_deviation(
    robot: Robot, log: Log, noise: Floats, sensors: SensorNoise, band: float | None, prior: float
) -> float:
    """Mean log deviation of drives, springs and links at the true values, for torque noise (n,) [N.m]."""
    problem, _, band, _ = rows_of(log if sensors.links else log._replace(q=None), robot, band)
    bent = _turns(robot) * 2.0**-sensors.bits / np.sqrt(12.0) * np.hypot(1.0, 1.0 / robot.ell)
    passed = np.sqrt(2.0 * band * sensors.step)  # for white noise through the filter
    levels = [passed * noise * robot.ell, passed * bent][: 1 + sensors.links]
    deviations = expected_deviations(problem, link_covariance(robot, problem.base, prior), levels)
    deviations = deviations[: problem.places["tau_0"].start]
    return float(np.log(deviations[deviations > 0.0]).mean())
