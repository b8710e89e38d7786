"""Numbers of a run: errors of tracking and compensation, time at limits, differences from the references."""

from __future__ import annotations

import platform
from collections.abc import Iterable, Iterator
from datetime import UTC, datetime
from importlib import import_module
from types import SimpleNamespace
from typing import Any, NamedTuple

import numpy as np

from vdfmu.arm.drive.limits import at_limits, motor_torque
from vdfmu.arm.robot import Robot
from vdfmu.arm.robot.parameters import section
from vdfmu.base.arrays import Floats, with_named
from vdfmu.base.measure import JOINT_TYPES, quantity, unit_of
from vdfmu.base.version import FORMAT, __version__
from vdfmu.compiler.unit.declaration import NO_LIMIT
from vdfmu.engine.results.results import Recorded, Results
from vdfmu.system.package.description import SystemDescription
from vdfmu.system.reference.reference import BLOCK, Reference, Repeated
from vdfmu.system.scenario import Scenario
from vdfmu.system.scenario.replace import leaders

_PACKAGES = ("numpy", "scipy", "casadi", "fmpy")
"""Packages on which the numbers of a run depend, in addition to vdfmu."""
_COMPARED = ("plant.q", "controller.tau", "feedforward.tau_m")
_APART = 1e-6
"""Difference [rad, m] between a start and the motion's start from which it is noted."""
FAR = 1e-2
"""The same, from which the first torque may make a run fail: 10 N.m at a gain of 1000 N.m/rad."""
_ESTIMATES = ("tau_f_hat", "tau_s_hat")


def run_facts(scenario: Scenario) -> dict[str, Any]:
    """Return the facts of a scenario before a run, with versions of the software."""
    robot, versions = scenario.robot, {name: import_module(name).__version__ for name in _PACKAGES}
    return {
        "scenario": scenario.name,
        **({"scenario_file": scenario.file} if scenario.file else {}),
        **({"description": scenario.description} if scenario.description else {}),
        **({} if robot is None else {"robot": robot.name, "friction": robot.friction, "joints": robot.n}),
        **({"robot_file": robot.file} if robot is not None and robot.file else {}),
        "vdfmu": __version__,
        "date": datetime.now(UTC).isoformat(timespec="seconds"),
        "format": FORMAT,
        "versions": {"Python": platform.python_version()} | versions,
        "algorithm": scenario.algorithm,
        "adaptive": scenario.adaptive,
        "step": scenario.step,
        "stop": scenario.stop,
        "tolerance": scenario.tolerance,
        "inputs": [table.where for table in scenario.inputs],
        "plant_factors": {key: np.asarray(f).tolist() for key, f in scenario.plant_factors.items()},
    }


def has_signals(results: Results, *groups: str) -> bool:
    """Return whether a run recorded the first element of groups ``component.signal``."""
    return all(f"{group}[1]" in results for group in groups)


def start_notes(results: Results, scenario: Scenario, least: float = _APART) -> Iterator[str]:
    """Yield a note for each plant that starts more than `least` [rad, m] away from its motion."""
    start = next(results.blocks(1), results)
    for plant, leader in leaders(scenario.resolved).items():
        q = scenario.system.fed.get(f"{plant}.q", f"{plant}.q")
        if has_signals(results, f"{leader}.q_d", q):
            apart = np.abs(start[f"{leader}.q_d"][0] - start[q][0])
            i = int(apart.argmax())
            if apart[i] > least:
                arm = scenario.system.parts[plant].robot or scenario.arm
                kind, tau, first = arm.joint_types[i], scenario.system.fed.get(f"{plant}.tau", ""), ""
                if has_signals(results, tau):
                    torque = quantity(arm.ell[i] * start[tau][0, i], unit_of("torque", kind))
                    first = f", and the first torque there is {torque}, link-side"
                yield (
                    f"{plant} starts {apart[i]:.4g} {unit_of('position', kind)} from the start of {leader} at joint "
                    f"{i + 1}{first}: set {plant}.q_0, or share it in [shared.start] of the system's file."
                )


