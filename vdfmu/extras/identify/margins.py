"""The margin of a controller over all springs that fit a log, from its derivatives and from the exact loop."""

from __future__ import annotations

import os
from typing import NamedTuple

import numpy as np

from vdfmu.arm.robot import Robot
from vdfmu.base.arrays import Floats
from vdfmu.base.errors import UsageError
from vdfmu.engine.results.verdict import Check
from vdfmu.extras.identify.fit import NORMAL_95
from vdfmu.extras.identify.stiffness import Stiffness
from vdfmu.extras.identify.stiffness_report import scaled_robot
from vdfmu.study.analysis.loops import margins_along
from vdfmu.study.limits import LIMITS
from vdfmu.study.run.prepare import scenario_of
from vdfmu.system.package.description import SystemDescription
from vdfmu.system.scenario import Scenario
from vdfmu.system.scenario.values import system_values

UNKNOWN = 0.3
"""Standard deviation of the logarithm of a stiffness that the log does not excite: values in robot files are wrong by
factors of 0.7 to 1.4."""
_ONE_SIDED_95 = 1.645
"""5 % quantile of the standard normal distribution, with the sign reversed."""


class MarginInterval(NamedTuple):
    """Modulus margins of a scenario over springs, each at the place and time where it is smallest."""

    middle: float
    """Margin with the identified springs."""
    place: str
    slopes: Floats
    """Derivative with respect to the logarithm of each stiffness, (n,)."""
    likely: float
    """Margin that 95 % of the arms that fit the log exceed: of the exact loop, with springs at which the linearised
    margin is at its 5 % quantile."""
    linear: float
    """The same quantile from the slopes only."""
    corner: float
    """Margin of the exact loop at the worst corner of the 95 % intervals."""
    factors: Floats
    """Stiffness at that corner relative to the identified one, (n,)."""
    assumed: tuple[int, ...]
    """Joints, from 1, whose spring the log does not excite."""

    @property
    def check(self) -> Check:
        """The check in the verdict: the margin of 95 % of the arms, compared with the limit of runs."""
        row, likely = LIMITS["margin"], min(self.likely, self.linear)
        text = f"modulus margin {self.middle:.2f}, at least {likely:.2f} for 95 % of the arms that fit the log"
        signs = ", ".join(f"{x:.2f}" for x in self.factors)
        more = f"worst corner {self.corner:.2f}, with springs scaled by {signs}; smallest at {self.place}"
        return Check("margin", row.name, row.state(likely), text, more, likely, row.value, row.by)


def spring_margins(fit: Stiffness, scenario: Scenario | str | os.PathLike[str]) -> MarginInterval:
    """Return the modulus margin of a scenario over the springs that fit a log.

    The scenario's plant gets the springs; the model in its controller stays the same. Only the springs are uncertain,
    with absolute intervals, which include the errors of links and torque constants. UsageError for a scenario with
    another arm.
    """
    system = scenario_of(scenario)
    robot, shown = scaled_robot(fit)[0], fit.identifiable
    plant = _plant(system, robot)
    n = robot.n
    covariance = np.diag(np.where(shown, 0.0, UNKNOWN**2))
    for i in np.flatnonzero(shown).tolist():
        covariance[i, shown] = covariance[shown, i] = fit.levels[fit.best(i)].uncertainty[i, shown]
    deviation = np.sqrt(np.diag(covariance))

    def margin(shift: Floats) -> tuple[float, str]:
        factor = np.exp(shift)
        values = {f"{plant}.K_f0": robot.K_f0 * factor, f"{plant}.K_w0": robot.K_w0 * factor}
        figures = margins_along(system, parameters=values).judged.figures
        if "unstable" in figures:
            return 0.0, figures["unstable"]["place"]
        if "margin" not in figures:
            raise UsageError(f"margins: {system.name}: expected a loop over the torques of the plant, got none.")
        return float(figures["margin"]["value"]), figures["margin"]["place"]

    middle, place = margin(np.zeros(n))
    slopes = np.zeros(n)
    for i in range(n):
        step = deviation[i] * np.eye(n)[i]
        slopes[i] = (margin(step)[0] - margin(-step)[0]) / (2.0 * deviation[i])
    spread = float(np.sqrt(slopes @ covariance @ slopes))
    direction = covariance @ slopes / max(spread, 1e-300)
    likely, _ = margin(-_ONE_SIDED_95 * direction)
    worst = -np.sign(slopes) * NORMAL_95 * deviation
    corner, _ = margin(worst)
    assumed = tuple(i + 1 for i in np.flatnonzero(~shown).tolist())
    return MarginInterval(
        middle, place, slopes, likely, middle - _ONE_SIDED_95 * spread, corner, np.exp(worst), assumed
    )


def _plant(scenario: Scenario, robot: Robot) -> str:
    """Return the component of the scenario that is the arm."""
    system = SystemDescription(scenario, system_values(scenario))
    fits = [name for name in system.resolved.plants if _is_arm(system.resolved.robots[name], robot)]
    if not fits:
        raise UsageError(f"margins: {scenario.name}: expected a plant with the joints and gear ratios of {robot.name}.")
    return fits[0]


def _is_arm(other: Robot | None, robot: Robot) -> bool:
    return other is not None and other.joint_types == robot.joint_types and bool(np.allclose(other.ell, robot.ell))
