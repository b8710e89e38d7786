"""Hysteresis of a drive: Dahl's element in parallel with the spring. Not in the paper; off by default."""

from __future__ import annotations

from dataclasses import dataclass

from vdfmu.arm.drive.dahl import dahl_energy, dahl_loss, dahl_rate
from vdfmu.arm.drive.option import Array, DriveOption, OptionState, Parallel, row
from vdfmu.base.measure import POSITIVE


@dataclass(frozen=True, eq=False, kw_only=True)
class HysteresisRows:
    """Parameters of the hysteresis."""

    hysteresis: bool = False
    # fmt: off
    K_h: Array = row(
        "hysteresis", "stiffness", "stiffness of the hysteresis element, link-side", "", 1e12, POSITIVE,
        hint="For none give a small value such as 1e-6.")
    f_h: Array = row(
        "hysteresis", "torque", "torque at which the hysteresis element slips, link-side", "", 1e9, POSITIVE)


HYSTERESIS = DriveOption(
    state=OptionState(
        "tau_h", "torque", "torque of the hysteresis, link-side", "start of the hysteresis, without equilibrium"
    ),
    parallel=lambda robot, stretch, tau_h: Parallel(
        tau_h, dahl_loss(stretch, tau_h, robot.f_h), dahl_energy(robot.K_h, tau_h)
    ),
    rate=lambda robot, motion, tau_h: dahl_rate(robot.K_h, motion.stretch, tau_h, robot.f_h),
)
