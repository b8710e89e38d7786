"""Loading of robots by name or path."""

from __future__ import annotations

import dataclasses
import os
from pathlib import Path

from vdfmu.arm.robot.robot import Robot
from vdfmu.arm.robot.robot_file import robot_from_dict
from vdfmu.base.toml_file import locate, read_toml, shipped_names, toml_names


def robot_names() -> list[str]:
    """Return the names of the robots that travel with the package."""
    return toml_names("robots")


def load_robot(path_or_name: str | os.PathLike[str]) -> Robot:
    """Load a robot by the name of a shipped one or by the path of a TOML file.

    Parameters
    ----------
    path_or_name : str or path
        A value with a path separator, one that ends in ``.toml`` and the name of an existing file are paths.

    Returns
    -------
    Robot

    Raises
    ------
    UsageError
        If no shipped robot has the name.
    ModelError
        If the file cannot be read or describes no physical robot; it lists every problem.
    """
    path = locate(path_or_name, "robots")
    robot = robot_from_dict(read_toml(path, "robots"), str(path))
    shipped = str(path_or_name) in shipped_names("robots") and path != Path(path_or_name)
    return robot if shipped else dataclasses.replace(robot, file=str(path_or_name))
