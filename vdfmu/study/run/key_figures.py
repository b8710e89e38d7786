"""The main numbers of a run and their times: the entry ``key_figures`` of a summary."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from typing import Any

import numpy as np

from vdfmu.arm.dynamics import forward_kinematics
from vdfmu.arm.equations.kinematics import frames
from vdfmu.arm.robot import Robot
from vdfmu.base.arrays import Floats
from vdfmu.base.measure import JOINT_TYPES
from vdfmu.compiler.unit.declaration import NO_LIMIT
from vdfmu.engine.results.results import Results
from vdfmu.study.limits import LIMITS
from vdfmu.study.run.summary import ArmLimits, has_signals
from vdfmu.system.reference.reference import BLOCK

_SMALL = 0.1
"""Size of motion [rad, or as a fraction of the arm's length] with which errors of an arm at rest are compared: its tool
counts as off its path from a tenth of it, 1 % of the arm's length."""


def key_figures(
    results: Results,
    robot: Robot,
    limits: Iterable[ArmLimits],
    plant: Robot,
    touch: str = "",
    objects: Iterable[Mapping[str, Any]] = (),
) -> dict[str, Any]:
    """Return the largest errors and torque of a run of an arm.

    With `limits` of the arms, the torque is that of the joint with the largest share of its limit. `plant` is the robot
    of the plant; a tool error needs the geometry of `robot`. `touch` is the signal of the wrench at the tool, if it is
    the output of another component. `objects` are those of the scene.

    Keys: ``tool_error`` [m], ``joint_error`` [deg, mm], ``torque`` link-side [N.m, N], each with ``at_s``; ``path``,
    the error of tool or joint that is worst for the ``size`` of its motion; ``contact``, the largest force at the tool
    [N], and its start; ``depth``, the largest depth of a contact [m]. Numbers without signals are omitted.
    """
    figures: dict[str, Any] = {}
    if has_signals(results, "trajectory.q_d", "plant.q"):
        units = [JOINT_TYPES[kind].shown for kind in robot.joint_types]
        scale = np.array([unit.factor for unit in units])
        peaks, reached = _Peaks(robot.n + 1), _Peaks(2 * robot.n + 1)
        first = None
        for part in results.blocks(BLOCK):
            q_d, q = part["trajectory.q_d"], part["plant.q"]
            place, actual = (forward_kinematics(robot, each)[0] for each in (q_d, q))
            first = place[0] if first is None else first
            away, error = (np.linalg.norm(place - other, axis=1) for other in (first, actual))
            peaks.add(part.time, np.column_stack([np.abs(scale * (q_d - q)), error]))
            reached.add(part.time, np.column_stack([scale * q_d, -scale * q_d, away]))
        with_tool = comparable(robot, plant)
        figures["joint_error"] = peaks.worst([unit.unit for unit in units])
        if with_tool:
            figures["tool_error"] = {"value": float(peaks.most[-1]), "at_s": float(peaks.at[-1])}
        sizes = reached.most[: robot.n] + reached.most[robot.n : -1]
        figures["path"] = _path(robot, peaks, sizes, float(reached.most[-1]) if with_tool else math.inf)
    if touch and has_signals(results, touch):
        force = np.linalg.norm(results[touch][:, :3], axis=1)
        if force.any():
            begin = float(results.time[np.flatnonzero(force)[0]])
            figures["contact"] = {"value": float(force.max()), "unit": "N", "at_s": begin}
    for name in (name for each in objects for name in each["forces"] if name in results and results.units[name] == "m"):
        row = int(results[name].argmax())
        deepest = {"value": float(results[name][row]), "unit": "m", "place": name, "at_s": float(results.time[row])}
        figures["depth"] = max(deepest, figures.get("depth", deepest), key=lambda each: each["value"])
    if has_signals(results, "controller.tau"):
        arm = next((each for each in limits if each.plant == "plant"), None)
        figures["torque"] = _torque(results, robot, arm)
    return figures


class _Peaks:
    """Largest values of columns, and their times."""

    def __init__(self, n: int) -> None:
        self.most, self.at = np.full(n, -np.inf), np.zeros(n)

    def add(self, time: Floats, values: Floats) -> None:
        rows = values.argmax(axis=0)
        largest = values[rows, range(len(rows))]
        higher = largest > self.most
        self.most, self.at = np.where(higher, largest, self.most), np.where(higher, time[rows], self.at)

    def worst(self, units: list[str], limit: Floats | None = None) -> dict[str, Any]:
        """Return the joint with the largest share of its limit, or the largest value of the first joint's unit.

        A limit of 0, for a motor without torque, has no share.
        """
        most = self.most[: len(units)]
        if limit is None:
            share = most * [unit == units[0] for unit in units]
        else:
            share = np.divide(most, limit, out=np.zeros_like(most), where=limit > 0.0)
        i = int(share.argmax())
        more = {} if limit is None else {"limit": float(limit[i]), "limits": limit.tolist()}
        return {"value": float(self.most[i]), "unit": units[i], "joint": i + 1, "at_s": float(self.at[i])} | more


def comparable(robot: Robot, plant: Robot) -> bool:
    """Return whether the robots of motion and plant have the same geometry, so that a tool error exists."""
    return all(np.array_equal(each, frames(plant)[name]) for name, each in frames(robot).items())


def least_sizes(robot: Robot) -> Floats:
    """Return the sizes with which errors of an arm at rest are compared: for its joints [deg, mm] and its tool [m]."""
    arm = float(np.linalg.norm(robot.offset[1:], axis=1).sum() + np.linalg.norm(robot.tool_offset))
    types = [JOINT_TYPES[kind] for kind in robot.joint_types]
    least = [each.shown.factor * (arm if each.slides else 1.0) for each in types]
    return _SMALL * np.array([*least, arm])


def _path(robot: Robot, peaks: _Peaks, sizes: Floats, tool: float) -> dict[str, Any]:
    """Return the worst error relative to its motion: of the tool [m], or of a joint, relative to the largest motion.

    `peaks` are errors of the joints [deg, mm] and of the tool [m], `sizes` those of the joints' motions, `tool` that of
    the tool's motion, infinite without a tool error.
    """
    kinds = robot.joint_types
    least = least_sizes(robot)
    each = [max(least[i], *(sizes[j] for j in range(robot.n) if kinds[j] == kinds[i])) for i in range(robot.n)]
    size = np.array([*each, max(tool, least[-1])])
    share = peaks.most / size
    off = share / np.array([LIMITS["joint"].value] * robot.n + [LIMITS["tool"].value])
    i = int(np.lexsort([off, share > LIMITS["joint"].value])[-1])
    place, unit = ("tool", "m") if i == robot.n else (f"joint {i + 1}", JOINT_TYPES[kinds[i]].shown.unit)
    resting = not np.append(sizes, tool if math.isfinite(tool) else 0.0).any()
    return {
        "value": float(peaks.most[i]),
        "size": float(size[i]),
        "unit": unit,
        "place": place,
        "at_s": float(peaks.at[i]),
        **({"rest": True} if resting else {}),
    }


def _torque(results: Results, robot: Robot, arm: ArmLimits | None) -> dict[str, Any]:
    """Return the largest torque of a motor, link-side."""
    limit = None
    if arm is not None:
        least = np.minimum(arm.tau_max, arm.delivered(np.full(robot.n, NO_LIMIT), np.zeros(robot.n)))
        limit = robot.ell * np.where(least < NO_LIMIT, least, np.inf)
        limit = limit if np.isfinite(limit).any() else None
    peaks = _Peaks(robot.n)
    for part in results.blocks(BLOCK):
        tau = part["controller.tau"]
        if arm is not None and "plant.kappa_dot[1]" in results:
            tau = arm.delivered(np.clip(tau, -arm.tau_max, arm.tau_max), part["plant.kappa_dot"])
        peaks.add(part.time, np.abs(robot.ell * tau))
    return peaks.worst([JOINT_TYPES[kind].unit("torque") for kind in robot.joint_types], limit)
