"""The layout of a scenario file: from its tables to a `Scenario`, with every problem noted."""

from __future__ import annotations

import dataclasses
import math
from pathlib import Path
from typing import Any

import numpy as np

from vdfmu.engine.algorithms import ALGORITHMS, CONTINUOUS
from vdfmu.errors import ModelError
from vdfmu.model.parameters import PARAMETERS, Array, read_only
from vdfmu.model.read import FloatArray, Problems, Table, as_number, shape_of, shown
from vdfmu.model.robot import FRICTION_ARRANGEMENTS, Robot
from vdfmu.model.robot_file import check_robot
from vdfmu.scenario.check import check_step
from vdfmu.scenario.scenario import (
    FACTOR_FIELDS,
    KINDS,
    MODES,
    VELOCITIES,
    Controller,
    Feedforward,
    Scenario,
    Trajectory,
    apply_factors,
)
from vdfmu.scenario.system_file import SystemFile
from vdfmu.unit.base import SOLVER_TOLERANCE

SCENARIO_KEYS = (
    "name",
    "description",
    "kind",
    "system",
    "robot",
    "friction",
    "stop",
    "step",
    "master",
    "adaptive",
    "tolerance",
    "inputs",
    "input_hold",
    "trajectory",
    "feedforward",
    "controller",
    "plant_factors",
    "paper",
)
PAPER_LISTS = (
    "rms_position_error_deg",
    "max_position_error_deg",
    "rms_torque_compensation_error_nm",
    "rms_torque_difference_nmm",
)


def read_scenario(
    problems: Problems, data: object, robot: Robot | None, system: SystemFile | None
) -> Scenario | None:
    """Read a scenario file's content.

    Parameters
    ----------
    problems : Problems
        Where problems are noted.
    data : object
        The content of the file.
    robot : Robot or None
        The nominal robot; None if it could not be loaded, which lets the rest be read all the same.
    system : SystemFile or None
        The same.

    Returns
    -------
    Scenario or None
        None if there are problems.
    """
    components = tuple(system.parts) if system is not None else ()
    # the sections of these units are read here; those of any other unit, also of one in their place, by its variables
    of_package = ("trajectory", "feedforward", "controller")
    ours = [u for u in of_package if system is None or (u in components and system.parts[u].unit == u)]
    file = Table(problems, data, "", (*SCENARIO_KEYS, *components))
    n = robot.n if robot is not None else None
    name = file.name("name")
    description = file.text("description", "")
    kind = file.text("kind", choices=KINDS)
    file.text("system", "system")
    sections = {
        name: file.optional_table(name, list(file.data.get(name, {}))).data
        for name in components
        if name in file.data and (name not in SCENARIO_KEYS or name not in ours)
    }
    robot_name = file.text("robot")
    if "friction" in file.data:
        friction = file.text("friction", choices=FRICTION_ARRANGEMENTS)
        robot = robot and dataclasses.replace(robot, friction=friction)
    stop = file.number("stop", "s", above=0, way_out="Give the end of the run.")
    step = file.number("step", "s", above=0, way_out="Give the communication step.")
    check_step(problems, stop, step)
    master = file.text("master", "gauss-seidel", ALGORITHMS)
    adaptive = _adaptive(file, master)
    way_out = f"{SOLVER_TOLERANCE:g} is a good start."
    tolerance = file.number("tolerance", "", SOLVER_TOLERANCE, above=0, way_out=way_out)
    if tolerance >= 1:
        problems.add("tolerance", "a relative tolerance < 1", shown(tolerance), way_out)
    inputs = Path(problems.where).parent / file.text("inputs") if "inputs" in file.data else None
    input_hold = file.flag("input_hold", False)
    open_loop = kind == "contrast"
    trajectory = _trajectory(file, n, "trajectory" in ours or open_loop)
    feedforward = _feedforward(
        file, n, "feedforward" not in ours or open_loop and "feedforward" not in file.data
    )
    controller = _controller(file, n, "controller" not in ours or open_loop and "controller" not in file.data)
    factors = _factors(file.optional_table("plant_factors", FACTOR_FIELDS), n)
    paper = _paper(file.optional_table("paper", ("source", *PAPER_LISTS)), n)
    if robot is not None and robot.limits:
        for key in ("q_start", "q_end"):
            q = getattr(trajectory, key)
            for i in np.flatnonzero((q < robot.q_min) | (q > robot.q_max)):
                expected = f"a position of joint {i + 1} from {robot.q_min[i]:g} to {robot.q_max[i]:g}"
                problems.add(f"trajectory.{key}", expected, f"{q[i]:g}", "The robot has end stops there.")
    if robot is not None and not problems.lines:
        try:
            check_robot(apply_factors(robot, factors), f"{problems.where}: plant_factors: the plant")
        except ModelError as error:
            problems.lines.extend(error.problems)
    if robot is None or system is None or problems.lines:
        return None
    return Scenario(
        name=name,
        description=description,
        kind=kind,
        system=system,
        robot=robot,
        robot_name=robot_name,
        stop=stop,
        step=step,
        master=master,
        adaptive=adaptive,
        tolerance=tolerance,
        trajectory=trajectory,
        feedforward=feedforward,
        controller=controller,
        plant_factors=factors,
        sections=sections,
        paper=paper,
        inputs=inputs,
        input_hold=input_hold,
    )


