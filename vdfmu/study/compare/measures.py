"""Measures of a run under their names in the field: ISO 9283 for the path and the end of a motion, errors, effort.

An attained path is compared with the commanded one at places of the latter: where it crosses the plane normal to it.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np

from vdfmu.arm.dynamics import forward_kinematics
from vdfmu.arm.robot import Robot
from vdfmu.base.arrays import Floats
from vdfmu.base.errors import UsageError
from vdfmu.engine.linear.growth import Along
from vdfmu.engine.results.results import Results
from vdfmu.study.run.at_limits import ArmLimits, time_at_limits

SIGNALS = ("trajectory.q_d", "plant.q", "plant.tau", "plant.p_O", "plant.kappa_dot")
"""Signals that the measures read."""
PLACES = 40
"""Places of the commanded path at which it is compared."""
BAND = 1e-4
"""Limit band of the position stabilisation time [m]."""
_THERE = 1e-9
"""Distance of the command from its end [rad, m] that is rounding."""


class PathRun:
    """A run, and the commanded path of its tool."""

    def __init__(self, results: Results, robot: Robot, corner: Floats, limits: Sequence[ArmLimits] = ()) -> None:
        self.results, self.robot, self.corner, self.limits = results, robot, corner, limits
        self.time, self.q_d, self.q, self.p = (
            results.time,
            *(results[n] for n in (SIGNALS[0], SIGNALS[1], SIGNALS[3])),
        )
        self.tau: Floats = results["plant.tau"]

    @cached_property
    def p_d(self) -> Floats:
        """Commanded position of the tool, (m, 3) [m]."""
        return forward_kinematics(self.robot, self.q_d)[0]

    @cached_property
    def end(self) -> int:
        """First row at which the command is at its end."""
        away = np.abs(self.q_d - self.q_d[-1]).max(axis=1) > _THERE
        return int(len(away) - np.argmax(away[::-1])) if away.any() else 0

    @property
    def joint_errors(self) -> Floats:
        """Errors of the revolute joints, (m, k) [rad]."""
        return (self.q_d - self.q)[:, np.array(self.robot.joint_types) == "revolute"]

    @property
    def tool_errors(self) -> Floats:
        """Distance of the tool from where it should be at that time, (m,) [m]."""
        return np.linalg.norm(self.p - self.p_d, axis=1)

    @cached_property
    def loops(self) -> Any:
        """The loops along the run, None if they are not known."""
        poses = self.results.summary.get("loops")
        return None if poses is None or poses.lacking else poses.loops


def crossings(commanded: Floats, attained: Floats, end: int, places: int = PLACES) -> Floats:
    """Places at which an attained path, (m, 3), crosses planes normal to a commanded one, (m, 3): (places, 3) [m].

    The planes stand evenly along the commanded path of `end` rows. Of several crossings the one nearest in time counts;
    where there is none, the row that comes nearest to the plane.
    """
    way = np.append(0.0, np.cumsum(np.linalg.norm(np.diff(commanded[: end + 1], axis=0), axis=1)))
    rows = np.searchsorted(way, way[-1] * np.linspace(0.0, 1.0, places + 2)[1:-1])
    found = np.empty((places, 3))
    for j, i in enumerate(rows.tolist()):
        along = (attained - commanded[i]) @ (commanded[min(i + 1, end)] - commanded[i - 1])
        through = np.flatnonzero((along[:-1] <= 0.0) & (along[1:] > 0.0))
        if not len(through):
            found[j] = attained[np.abs(along).argmin()]
            continue
        k = through[np.abs(through - i).argmin()]
        share = along[k] / (along[k] - along[k + 1])
        found[j] = attained[k] + share * (attained[k + 1] - attained[k])
    return found


def planes(commanded: Floats, end: int, places: int = PLACES) -> Floats:
    """Places of the commanded path, (places, 3) [m], that belong to the crossings."""
    return crossings(commanded, commanded, end, places)


def path_accuracy(commanded: Floats, cycles: Floats) -> float:
    """AT of ISO 9283 [m]: largest distance of the mean of the cycles' crossings, (cycles, places, 3), from the command.

    commanded : (places, 3) [m]
    """
    return float(np.linalg.norm(cycles.mean(axis=0) - commanded, axis=1).max())


def path_repeatability(cycles: Floats) -> float:
    """RT of ISO 9283 [m]: largest mean distance of the crossings from their mean, plus three standard deviations.

    0 of one cycle, and of cycles that are the same.
    """
    if len(cycles) < 2:
        return 0.0
    distance = np.linalg.norm(cycles - cycles.mean(axis=0), axis=2)
    return float((distance.mean(axis=0) + 3.0 * distance.std(axis=0, ddof=1)).max())


def corner_deviation(run: PathRun) -> float:
    """CR of ISO 9283 [m]: distance of the corner from the attained path; NaN of a path without a corner."""
    if np.linalg.norm(run.p_d - run.corner, axis=1).min() > 1e-3:
        return math.nan
    a, step = run.p[:-1], np.diff(run.p, axis=0)
    share = np.sum((run.corner - a) * step, axis=1) / np.maximum(np.sum(step**2, axis=1), np.finfo(float).tiny)
    return float(np.linalg.norm(a + np.clip(share, 0.0, 1.0)[:, None] * step - run.corner, axis=1).min())


def _from_end(run: PathRun) -> Floats:
    """Distance of the tool from where it comes to rest, from the first row at the command's end on [m]."""
    return np.linalg.norm(run.p[run.end :] - run.p[-1], axis=1)


