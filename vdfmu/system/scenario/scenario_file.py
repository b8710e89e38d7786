"""Loads scenarios and systems by name or path, and reads scenario files."""

from __future__ import annotations

import dataclasses
import os
from contextlib import suppress
from dataclasses import replace
from pathlib import Path
from typing import Any, cast

import numpy as np

from vdfmu.arm.motion import read_motion, rest
from vdfmu.arm.robot import (
    FRICTION_ARRANGEMENTS,
    DriveFile,
    Robot,
    check_robot,
    load_robot,
    robot_from_dict,
    section_numbers,
)
from vdfmu.arm.robot.parameters import PARAMETERS, read_only, section
from vdfmu.base.arrays import Floats
from vdfmu.base.errors import ModelError, UnitError, UsageError
from vdfmu.base.option import checks_types
from vdfmu.base.toml_file import locate, read_toml, toml_names
from vdfmu.base.toml_tables import Problems, Table, as_number, shape_of, value_text
from vdfmu.compiler.unit.declaration import SOLVER_TOLERANCE
from vdfmu.engine.algorithms import ALGORITHMS, DEFAULT, named
from vdfmu.engine.plan.grid import count_steps
from vdfmu.system.scenario.replace import started, with_starts
from vdfmu.system.scenario.scenario import FACTOR_FIELDS, ROBOT_WAY_OUT, Scenario, apply_factors, resolve
from vdfmu.system.scenario.system_file import SystemFile, read_system_file
from vdfmu.system.scenario.values import section_values


def scenario_names() -> list[str]:
    """Return the names of the shipped scenarios."""
    return toml_names("scenarios")


@checks_types
def load_scenario(path_or_name: str | os.PathLike[str], robot: Robot | str | None = None) -> Scenario:
    """Load a scenario by the name of a shipped one or by the path of a TOML file.

    Parameters
    ----------
    path_or_name : str or path
        See `load_robot`. The path of a robot in the file is relative to the file's folder.
    robot : Robot, str or None
        Robot that replaces the one named in the file, or is used if the file names none; a str as for `load_robot`. The
        paper's numbers are omitted if the scenario then has other numbers than the file.

    Returns
    -------
    Scenario

    Raises
    ------
    UsageError
        If there is no shipped scenario, or robot, of the name; for a robot that neither the file nor a component uses.
    ModelError
        If the scenario or its robot has problems; it lists all problems of both files.
    """
    path = locate(path_or_name, "scenarios")
    data = read_toml(path)
    problems = Problems(str(path))
    written = data.get("robot")
    if isinstance(robot, str):
        robot = load_robot(robot)
    named: Robot | None = None
    elsewhere = Problems(str(path))
    if (robot is None or "paper" in data) and isinstance(written, str) and written:
        try:
            located = locate(written, "robots", path.parent)
            named = robot_from_dict(read_toml(located), str(located))
        except (ModelError, UsageError) as error:
            if robot is None:
                elsewhere.take(error, "robot")
    if robot is not None and (named is None or _numbers(robot) != _numbers(named)):
        data.pop("paper", None)
    system: SystemFile | None = None
    wired = data.get("system", "system")
    if isinstance(wired, str) and wired:
        try:
            system = load_system(wired, path.parent)
        except (ModelError, UsageError) as error:
            elsewhere.take(error, "system")
    scenario = read_scenario(problems, data, robot or named, system)
    problems.lines += elsewhere.lines
    problems.raise_any()
    assert scenario is not None  # otherwise there are problems
    if robot is not None and "robot" not in data and not scenario.resolved.takers:
        raise UsageError(f"robot: no component of {path} uses a robot, got {robot.name}. Leave the robot out.")
    return scenario if str(path_or_name) in scenario_names() else replace(scenario, file=str(path))


def _numbers(robot: Robot) -> dict[str, Any]:
    """Return the values of a robot on which results depend."""
    texts = ("name", "description", "sources")
    return {key: value for key, value in robot.to_dict(looks=False).items() if key not in texts} | robot.files


def load_system(
    path_or_name: str | os.PathLike[str], start: Path | None = None, extending: tuple[Path, ...] = ()
) -> SystemFile:
    """Load a shipped system by its name, or a system from a TOML file.

    A relative path is relative to the folder `start`. `extending` are the files that extend this one. UsageError for an
    unknown name, ModelError with all problems of the file.
    """
    path = locate(path_or_name, "systems", start)
    data = read_toml(path)
    problems = Problems(str(path))
    base: SystemFile | None = None
    if "extends" in data:
        if (here := path.resolve()) in extending:
            raise ModelError(f"{path}: extends: the files extend each other.")
        try:
            base = load_system(str(data["extends"]), path.parent, (*extending, here))
        except UsageError as error:
            problems.take(error, "extends")
    system = read_system_file(problems, data, path, base)
    problems.raise_any()
    return system


