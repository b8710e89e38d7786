"""How long the joints of a run were at their limits: torque and speed of the motors, end stops."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any, NamedTuple

import numpy as np

from vdfmu.arm.drive.limits import at_limits, motor_torque
from vdfmu.arm.robot.parameters import section
from vdfmu.base.arrays import Floats, with_named
from vdfmu.compiler.unit.declaration import NO_LIMIT
from vdfmu.engine.results.recorded import Recorded
from vdfmu.engine.results.results import Results
from vdfmu.system.package.description import SystemDescription
from vdfmu.system.reference.reference import BLOCK

LIMITED = 0.01
"""Least share of a run's time at a limit that is told: the table of the shares shows whole per cent."""
_PLACES = ("torque limit", "speed limit", "end stop")


class ArmLimits(NamedTuple):
    """Limits that act on an arm of a system."""

    plant: str
    """The arm's component."""
    robot: Any
    """With the run's values, as :func:`vdfmu.arm.drive.limits.motor_torque` reads it; None without limits."""
    tau_max: Floats
    """(n,) [N m] motor-side, at which the controller cuts its torque; `NO_LIMIT` if it does not."""

    asked: str
    """Signal of the torque that is asked for."""

    def given(self, tau: Floats, kappa_dot: Floats) -> Floats:
        """Torque that the motors give where `tau` is asked for: (rows, n) [N m], motor-side."""
        return tau if self.robot is None else motor_torque(self.robot, tau, kappa_dot)


def limits_of(system: SystemDescription) -> list[ArmLimits]:
    """Return the limits of the arms of a system, except arms without limits."""
    units, values = system.resolved.units, system.values
    found: list[ArmLimits] = []
    for plant, unit in units.items():
        robot = system.resolved.robots[plant]
        if robot is None or "q_0" not in unit.declared or "tau" not in unit.declared:
            continue
        source = system.scenario.system.fed.get(f"{plant}.tau", "")
        controller = source.partition(".")[0]
        cuts = controller in units and "tau_max" in units[controller].declared
        tau_max = with_named(np.full(robot.n, NO_LIMIT), "tau_max", values[controller] if cuts else {})
        limited = None
        if robot.limits:
            names = (row.name for row in section("limits"))
            own = {name: with_named(getattr(robot, name), name, values[plant]) for name in names}
            limited = SimpleNamespace(**own)
        if limited is not None or (tau_max < NO_LIMIT).any():
            found.append(ArmLimits(plant, limited, tau_max, source or f"{plant}.tau"))
    return found


def time_at_limits(results: Results, limits: list[ArmLimits]) -> dict[str, Any]:
    """Return the shares of a run's time that the joints were at their limits.

    A motor is at its torque limit where it, or the controller before it, gives less torque than is asked for and
    gives its largest; at its speed limit where the speed alone makes it give less. A joint is at an end stop where the
    stop pushes. A row represents the step that ends there.

    Returns
    -------
    dict
        ``limits``: for each arm with limits, by component, ``torque``, ``speed`` and ``stop``, with a share of 0 to 1
        for each joint. Empty where no arm has limits, or the limited signals were not recorded. ``key_figures`` has
        the largest share, ``saturated``, its place, and since when the joint is there.
    """
    shares: dict[str, Any] = {}
    worst: dict[str, Any] = {"value": LIMITED}
    recorded = [arm for arm in limits if all(f"{name}[1]" in results for name in _read(arm))]
    for arm in recorded:
        spent, since = _spent(results, arm)
        shares[arm.plant] = dict(zip(("torque", "speed", "stop"), spent.tolist(), strict=True))
        kind, joint = np.unravel_index(spent.argmax(), spent.shape)
        if spent[kind, joint] >= worst["value"]:
            place = f"{_PLACES[kind]} of joint {joint + 1}{f' of {arm.plant}' if len(recorded) > 1 else ''}"
            worst = {"value": float(spent[kind, joint]), "place": place, "at_s": float(since[kind, joint])}
    return ({"limits": shares} if shares else {}) | ({"key_figures": {"saturated": worst}} if "place" in worst else {})


def _read(arm: ArmLimits) -> tuple[str, str, str]:
    return arm.asked, f"{arm.plant}.q", f"{arm.plant}.kappa_dot"


def _spent(results: Recorded, arm: ArmLimits) -> tuple[Floats, Floats]:
    """Return the shares of the time at the limits of torque, speed and travel, (3, n), and when each is first met."""
    spent, since = np.zeros((3, len(arm.tau_max))), np.full((3, len(arm.tau_max)), np.inf)
    before = results.time[0]
    for part in results.blocks(BLOCK):
        h = np.diff(part.time, prepend=before)[:, None]  # 0 at the first row, which ends no step
        before = part.time[-1]
        asked, q, kappa_dot = (part[name] for name in _read(arm))
        cut = np.abs(asked) >= arm.tau_max
        slow = beyond = np.zeros_like(cut)
        if arm.robot is not None:
            most, slow, beyond = at_limits(arm.robot, asked, kappa_dot, q)
            cut |= most
        there = np.stack([cut, slow, beyond])
        spent += np.sum(h * there, axis=1)
        since = np.minimum(since, np.where(there, part.time[:, None], np.inf).min(axis=1))
    return spent / max(float(results.time[-1] - results.time[0]), np.finfo(float).tiny), since
