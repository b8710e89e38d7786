"""Numbers of a run: tracking and compensation errors, differences to the references."""

from __future__ import annotations

import platform
from collections.abc import Iterable
from datetime import UTC, datetime
from importlib.metadata import version
from typing import Any

import numpy as np

from vdfmu.arm.robot import Robot
from vdfmu.base.arrays import Floats
from vdfmu.base.measure import JOINT_UNITS, unit_of
from vdfmu.base.version import FORMAT, __version__
from vdfmu.engine.results.results import Results
from vdfmu.study.run.at_limits import ArmLimits
from vdfmu.system.reference.reference import BLOCK, Reference
from vdfmu.system.scenario import Scenario
from vdfmu.system.scenario.replace import leaders

_COMPARED = ("plant.q", "controller.tau", "feedforward.tau_m")
_APART = 1e-6
"""Largest difference [rad, m] between a start and the motion's start that is not noted."""
_ESTIMATES = ("tau_f_hat", "tau_s_hat")


def run_facts(scenario: Scenario) -> dict[str, Any]:
    """Return the facts known before a run begins, and the versions that make it."""
    robot = scenario.robot
    return {
        "scenario": scenario.name,
        **({"scenario_file": scenario.file} if scenario.file else {}),
        **({} if robot is None else {"robot": robot.name, "friction": robot.friction, "joints": robot.n}),
        **({"robot_file": robot.file} if robot is not None and robot.file else {}),
        "vdfmu": __version__,
        "date": datetime.now(UTC).isoformat(timespec="seconds"),
        "format": FORMAT,
        "versions": _versions(),
        "master": scenario.master,
        "adaptive": scenario.adaptive,
        "step": scenario.step,
        "stop": scenario.stop,
        "tolerance": scenario.tolerance,
        "inputs": [table.where for table in scenario.inputs],
        "plant_factors": {key: np.asarray(f).tolist() for key, f in scenario.plant_factors.items()},
    }


def _versions() -> dict[str, str]:
    """Versions of the software that the numbers of a run depend on, in addition to the package's."""
    return {"Python": platform.python_version()} | {
        name: version(name) for name in ("numpy", "scipy", "casadi", "fmpy")
    }


def has_signals(results: Results, *groups: str) -> bool:
    """Whether a run recorded the first element of groups ``component.signal``."""
    return all(f"{group}[1]" in results for group in groups)


def start_notes(results: Results, scenario: Scenario) -> list[str]:
    """Return a note for each plant that does not start where its motion starts."""
    notes: list[str] = []
    start = next(results.blocks(1), results)
    for plant, leader in leaders(scenario.resolved).items():
        q = scenario.system.fed.get(f"{plant}.q", f"{plant}.q")
        if has_signals(results, f"{leader}.q_d", q):
            apart = np.abs(start[f"{leader}.q_d"][0] - start[q][0])
            i = int(apart.argmax())
            if apart[i] > _APART:
                kind = (scenario.system.parts[plant].robot or scenario.arm).joint_types[i]
                notes.append(
                    f"{plant} starts {apart[i]:.4g} {unit_of('position', kind)} from the position that {leader} wants "
                    f"of joint {i + 1}: set {plant}.q_0, or share it in [shared.start] of the system's file."
                )
    return notes