KEYS = {
    "name": "",
    "description": "",
    "system": "Which units, and how they are connected: a name or a TOML file",
    "robot": "A name or a TOML file, if a component needs a robot",
    "friction": "Arrangement of the friction, instead of the robot's",
    "stop": "End of the run [s]",
    "step": "Communication step [s]",
    "algorithm": "How the units are stepped",
    "adaptive": "Largest relative error of a coupled signal in a step",
    "tolerance": "Tolerance of the solvers",
    "inputs": "CSV file of signals for unconnected inputs",
    "input_hold": "Hold these signals until the next row",
    "payload": "",
    "joints": "File of a drive, and tables of its numbers, for all joints or for each",
    "motion": "Motion of the joints instead of (57), or the TOML file with it; each kind has its own keys",
    "plant_factors": "",
    "limits": "Limits of the verdict, such as margin = 0.3",
    "paper": "",
}
"""Keys of a scenario file, with a description if the name is not self-explanatory."""
ROBOT_KEYS = ("friction", "payload", "joints", "motion", "plant_factors", "paper")
"""Requirements of a scenario on its robot."""
PAPER_LISTS = ("rms_position_error_deg", "max_position_error_deg", "rms_torque_compensation_error_nm")


def read_scenario(problems: Problems, data: object, robot: Robot | None, system: SystemFile | None) -> Scenario | None:
    """Read a scenario file. None if it has problems. `robot`, `system`: None if omitted or wrong, the rest is read."""
    written = cast("dict[str, object]", data) if isinstance(data, dict) else {}
    if system is not None:
        with suppress(UsageError, UnitError):  # noted below
            system = with_starts(system)
    # sections of an unknown system may be right
    components = list(system.parts) if system is not None else [k for k, v in written.items() if isinstance(v, dict)]
    file = Table(problems, data, "", (*KEYS, *components))
    n = robot.n if robot is not None else None
    name = file.name("name")
    description = file.text("description", "")
    file.text("system", "system")
    sections: dict[str, Any] = {
        component: file.optional_table(component).data
        for component in components
        if component in file.data and component not in KEYS
    }
    unnamed = robot is None and "robot" not in file.data
    if "robot" in file.data:
        file.text("robot")
    for key in ROBOT_KEYS if unnamed else ():
        if key in file.data:
            problems.add(key, "a scenario with a robot for it", "none", f"{ROBOT_WAY_OUT} Or leave {key} out.")
    if "friction" in file.data:
        friction = file.text("friction", choices=FRICTION_ARRANGEMENTS)
        robot = robot and dataclasses.replace(robot, friction=friction)
    payload_known = True
    if "payload" in file.data:
        load = file.table("payload", [*(row.key for row in section("payload")), "known"])
        payload_known = load.flag("known", True)
        numbers = section_numbers(load, "payload")
        fixed = {key: read_only(number) for key, number in numbers.items()}
        robot = robot and dataclasses.replace(robot, payload=True, **fixed)
    if "joints" in file.data and robot is not None:
        robot = _with_drive(file.optional_table("joints"), robot)
    if "motion" in file.data and robot is not None and system is not None:
        system, sections = _moved(file, robot, system, sections)
    stop = file.number("stop", "s", above=0, fix="Give the end of the run.")
    step = file.number("step", "s", above=0, fix="Give the communication step.")
    if stop > 0 and step > 0:
        try:
            count_steps(step, stop)
        except UsageError as error:
            problems.take(error)
    algorithm = file.text("algorithm", DEFAULT, ALGORITHMS.names(file.data.get("algorithm", DEFAULT)))
    adaptive = _adaptive(file, algorithm)
    fix = f"{SOLVER_TOLERANCE:g} is a good start."
    tolerance = file.number("tolerance", "", SOLVER_TOLERANCE, above=0, fix=fix)
    if tolerance >= 1:
        problems.add("tolerance", "a relative tolerance < 1", value_text(tolerance), fix)
    inputs = Path(problems.where).parent / file.text("inputs") if "inputs" in file.data else None
    input_hold = file.flag("input_hold", False)
    factors = _factors(file.optional_table("plant_factors", FACTOR_FIELDS), n)
    paper = _paper(file.optional_table("paper", ("source", *PAPER_LISTS)), n)
    limits = (
        {key: file.table("limits", list(file.data["limits"])).number(key, "", above=0) for key in file.data["limits"]}
        if isinstance(file.data.get("limits"), dict)
        else {}
    )
    if (robot is not None or unnamed) and system is not None:
        try:
            section_values(resolve(system, robot), sections)
        except (UsageError, UnitError) as error:
            places = (str(system.path), problems.where)
            for line in str(error).splitlines():
                problems.lines.append(line if line.startswith(places) else f"{problems.where}: {line}")
    if robot is not None and not problems.lines:
        try:
            check_robot(apply_factors(robot, factors), f"{problems.where}: plant_factors: the plant")
        except ModelError as error:
            problems.take(error)
    if system is None or problems.lines:
        return None
    return Scenario(
        name=name,
        description=description,
        system=system,
        robot=robot,
        stop=stop,
        step=step,
        algorithm=algorithm,
        adaptive=adaptive,
        tolerance=tolerance,
        plant_factors=factors,
        sections=sections,
        paper=paper,
        inputs=inputs,
        input_hold=input_hold,
        payload_known=payload_known,
        limits=limits,
    )


