"""Converts the file of another tool to a robot file."""

from __future__ import annotations

import os
import tomllib
from dataclasses import replace
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt

from vdfmu.arm.robot.plausible import joints_without_tool, robot_notes
from vdfmu.arm.robot.robot import Robot
from vdfmu.arm.robot.robot_file import robot_from_dict
from vdfmu.base.errors import ModelError, SspError, UsageError
from vdfmu.base.option import checks_types
from vdfmu.base.toml_file import read_bytes
from vdfmu.base.toml_tables import Problems, as_number
from vdfmu.engine.package.parse import parse_xml
from vdfmu.extras.robots.chain import choose_arm
from vdfmu.extras.robots.drives import drive_joints, read_drives
from vdfmu.extras.robots.mjcf import read_mjcf
from vdfmu.extras.robots.tool import read_placement
from vdfmu.extras.robots.tree import with_inertia
from vdfmu.extras.robots.urdf import read_urdf
from vdfmu.extras.robots.write import robot_text

_LARGEST = 2**26
"""Largest file [byte]."""

Path_ = str | os.PathLike[str]


class Imported(NamedTuple):
    """A robot, the text of its robot file, and notes on the import."""

    robot: Robot
    text: str
    notes: list[str]


@checks_types
def robot_from_urdf(
    path: str | os.PathLike[str],
    base: str | None = None,
    tip: str | None = None,
    drives: str | os.PathLike[str] | None = None,
    density: float | None = None,
    tool: npt.ArrayLike | None = None,
    tool_frame: str | None = None,
) -> Robot:
    """Return an arm from a URDF, with drives from a file or assumed ones.

    Parameters
    ----------
    path : path
        The URDF.
    base : str, optional
        Fixed link, whose frame is {I}; default the root of the file.
    tip : str, optional
        Last link of the arm; needed if the file has more than one arm. Joints that are not part of the arm are held at
        0. A tip that is fixed to the last moving link is the end effector's frame {O}. Without such a frame, {O} is at
        the far end of the last link's shape, with the axes of that link, or at the link's origin if its shape cannot be
        read.
    drives : path, optional
        TOML file with the drives, by names of joints.
    density : float [kg/m3], optional
        Density of boxes, cylinders and spheres, for bodies without mass or inertia.
    tool : (3,) or (6,) array, optional
        Origin of {O} in the frame of the tip [m], and roll, pitch and yaw [rad], instead of the rules of `tip`.
    tool_frame : str, optional
        Link that is both the tip and {O}, instead of the rules of `tip`.

    Returns
    -------
    Robot

    Raises
    ------
    ModelError
        With every problem found.
    """
    return import_robot(path, base, tip, drives, density, tool=tool, tool_frame=tool_frame, kind="robot").robot


@checks_types
def robot_from_mjcf(
    path: str | os.PathLike[str],
    base: str | None = None,
    tip: str | None = None,
    drives: str | os.PathLike[str] | None = None,
    tool: npt.ArrayLike | None = None,
    tool_frame: str | None = None,
) -> Robot:
    """Return an arm from a MuJoCo file, whose root is the world. Needs the package mujoco.

    Parameters
    ----------
    path, base, tip, drives, tool, tool_frame
        See :func:`robot_from_urdf`, with its errors. `tool_frame` may be a site.

    Returns
    -------
    Robot
    """
    return import_robot(path, base, tip, drives, tool=tool, tool_frame=tool_frame, kind="mujoco").robot


def import_robot(
    path: Path_,
    base: str | None = None,
    tip: str | None = None,
    drives: Path_ | None = None,
    density: float | None = None,
    *,
    tool: npt.ArrayLike | None = None,
    tool_frame: str | None = None,
    out: Path_ | None = None,
    kind: str = "",
) -> Imported:
    """Make a robot file from a URDF or a MuJoCo file; see :func:`robot_from_urdf`.

    Paths of meshes are relative to the robot file `out`, by default in the folder of `path`. `kind` is the required
    root element, "robot" or "mujoco", by default either.
    """
    path = Path(path)
    if density is not None and not 0.0 < (as_number(density) or 0.0) < np.inf:
        raise UsageError(f"density: expected a number above 0 in kg/m3, got {density!r}.")
    if tool_frame is not None and (tool is not None or tip is not None):
        raise UsageError("tool_frame: cannot be combined with tool or tip, because it sets both. Omit tool and tip.")
    place = read_placement(np.zeros(3) if tool is None else tool) if tool is not None or tool_frame else None
    root = parse_file(path)
    problems = Problems(str(path))
    if root.tag not in ("robot", "mujoco") or kind not in ("", root.tag):
        expected = f"<{kind}>" if kind else "<robot> of a URDF or <mujoco> of an MJCF"
        raise ModelError(f"{path}: expected {expected}, got <{root.tag}>. Is it the right file?")
    tree = read_urdf(root, path, problems) if root.tag == "robot" else read_mjcf(path, problems, tool_frame is not None)
    try:
        arm = choose_arm(tree, base, tool_frame or tip, place)
    except RecursionError:
        raise ModelError(f"{path}: expected a chain of at most a few hundred links. Is it one robot?") from None
    problems.raise_any()
    assert arm is not None
    gravity = float(np.linalg.norm(tree.gravity))
    chosen = read_drives(None if drives is None else Path(drives), arm.bodies, problems)
    arm = replace(arm, bodies=with_inertia(arm.bodies, chosen, density, path.name, tree))
    problems.raise_any()
    driven = drive_joints(arm.bodies, path.name, chosen, gravity)
    folder = Path(out).parent if out is not None else path.parent
    text = robot_text(tree.name, path.name, arm, driven, folder)
    robot = robot_from_dict(tomllib.loads(text), f"{path}: the arm to {arm.tip}")
    if arm.tool.chosen and joints_without_tool(robot) == [robot.n]:
        text = robot_text(tree.name, path.name, arm, driven, folder, on_axis=True)
        robot = replace(robot, tool_on_last_axis=True)
    on_axis = ", on the axis of the last joint" * robot.tool_on_last_axis
    return Imported(robot, text, [f"the tool is {arm.tool.rule}{on_axis}", *tree.notes, *robot_notes(robot)])


def parse_file(path: Path) -> Any:
    """Return the root element of an XML file; ModelError for other files or elements of xacro."""
    data = read_bytes(path, "a URDF or MJCF file", _LARGEST)
    try:
        root = parse_xml(data, str(path))
    except SspError as error:
        raise ModelError(error.problems) from None
    if root.nsmap.get("xacro") and next(root.iter(f"{{{root.nsmap['xacro']}}}*"), None) is not None:
        plain = f"{path.stem.removesuffix('.urdf')}.urdf"
        plain = f"{path.stem}_plain.urdf" if plain == path.name else plain  # the shell first empties the file after >
        raise ModelError(
            f"{path}: expected a URDF, got one with xacro's elements. Write the URDF first: xacro {path.name} > {plain}"
        )
    return root