def tracking_errors(
    results: Results, robot: Robot, limits: Iterable[ArmLimits] = (), tau_m: str = "feedforward.tau_m"
) -> dict[str, Any]:
    """Position errors in deg (mm for prismatic joints) and torque compensation errors link-side in N m (N).

    The compensation error is the control torque minus the feedforward torque, the signal `tau_m`, as in the paper's
    Fig. 11(b): ``ell (tau - tau_m)``. With `limits` of the motors of ``plant``, tau is what they gave, which may be
    less than the controller asked for. Empty for a system without these signals.
    """
    if not tau_m or not has_signals(results, "trajectory.q_d", "plant.q", "controller.tau", tau_m):
        return {}
    units = [JOINT_UNITS[kind] for kind in robot.joint_types]
    scale = np.array([unit.factor for unit in units])
    motors = next((one for one in limits if one.plant == "plant" and f"{one.plant}.kappa_dot[1]" in results), None)
    squares, largest = np.zeros((2, robot.n)), np.zeros(robot.n)
    for part in results.blocks(BLOCK):
        error = scale * (part["trajectory.q_d"] - part["plant.q"])
        tau = part["controller.tau"]
        given = tau if motors is None else motors.given(tau, part["plant.kappa_dot"])
        compensation = robot.ell * (given - part[tau_m])
        squares += np.sum(np.square([error, compensation]), axis=1)
        largest = np.maximum(largest, np.max(np.abs(error), axis=0))
    rms_error, rms_compensation = np.sqrt(squares / len(results)).tolist()
    return {
        **({"joint_names": list(robot.joint_names)} if any(robot.joint_names) else {}),
        "position_units": [unit.position for unit in units],
        "torque_units": [unit.torque for unit in units],
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
    """Compare a run with a reference in stretches of `BLOCK` rows.

    A torque that a sampled master holds over a step is in the row at the step's end. The continuous reference has it
    at every time, so it is compared with the reference a substep before, when it was calculated.

    Returns
    -------
    dict
        Largest absolute differences of link positions [rad or m] and control torques, link-side [N m or N].
    dict
        Largest relative differences of a joint between the RMS errors of the run and of the reference, for loops whose
        single solutions separate, see `vdfmu.study.run.scenario_run`. Errors as in :func:`tracking_errors`.
    """
    if robot is None or compared(results, robot) is None:
        return _compare_all(results, reference), {}
    name, at, position, torque, held = "", 0.0, -1.0, 0.0, None
    squares = np.zeros((4, robot.n))  # errors of position and torque, ours and theirs
    for part, solution in zip(results.blocks(BLOCK), reference, strict=True):
        q_d, q = part["trajectory.q_d"], part["plant.q"]
        tau, tau_m = part["controller.tau"], part["feedforward.tau_m"]
        name, tau_m_r = solution.name, solution["feedforward.tau_m"]
        q_r, tau_r = solution["plant.q"], solution["controller.tau"]
        if name == "continuous":
            tau_r, held = _earlier(tau_r, held, substeps), tau_r[-1:]
        difference = np.abs(q - q_r).max(axis=1)
        if difference.max() > position:
            at, position = float(part.time[difference.argmax()]), float(difference.max())
        torque = max(torque, float(np.abs(robot.ell * (tau - tau_r)).max()))
        errors = [q_d - q, q_d - q_r, tau - tau_m, tau_r - tau_m_r]
        squares += np.sum(np.square(errors), axis=1)
    found = {"name": name, "max_position_difference_rad": position, "max_torque_difference_nm": torque, "at_s": at}
    rms = np.sqrt(squares / len(results))
    separate = (np.abs(rms[::2] - rms[1::2]) / np.maximum(rms[1::2], np.finfo(float).tiny)).max(axis=1)
    return found, {"rms_position_difference": float(separate[0]), "rms_torque_difference": float(separate[1])}


def _compare_all(results: Results, reference: Iterable[Reference]) -> dict[str, Any]:
    """Return the largest absolute difference of every output."""
    found: dict[str, float] = {}
    groups = {signal.partition("[")[0] for signal in results.names}
    name = ""
    for part, solution in zip(results.blocks(BLOCK), reference, strict=True):
        name = solution.name
        for signal, rows in solution.signals.items():
            if signal in groups:
                values = part[signal].reshape(rows.shape)
                found[signal] = max(found.get(signal, 0.0), float(np.abs(values - rows).max()))
    return {"name": name, "max_difference": found}


def estimation_errors(results: Results, substeps: int) -> dict[str, Any]:
    """RMS of the spring torque and of the estimates' errors, link-side [N m or N].

    A sampled master gives the estimator the plant's signals a substep before, when its step began, and the torque that
    the step that ended there had.
    """
    late, squares, before = min(1, substeps), 0.0, None
    for part in results.blocks(BLOCK):
        true = part["plant.tau_s"]
        rows = slice(late if before is None else 0, None)  # in the first block
        seen, before = _earlier(true, before, substeps)[rows], true[-1:]
        errors = [part[f"estimator.{name}"][rows] - seen for name in _ESTIMATES]
        squares = squares + np.sum(np.square([seen, *errors]), axis=1)
    rms = np.sqrt(squares / (len(results) - late)).tolist()
    return dict(zip(("rms_spring_torque_nm", *(f"rms_{n}_error_nm" for n in _ESTIMATES)), rms, strict=True))


def _earlier(rows: Floats, before: Floats | None, substeps: int) -> Floats:
    """Return the values a substep earlier, on lines through the rows; `before` is the row before the first."""
    lag = 1.0 / substeps if substeps else 0.0
    return (1.0 - lag) * rows + lag * np.vstack([rows[:1] if before is None else before, rows[:-1]])
