"""The few numbers by which a run is known, and when they occur: entry ``key_figures`` of a summary."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

import numpy as np

from vdfmu.arm.dynamics import forward_kinematics
from vdfmu.arm.equations.kinematics import frames
from vdfmu.arm.robot import Robot
from vdfmu.base.arrays import Floats
from vdfmu.base.errors import VdfmuError
from vdfmu.compiler.unit.variable import NO_LIMIT
from vdfmu.engine.results.results import Results
from vdfmu.study.analysis.modes import natural_modes
from vdfmu.study.report.joints import UNITS
from vdfmu.study.run.at_limits import ArmLimits
from vdfmu.study.run.summary import has_signals
from vdfmu.system.reference.reference import BLOCK

_POSES = 5
"""Poses along a run at which its lowest mode is looked for."""


def key_figures(results: Results, robot: Robot, limits: Iterable[ArmLimits], plant: Robot) -> dict[str, Any]:
    """Return the largest errors and torque of a run of an arm, and the lowest mode of its links.

    Parameters
    ----------
    limits
        Of the arms; the torque is then the joint's with the largest share of its limit.
    plant
        The robot that the plant is: the modes are its, and there is a tool error if its geometry is the one known.

    Returns
    -------
    dict
        ``tool_error`` [m], ``joint_error`` [deg, mm], ``torque`` link-side [N.m, N], each with ``at_s``; ``mode`` [Hz],
        with the motors held. Without numbers that the signals of the run do not give.
    """
    found: dict[str, Any] = {}
    if has_signals(results, "trajectory.q_d", "plant.q"):
        units = [UNITS[kind] for kind in robot.joint_types]
        scale = np.array([unit.factor for unit in units])
        peaks = _Peaks(robot.n + 1)
        for part in results.blocks(BLOCK):
            error = np.abs(scale * (part["trajectory.q_d"] - part["plant.q"]))
            peaks.add(part.time, np.column_stack([error, tool_errors(robot, part)]))
        found["joint_error"] = peaks.worst([unit.position for unit in units])
        if same_frames(robot, plant):
            found["tool_error"] = {"value": float(peaks.most[-1]), "at_s": float(peaks.at[-1])}
    if has_signals(results, "controller.tau"):
        arm = next((one for one in limits if one.plant == "plant"), None)
        found["torque"] = _torque(results, robot, arm)
    modes = list(_modes(results, plant)) if has_signals(results, "plant.q") else []
    if modes:
        found["mode"] = dict(zip(("value", "at_s"), min(modes), strict=True))
    return found


def tool_errors(robot: Robot, results: Results) -> Floats:
    """Return the distance of the tool from where it should be, (m,) [m]."""
    ends = [forward_kinematics(robot, results[name])[0] for name in ("trajectory.q_d", "plant.q")]
    return np.linalg.norm(ends[0] - ends[1], axis=1)


def same_frames(robot: Robot, plant: Robot) -> bool:
    """Whether the plant has the geometry of the robot, by which a tool error is known."""
    return all(np.array_equal(each, frames(plant)[name]) for name, each in frames(robot).items())


class _Peaks:
    """Largest values of columns, and their times."""

    def __init__(self, n: int) -> None:
        self.most, self.at = np.full(n, -1.0), np.zeros(n)

    def add(self, time: Floats, values: Floats) -> None:
        rows = values.argmax(axis=0)
        largest = values[rows, range(len(rows))]
        higher = largest > self.most
        self.most, self.at = np.where(higher, largest, self.most), np.where(higher, time[rows], self.at)

    def worst(self, units: list[str], limit: Floats | None = None) -> dict[str, Any]:
        """Return the joint with the largest share of its limit, or the largest value of the first joint's unit."""
        comparable = [unit == units[0] for unit in units]
        share = self.most[: len(units)] * comparable if limit is None else self.most[: len(units)] / limit
        i = int(share.argmax())
        more = {} if limit is None else {"limit": float(limit[i])}
        return {"value": float(self.most[i]), "unit": units[i], "joint": i + 1, "at_s": float(self.at[i])} | more


def _torque(results: Results, robot: Robot, arm: ArmLimits | None) -> dict[str, Any]:
    """Return the largest torque that a motor gave, link-side."""
    limit = None
    if arm is not None:
        least = np.minimum(arm.tau_max, arm.given(np.full(robot.n, NO_LIMIT), np.zeros(robot.n)))
        limit = robot.ell * np.where(least < NO_LIMIT, least, np.inf)
        limit = limit if np.isfinite(limit).any() else None
    peaks = _Peaks(robot.n)
    for part in results.blocks(BLOCK):
        tau = part["controller.tau"]
        if arm is not None and "plant.kappa_dot[1]" in results:
            tau = arm.given(np.clip(tau, -arm.tau_max, arm.tau_max), part["plant.kappa_dot"])
        peaks.add(part.time, np.abs(robot.ell * tau))
    return peaks.worst([UNITS[kind].torque for kind in robot.joint_types], limit)


def _modes(results: Results, robot: Robot) -> Iterable[tuple[float, float]]:
    """Yield the lowest frequency [Hz] at rest, with its time [s], at poses along a run that have one."""
    for row in np.linspace(0, len(results) - 1, _POSES).astype(int):
        try:
            q = [results[f"plant.q[{i + 1}]"][row] for i in range(robot.n)]
            frequencies = natural_modes(robot, q, motors="held").frequency
        except VdfmuError:  # beyond an end stop, or too heavy for its motors to hold: no rest there
            continue
        if len(frequencies):
            yield float(frequencies[0]), float(results.time[row])
