"""Excitation torques that identify an arm's springs from the motor side within its limits, and demands on the log."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from vdfmu.arm.drive.limits import motor_torque
from vdfmu.arm.robot import Robot
from vdfmu.base.arrays import Floats
from vdfmu.base.errors import UsageError
from vdfmu.extras.identify.motor_side import MotorSide
from vdfmu.extras.identify.periodic import LEVELS, NYQUIST, PERIOD, PeriodicTorques, excitation

STEP = 1e-3
"""Time from row to row of a log [s]."""
BEYOND = 1.5
"""Highest line relative to the highest antiresonance."""
LEAST = 2.0
"""Smallest RMS of a torque relative to the breakaway friction."""
_BENT = 0.3
"""Bend of each joint from the middle [rad], because straight arms hide joints whose axes intersect."""
_OFF = 0.3
"""Largest share of half a joint's range that this bend uses."""
_CREST = 4.0
"""Crest factor of a multisine with random phases: its peak divided by its RMS."""
_MARGIN = 0.9
"""Fraction of the limits of speed and torque that is used."""
_FINEST = 2.5e-4
"""Step over which the torques are held [s]; they lose 2 % at 400 Hz."""


@dataclass(frozen=True, eq=False)
class StiffnessExperiment:
    """Excitation torques at a pose, and the amplitudes that they cause, (n,) each."""

    excitation: PeriodicTorques
    pose: Floats
    antiresonance: Floats
    """Antiresonances with the robot file's springs [Hz]."""
    breakaway: Floats
    """Friction f_s, motor-side [N.m]."""
    torque: Floats
    speed: Floats
    travel: Floats
    """Predicted RMS torque [N.m], and peaks of speed and of the deviation from the pose [rad or m, per s], without
    friction, at the higher level."""
    rate: Floats
    """Smallest rate of the log [Hz]."""

    @property
    def lacks(self) -> list[str]:
        """For each joint, as text, what is missing for its identification; empty if nothing."""
        return missing(self.antiresonance, self.excitation.lines[-1], self.torque, self.breakaway)


def missing(antiresonance: Floats, highest: float, torque: Floats | None, breakaway: Floats) -> list[str]:
    """Return for each joint the missing frequency and torque of an excitation; empty if nothing is missing.

    `highest` is the highest line [Hz], `torque` the RMS (n,), None without excitation, and `breakaway` the friction
    (n,), motor-side [N.m].
    """
    texts: list[str] = []
    for i, (f, friction) in enumerate(zip(antiresonance, breakaway, strict=True)):
        lacks: list[str] = []
        if f > highest:
            rate = BEYOND * f / NYQUIST
            lacks.append(f"frequencies up to {BEYOND * f:.3g} Hz, logged at {rate:.4g} Hz or faster")
        least = LEAST * friction
        size = 0.0 if torque is None else torque[i]
        if size < least:
            instead = "" if torque is None else f", not {size:.2g} N.m"
            lacks.append(f"a torque of {least:.3g} N.m RMS{instead}")
        texts.append(" and ".join(lacks))
    return texts


def stiffness_experiment(
    robot: Robot, *, pose: npt.ArrayLike | None = None, step: float = STEP, seed: int = 0
) -> StiffnessExperiment:
    """Choose the torques for a robot at a pose (n,), by default near the middle of its joints' ranges.

    Lines go up to 1.5 times the highest antiresonance, or as far as a log with rows every `step` [s] shows them. The
    lower level is 2.5 times the breakaway friction and the higher twice that, or as much as the motors can.
    """
    q = _bent_pose(robot) if pose is None else np.array(pose, float)
    if q.shape != (robot.n,) or not np.isfinite(q).all():
        raise UsageError(f"pose: expected {robot.n} finite positions, got {pose!r}.")
    if not 0.0 < step < 0.1 or abs(PERIOD / step - round(PERIOD / step)) > 1e-6:
        raise UsageError(f"step: must divide the period of {PERIOD:g} s and be less than 0.1 s, got {step:g} s.")
    side = MotorSide(robot, q)
    drives = side.start()
    antiresonance = side.antiresonances(drives)
    highest = min(BEYOND * float(antiresonance.max()), NYQUIST / step)
    breakaway = np.array(robot.f_s) / robot.ell
    rms = np.outer(LEVELS, breakaway)
    rows = round(PERIOD / _FINEST) * max(1, round(2.0 * highest * _FINEST / NYQUIST))
    plan = excitation(np.ones((1, robot.n)), highest, PERIOD / rows, seed)
    wave = plan.torque[:rows]
    places = np.rint(plan.lines * PERIOD).astype(int)
    w = 2.0 * np.pi * plan.lines
    size = 2.0 / rows * np.fft.rfft(wave, axis=0)[places] * robot.ell
    unit = np.linalg.inv(side.impedance(w, drives))

    def peaks(level: Floats) -> tuple[Floats, Floats]:
        motion = np.abs(unit @ (level * size)[..., None])[..., 0]
        return tuple(_CREST * np.sqrt((each**2).sum(axis=0) / 2.0) for each in (w[:, None] * motion, motion))

    if robot.limits:
        held = side.weight / robot.ell
        largest = np.abs(motor_torque(robot, np.full(robot.n, 1e9), np.zeros(robot.n)))
        rms = np.minimum(rms, np.maximum(_MARGIN * largest - np.abs(held), 0.0) / _CREST)
        room = np.minimum(q - robot.q_min, robot.q_max - q)
        if (room <= 0.0).any():
            raise UsageError(f"pose: expected one between the end stops of {robot.name}, got {q.tolist()}.")
        for whole in (False, True):  # first the joints beyond their limits, then all, because they move each other
            speed, travel = peaks(rms[-1])
            share = np.minimum(_MARGIN * robot.kappa_dot_max / speed, _MARGIN * room / travel)
            rms = np.minimum(rms, rms[-1] * np.minimum(share.min() if whole else share, 1.0))
    plan = excitation(rms, highest, PERIOD / rows, seed)
    speed, travel = peaks(rms[-1])
    rate = BEYOND * antiresonance / NYQUIST
    return StiffnessExperiment(plan, q, antiresonance, breakaway, rms[-1], speed, travel, rate)


def _bent_pose(robot: Robot) -> Floats:
    """Return a pose near the middle of the ranges, with all joints bent."""
    if not robot.limits:
        return np.full(robot.n, _BENT)
    middle, half = (robot.q_min + robot.q_max) / 2.0, (robot.q_max - robot.q_min) / 2.0
    return middle + np.minimum(_BENT, _OFF * half)
