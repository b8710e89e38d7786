"""Loading of scenarios and systems by name or path."""

from __future__ import annotations

import os
from dataclasses import replace
from pathlib import Path
from typing import Any

from vdfmu.arm.robot.robot import Robot
from vdfmu.arm.robot.robot_file import load_robot, robot_from_dict
from vdfmu.base.errors import ModelError, UsageError
from vdfmu.base.toml_file import locate, read_toml, toml_names
from vdfmu.base.toml_tables import Problems
from vdfmu.system.scenario.scenario import Scenario
from vdfmu.system.scenario.scenario_file import read_scenario
from vdfmu.system.scenario.system_file import SystemFile, read_system_file


def scenario_names() -> list[str]:
    """Return the names of the scenarios that travel with the package."""
    return toml_names("scenarios")


def load_scenario(path_or_name: str | os.PathLike[str], robot: Robot | str | None = None) -> Scenario:
    """Load a scenario by the name of a shipped one or by the path of a TOML file.

    Parameters
    ----------
    path_or_name : str or path
        See `load_robot`. A relative path of a robot in the file starts at the file's folder.
    robot : Robot, str or None
        Robot instead of the one that the file names, or of none where a component takes it; a str as for `load_robot`.
        The paper's numbers are left out where it has other numbers than the file's.

    Returns
    -------
    Scenario

    Raises
    ------
    UsageError
        If no shipped scenario, or robot given here, has the name; for a robot that neither file nor components have use
        for.
    ModelError
        If the scenario or its robot has problems; it lists every one of both files.
    """
    path = locate(path_or_name, "scenarios")
    data = read_toml(path, "scenarios")
    problems = Problems(str(path))
    written = data.get("robot")
    if isinstance(robot, str):
        robot = load_robot(robot)
    named: Robot | None = None
    others = Problems(str(path))
    if (robot is None or "paper" in data) and isinstance(written, str) and written:
        try:
            located = locate(written, "robots", path.parent)
            named = robot_from_dict(read_toml(located, "robots"), str(located))
        except (ModelError, UsageError) as error:
            if robot is None:
                others.take(error, "robot")
    if robot is not None and (named is None or _numbers(robot) != _numbers(named)):
        data.pop("paper", None)
    system: SystemFile | None = None
    wired = data.get("system", "system")
    if isinstance(wired, str) and wired:
        try:
            system = load_system(wired, path.parent)
        except (ModelError, UsageError) as error:
            others.take(error, "system")
    scenario = read_scenario(problems, data, robot or named, system)
    problems.lines += others.lines
    problems.raise_any()
    assert scenario is not None  # else there are problems
    if robot is not None and "robot" not in data and not scenario.resolved.takers:
        raise UsageError(f"robot: expected none for {path}, no component of which takes one, got {robot.name}.")
    return scenario if str(path_or_name) in scenario_names() else replace(scenario, file=str(path))


def _numbers(robot: Robot) -> dict[str, Any]:
    """Return what of a robot a result depends on."""
    texts = ("name", "description", "sources")
    return {key: value for key, value in robot.to_dict(looks=False).items() if key not in texts}


def load_system(
    path_or_name: str | os.PathLike[str], start: Path | None = None, extending: tuple[Path, ...] = ()
) -> SystemFile:
    """Load a system by the name of a shipped one or by the path of a TOML file.

    Parameters
    ----------
    path_or_name : str or path
        See `load_robot`.
    start : Path, optional
        Folder at which a relative path starts.
    extending : tuple of Path, optional
        Files that extend it.

    Raises
    ------
    UsageError
        If no shipped system has the name.
    ModelError
        If the file cannot be used; it lists every problem.
    """
    path = locate(path_or_name, "systems", start)
    data = read_toml(path, "systems")
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