def stabilisation(run: PathRun) -> float:
    """Position stabilisation time of ISO 9283 [s]: from the end of the command until the tool stays within the band."""
    outside = np.flatnonzero(_from_end(run) > BAND)
    return float(run.time[run.end + outside[-1] + 1] - run.time[run.end]) if len(outside) else 0.0


def overshoot(run: PathRun) -> float:
    """Position overshoot of ISO 9283 [m]: largest distance after the tool was within the band; 0 if it stays there."""
    distance = _from_end(run)
    inside = np.flatnonzero(distance <= BAND)
    most = float(distance[inside[0] :].max())
    return most if most > BAND else 0.0


def _margin(run: PathRun) -> float:
    nearest = None if run.loops is None else run.loops.nearest()
    return math.nan if nearest is None else nearest.modulus


def _growth(run: PathRun) -> float:
    return math.nan if run.loops is None else float(run.loops.growth(0.0, float(run.time[-1])).unstable)


def _required(run: PathRun, delayed: bool) -> float:
    """Modulus margin, perhaps with one more sample of delay of the torques; 0 where that is unstable."""
    if run.loops is None:
        raise UsageError("the loops of the run are not known")
    if not delayed:
        return 0.0 if _growth(run) else _margin(run)
    late = PathRun(run.results, run.robot, run.corner)
    own = run.loops
    late.loops = Along(
        replace(own.system, fresh=own.system.fresh & [not n.startswith("plant.tau") for n in own.system.parts.inputs]),
        own.opened,
        [pose[:2] for pose in own.rows],
    )
    return _required(late, False)


def _limited(run: PathRun) -> float:
    shares = time_at_limits(run.results, list(run.limits)).get("limits", {})
    return max((share for one in shares.values() for kind in one.values() for share in kind), default=0.0)


class FieldMeasure(NamedTuple):
    """A measure: title, unit, what to multiply by to show it, unit shown; less is better."""

    title: str
    unit: str
    factor: float
    shown: str
    of: Callable[[PathRun], Any] | None
    """Function of a run; None for a measure of all runs of a cell."""
    more_is_better: bool = False


def _rms(x: Floats) -> float:
    return float(np.sqrt(np.mean(np.square(x))))


MEASURES: dict[str, FieldMeasure] = {
    "AT": FieldMeasure("path accuracy AT", "m", 1e3, "mm", None),
    "RT": FieldMeasure("path repeatability RT", "m", 1e3, "mm", None),
    "CR": FieldMeasure("corner deviation CR", "m", 1e3, "mm", corner_deviation),
    "stabilisation": FieldMeasure("position stabilisation time", "s", 1e3, "ms", stabilisation),
    "overshoot": FieldMeasure("position overshoot", "m", 1e3, "mm", overshoot),
    "rms_tool": FieldMeasure("RMS tool error", "m", 1e3, "mm", lambda run: _rms(run.tool_errors)),
    "peak_tool": FieldMeasure("peak tool error", "m", 1e3, "mm", lambda run: float(run.tool_errors.max())),
    "rms_joint": FieldMeasure("RMS joint error", "rad", 1e3, "mrad", lambda run: float(
        np.sqrt(np.mean(run.joint_errors**2, axis=0)).max())),
    "peak_joint": FieldMeasure("peak joint error", "rad", 1e3, "mrad", lambda run: float(
        np.abs(run.joint_errors).max())),
    "effort": FieldMeasure("effort: RMS torque", "N.m", 1.0, "N.m", lambda run: _rms(
        np.linalg.norm(run.tau, axis=1))),
    "torque_noise": FieldMeasure("torque noise: RMS change a sample", "N.m", 1e3, "mN.m", lambda run: _rms(
        np.linalg.norm(np.diff(run.tau, axis=0), axis=1))),
    "modulus": FieldMeasure("modulus margin", "", 1.0, "", _margin, True),
}  # fmt: skip
HIDDEN: dict[str, Callable[[PathRun], Any]] = {
    "unstable": _growth, "limited": _limited, "crossing": lambda run: crossings(run.p_d, run.p, run.end).ravel(),
    "place": lambda run: planes(run.p_d, run.end).ravel(),
}  # fmt: skip
"""What the verdict of a cell, and AT and RT of its runs, are made of."""
OF_A_RUN = {name: measure.of for name, measure in MEASURES.items() if measure.of} | HIDDEN
_OF_LOOPS = ("modulus", "unstable", "margin")
"""Measures of the loops of a run, which is linearised for them."""


@dataclass(frozen=True, eq=False)
class OfRun:
    """A measure as a study takes it: a function of the results, which a worker gets."""

    name: str
    robot: Robot
    corner: Floats
    limits: Sequence[ArmLimits] = ()
    least: float = 0.0
    """Of a limit: the least value of the measure, from which it is subtracted."""
    delayed: bool = False
    """Of a limit of the margin: whether with one more sample of delay."""
    signals = tuple(SIGNALS)

    @property
    def loops(self) -> bool:
        """Whether it needs the loops of the run."""
        return self.name in _OF_LOOPS

    def __call__(self, results: Results) -> Any:
        """Return the measure of a run; of a limit what is missing to the least value."""
        run = PathRun(results, self.robot, self.corner, self.limits)
        if self.name == "margin":
            return self.least - _required(run, self.delayed)
        return OF_A_RUN[self.name](run)