def tracking_errors(
    results: Results, robot: Robot, limits: Iterable[ArmLimits] = (), tau_m: str = "feedforward.tau_m"
) -> dict[str, Any]:
    """Position errors in deg (mm for prismatic joints) and torque compensation errors link-side in N m (N).

    The compensation error is the control torque minus the feedforward torque, the signal `tau_m`, as in the paper's
    Fig. 11(b): ``ell (tau - tau_m)``. With `limits` of the motors of ``plant``, tau is the motors' torque, which may be
    less than the controller's. Empty for a system without these signals.
    """
    if not tau_m or not has_signals(results, "trajectory.q_d", "plant.q", "controller.tau", tau_m):
        return {}
    types = [JOINT_TYPES[kind] for kind in robot.joint_types]
    scale = np.array([each.shown.factor for each in types])
    motors = next((arm for arm in limits if arm.plant == "plant" and "plant.kappa_dot[1]" in results), None)
    squares, largest = np.zeros((2, robot.n)), np.zeros(robot.n)
    for part in results.blocks(BLOCK):
        error = scale * (part["trajectory.q_d"] - part["plant.q"])
        tau = part["controller.tau"]
        delivered = tau if motors is None else motors.delivered(tau, part["plant.kappa_dot"])
        compensation = robot.ell * (delivered - part[tau_m])
        squares += np.sum(np.square([error, compensation]), axis=1)
        largest = np.maximum(largest, np.max(np.abs(error), axis=0))
    rms_error, rms_compensation = np.sqrt(squares / len(results)).tolist()
    return {
        **({"joint_names": list(robot.joint_names)} if any(robot.joint_names) else {}),
        "position_units": [each.shown.unit for each in types],
        "torque_units": [each.unit("torque") for each in types],
        "rms_position_error_deg": rms_error,
        "max_position_error_deg": largest.tolist(),
        "rms_torque_compensation_error_nm": rms_compensation,
    }


def compared(results: Results, robot: Robot | None) -> tuple[str, ...] | None:
    """Return the groups of a reference that :func:`compare` reads; None for all outputs."""
    needed = ("trajectory.q_d", "plant.q", "controller.tau", "feedforward.tau_m")
    return _COMPARED if robot is not None and has_signals(results, *needed) else None


def compare(
    results: Results, reference: Iterable[Reference], robot: Robot | None, substeps: int
) -> tuple[dict[str, Any], dict[str, float]]:
    """Compare a run with a reference in blocks of `BLOCK` rows, each preceded by the row before it.

    The row at a step's end has the torque that a sampled master held over the step, so the continuous reference is
    evaluated a substep earlier, when this torque was calculated.

    Return the largest absolute differences of link positions [rad or m] and control torques, link-side [N m or N];
    then, for loops whose single solutions separate, a joint's largest relative differences between the RMS errors of
    run and reference, see :func:`tracking_errors`.
    """
    if robot is None or compared(results, robot) is None:
        largest: dict[str, float] = {}
        groups, name, repeated = {signal.partition("[")[0] for signal in results.names}, "", Repeated()
        for part, solution in zip(results.blocks(BLOCK, overlap=1), reference, strict=True):
            name = solution.name
            repeated = solution.repeated
            for signal in filter(groups.__contains__, solution.signals):
                rows = solution.signals[signal]
                differences = np.abs(part[signal].reshape(rows.shape) - rows).max(axis=1)
                apart = float(differences.max())
                if apart > largest.get(signal, 0.0):
                    solution.repeat(int(differences.argmax()))
                largest[signal] = max(largest.get(signal, 0.0), apart)
        return {"name": name, "max_difference": largest, **repeated.entries}, {}
    name, at, position, torque, repeated = "", 0.0, -1.0, 0.0, Repeated()
    squares = np.zeros((4, robot.n))  # errors of position and torque, ours and theirs
    for k, (part, solution) in enumerate(zip(results.blocks(BLOCK, overlap=1), reference, strict=True)):
        new = slice(min(k, 1), None)
        q_d, q = part["trajectory.q_d"], part["plant.q"]
        tau, tau_m = part["controller.tau"], part["feedforward.tau_m"]
        name, tau_m_r = solution.name, solution["feedforward.tau_m"]
        q_r, tau_r = solution["plant.q"], solution["controller.tau"]
        if name == "continuous":
            tau_r = _earlier(tau_r, substeps)
        difference, repeated = np.abs(q - q_r).max(axis=1), solution.repeated
        solution.repeat(int(difference.argmax()))
        if difference.max() > position:
            at, position = float(part.time[difference.argmax()]), float(difference.max())
        torque = max(torque, float(np.abs(robot.ell * (tau - tau_r)[new]).max()))
        errors = [q_d - q, q_d - q_r, tau - tau_m, tau_r - tau_m_r]
        squares += np.sum(np.square(errors)[:, new], axis=1)
    facts = {"name": name, "max_position_difference_rad": position, "max_torque_difference_nm": torque, "at_s": at}
    facts |= repeated.entries
    rms = np.sqrt(squares / len(results))
    separate = (np.abs(rms[::2] - rms[1::2]) / np.maximum(rms[1::2], np.finfo(float).tiny)).max(axis=1)
    return facts, {"rms_position_difference": float(separate[0]), "rms_torque_difference": float(separate[1])}