def _moved(
    file: Table, robot: Robot, system: SystemFile, sections: dict[str, Any]
) -> tuple[SystemFile, dict[str, Any]]:
    """Return the system with the unit of a motion as its trajectory, and the sections with its start."""
    problems = file.problems
    if "trajectory" not in system.parts:
        expected = "a scenario whose system has a component trajectory"
        problems.add("motion", expected, ", ".join(system.parts), "Leave the motion out.")
        return system, sections
    motion = read_motion(problems, file.data["motion"], robot, Path(problems.where).parent)
    try:
        unit = (motion or rest(np.zeros(robot.n), 1.0)).unit()  # after a wrong motion, sections are still checked
    except UsageError as error:
        problems.take(error)
        return system, sections
    part = system.parts["trajectory"]._replace(unit=unit)
    system = dataclasses.replace(system, parts={**system.parts, "trajectory": part})
    return system, started(system, "trajectory", unit, sections)


def _with_drive(table: Table, robot: Robot) -> Robot:
    """Return a robot with the drive of a table [joints] and its numbers, each one for all joints or a list."""
    where = table.problems.where
    try:
        drive = DriveFile.read(table.text("drive"), Path(where).parent)
        data: dict[str, Any] = robot.to_dict() | {"drive": drive.name}
        for i, joint in enumerate(data["joints"]):
            for part in (key for key in table.data if key != "drive"):
                numbers = table.optional_table(part).data.items()
                joint[part] = {key: value[i] if isinstance(value, list) else value for key, value in numbers}
        return dataclasses.replace(robot_from_dict(data, where, {drive.name: drive.text}), file=robot.file)
    except IndexError:
        table.problems.add("joints", f"lists of {robot.n} numbers", "a shorter one", "Give a number for each joint.")
    except (ModelError, UsageError) as error:
        table.problems.take(error)
    return robot


def _adaptive(file: Table, algorithm: str) -> float | None:
    """Read the error control of the communication step, which is off by default."""
    if "adaptive" not in file.data:
        return None
    error = file.number("adaptive", "", above=0)
    if error >= 1:
        file.problems.add("adaptive", "a relative error < 1", value_text(error), "1e-6 is a good start.")
    if algorithm in ALGORITHMS and not ALGORITHMS[algorithm].continuous:
        fix = "Sampled control has a fixed step: leave adaptive out, or choose another algorithm."
        expected = f"algorithm = {' or '.join(map(repr, named(continuous=True)))}"
        file.problems.add("adaptive", expected, repr(algorithm), fix)
    return error


def _factors(table: Table, n: int | None) -> dict[str, Floats | float]:
    factors: dict[str, Floats | float] = {}
    for key, value in table.data.items():
        if key not in FACTOR_FIELDS:
            continue  # noted by the table
        if as_number(value) is not None or not PARAMETERS[key].per_joint:
            factors[key] = table.number(key, "", above=0, fix="A factor of 1 changes nothing.")
        else:
            length = n or (shape_of(value) or (1,))[0]  # with an unknown robot, any number of joints is allowed
            fix = f"The robot has {n} joints." if n else ""
            factors[key] = read_only(table.numbers(key, (length,), "", scalar=True, fix=fix, above=0))
    return factors


def _paper(table: Table, n: int | None) -> dict[str, Any]:
    """Read [paper]: lists that start at joint 1 and may end before joint n."""
    paper: dict[str, Any] = {}
    for key, value in table.data.items():
        if key == "source":
            paper[key] = table.text("source")
        elif key in PAPER_LISTS:
            length = (shape_of(value) or (0,))[0]
            paper[key] = table.numbers(key, (max(1, min(length, n or length)),), "", at_least=0).tolist()
    return paper