def _adaptive(file: Table, master: str) -> float | None:
    """Read the error control of the communication step; no key means none."""
    if "adaptive" not in file.data:
        return None
    error = file.number("adaptive", "", above=0)
    if error >= 1:
        file.problems.add("adaptive", "a relative error < 1", shown(error), "1e-6 is a good start.")
    if master in ALGORITHMS and master not in CONTINUOUS:
        file.problems.add(
            "adaptive",
            f"master = {' or '.join(repr(name) for name in CONTINUOUS)}",
            repr(master),
            "Sampled control has a fixed step: leave adaptive out, or choose another master.",
        )
    return error


def _trajectory(file: Table, n: int | None, present: bool) -> Trajectory:
    """Read [trajectory]; without that unit nothing moves."""
    if not present:
        none = read_only(np.zeros(n or 1))
        return Trajectory(none, none, 1.0, 0.0)
    table = file.table("trajectory", ("q_start", "q_end", "T", "t_start"))
    return Trajectory(
        q_start=_per_joint(table, "q_start", n, "rad, or m", at_most=PARAMETERS["q_max"].largest),
        q_end=_per_joint(table, "q_end", n, "rad, or m", at_most=PARAMETERS["q_max"].largest),
        T=table.number("T", "s", above=0, at_least=1e-6, way_out="Give the duration of the motion."),
        t_start=table.number("t_start", "s", 0.0, at_least=0),
    )


def _feedforward(file: Table, n: int | None, absent: bool) -> Feedforward:
    """Read [feedforward]; without the closed loop, or that unit, it may be missing, and its gains are 0."""
    if absent:
        none = read_only(np.zeros(n or 1))
        return Feedforward("inverse", none, none, none, none)
    table = file.table("feedforward", ("mode", "Lambda", "K_V", "k_vq", "k_vkappa"))
    return Feedforward(
        mode=table.text("mode", "inverse", MODES),
        Lambda=_per_joint(table, "Lambda", n, "1/s", at_least=0),
        K_V=_per_joint(table, "K_V", n, "", at_least=0),
        k_vq=_per_joint(table, "k_vq", n, "N.m.s/rad, motor side", at_least=0),
        k_vkappa=_per_joint(table, "k_vkappa", n, "N.m.s/rad, motor side", at_least=0),
    )


def _controller(file: Table, n: int | None, absent: bool) -> Controller:
    """Read [controller]; without the closed loop, or that unit, it may be missing, and its gains are 0."""
    if absent:
        none = read_only(np.zeros(n or 1))
        return Controller(none, none, read_only(np.full(n or 1, math.inf)), "kappa_dot")
    table = file.table("controller", ("K_p", "K_v", "tau_max", "velocity"))
    return Controller(
        K_p=_per_joint(table, "K_p", n, "N.m/rad, link side", at_least=0),
        K_v=_per_joint(table, "K_v", n, "N.m.s/rad, link side", at_least=0),
        tau_max=_per_joint(table, "tau_max", n, "N.m, motor side", math.inf, above=0, infinite=True),
        velocity=table.text("velocity", "kappa_dot", VELOCITIES),
    )


def _per_joint(
    table: Table, key: str, n: int | None, unit: str, default: float | None = None, **rules: Any
) -> Array:
    """Read one number for each joint, or one for all; of an unknown n, as many as there are."""
    length = n or (shape_of(table.data.get(key)) or (1,))[0]
    way_out = f"The robot has {n} joints." if n else ""
    return read_only(table.numbers(key, (length,), unit, default, scalar=True, way_out=way_out, **rules))


def _factors(table: Table, n: int | None) -> dict[str, Array | float]:
    factors: dict[str, Array | float] = {}
    for key, value in table.data.items():
        if key not in FACTOR_FIELDS:
            continue  # noted by the table
        if as_number(value) is not None or not PARAMETERS[key].per_joint:
            factors[key] = table.number(key, "", above=0, way_out="A factor of 1 changes nothing.")
        else:
            factors[key] = _per_joint(table, key, n, "", above=0)
    return factors


def _paper(table: Table, n: int | None) -> dict[str, Any]:
    """Read [paper]: lists that start at joint 1 and may end before joint n."""
    paper: dict[str, Any] = {}
    for key, value in table.data.items():
        if key == "source":
            paper[key] = table.text("source")
        elif key in PAPER_LISTS:
            length = (shape_of(value) or (0,))[0]
            most = n or length
            numbers: FloatArray = table.numbers(key, (max(1, min(length, most)),), "", at_least=0)
            paper[key] = numbers.tolist()
    return paper