def estimation_errors(results: Results, substeps: int) -> dict[str, Any]:
    """RMS values of the spring torque and of the estimates' errors, link-side [N m or N].

    A sampled master passes to the estimator the plant's signals of a substep earlier, when its step began, and the
    torque of the step that ended then. Empty for a run that ended before its first step.
    """
    late, squares = min(1, substeps), 0.0
    if len(results) <= late:
        return {}
    for k, part in enumerate(results.blocks(BLOCK, overlap=1)):
        rows = slice(min(1, late + k), None)
        seen = _earlier(part["plant.tau_s"], substeps)[rows]
        errors = [part[f"estimator.{name}"][rows] - seen for name in _ESTIMATES]
        squares = squares + np.sum(np.square([seen, *errors]), axis=1)
    rms = np.sqrt(squares / (len(results) - late)).tolist()
    return dict(zip(("rms_spring_torque_nm", *(f"rms_{n}_error_nm" for n in _ESTIMATES)), rms, strict=True))


def _earlier(rows: Floats, substeps: int) -> Floats:
    """Return the values a substep earlier by linear interpolation between rows; the first row is kept."""
    lag = 1.0 / substeps if substeps else 0.0
    return (1.0 - lag) * rows + lag * np.vstack([rows[:1], rows[:-1]])


LIMITED = 0.01
"""Smallest reported share of a run's time at a limit, because the table shows whole per cent."""
_PLACES = ("torque limit", "speed limit", "end stop")


class ArmLimits(NamedTuple):
    """The limits that act on an arm of a system."""

    plant: str
    """The arm's component."""
    robot: Any
    """Robot with the run's values for :func:`vdfmu.arm.drive.limits.motor_torque`; None without limits."""
    tau_max: Floats
    """Limit (n,) [N m], motor-side, of the controller's torque; `NO_LIMIT` if there is none."""
    asked: str
    """Signal of the requested torque."""

    def delivered(self, tau: Floats, kappa_dot: Floats) -> Floats:
        """Return the torque of the motors if `tau` is requested: (rows, n) [N m], motor-side."""
        return tau if self.robot is None else motor_torque(self.robot, tau, kappa_dot)


def limits_of(system: SystemDescription) -> list[ArmLimits]:
    """Return the limits of the arms of a system, omitting arms without limits."""
    units, values = system.resolved.units, system.values
    limits: list[ArmLimits] = []
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
            limited = SimpleNamespace(**{n: with_named(getattr(robot, n), n, values[plant]) for n in names})
        if limited is not None or (tau_max < NO_LIMIT).any():
            limits.append(ArmLimits(plant, limited, tau_max, source or f"{plant}.tau"))
    return limits


def time_at_limits(results: Results, limits: list[ArmLimits]) -> dict[str, Any]:
    """Return the fractions of a run's time in which the joints were at their limits.

    A motor is at its torque limit if it, or its controller, is at its largest torque and more is requested, and at its
    speed limit if only the speed reduces the torque. A joint is at an end stop if the stop pushes. A row represents the
    step that ends there.

    ``limits``: by component of an arm with limits, ``torque``, ``speed`` and ``stop``, with a share of 0 to 1 for each
    joint. Empty without limits, or without their signals. ``key_figures`` has the largest share, ``saturated``, its
    place, and its start time.
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
    """Return the shares of the time at the limits of torque, speed and travel, (3, n), and when each begins."""
    spent, since = np.zeros((3, len(arm.tau_max))), np.full((3, len(arm.tau_max)), np.inf)
    for part in results.blocks(BLOCK, overlap=1):
        asked, q, kappa_dot = (part[name] for name in _read(arm))
        cut = np.abs(asked) >= arm.tau_max
        slow = beyond = np.zeros_like(cut)
        if arm.robot is not None:
            most, slow, beyond = at_limits(arm.robot, asked, kappa_dot, q)
            cut |= most
        there = np.stack([cut, slow, beyond])
        spent += np.sum(np.diff(part.time)[:, None] * there[:, 1:], axis=1)
        since = np.minimum(since, np.where(there, part.time[:, None], np.inf).min(axis=1))
    return spent / max(float(results.time[-1] - results.time[0]), np.finfo(float).tiny), since
