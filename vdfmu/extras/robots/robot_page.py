"""The page of a robot: sliders of its joints, the pose of its end effector, its frames, masses and modes."""

from __future__ import annotations

import math
import os
from html import escape
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from vdfmu.arm.robot import Robot
from vdfmu.base.arrays import Floats
from vdfmu.base.errors import UsageError, VdfmuError
from vdfmu.base.files import require_ours, write_whole
from vdfmu.base.measure import JOINT_TYPES, unit_of
from vdfmu.base.page import page
from vdfmu.extras.robots.robot_shapes import centres, inertia_parts, mesh_parts
from vdfmu.study.analysis.modes import MOTORS, Modes, middle_pose, natural_modes
from vdfmu.study.report.scripts import data_element, libraries, look, packed, scripts_of
from vdfmu.study.report.shapes import Chain, drawing_of, own_shapes
from vdfmu.study.run.scene import arm_of


def write_robot_page(
    robot: Robot,
    path: str | os.PathLike[str],
    *,
    pose: npt.ArrayLike | None = None,
    folder: str | os.PathLike[str] | None = None,
) -> list[str]:
    """Write the page of a robot: one HTML file that works without a network.

    Sliders move each joint between its limits. The page shows the pose of the end effector and optionally frames,
    centres of mass and ellipsoids of inertia. It lists the natural modes at the start pose and animates them.

    Parameters
    ----------
    robot : Robot
    path : str or path
        The page. Only a file that vdfmu wrote is replaced.
    pose : (n,) [rad or m], optional
        Start pose. By default each joint is at 0, or in the middle between limits that exclude 0.
    folder : str or path, optional
        Folder of the robot's meshes. Without it the page draws no meshes.

    Returns
    -------
    list of str
        Notes on missing parts of the page; the page also shows them.

    Raises
    ------
    UsageError
        If the pose does not fit the joints, or if the file exists and was not written by vdfmu.
    VdfmuError
        If the file cannot be written.

    Examples
    --------
    >>> write_robot_page(vdfmu.load_robot("panda_7dof"), "panda.html")
    []
    """
    path = Path(path)
    require_ours(path)
    content, notes = robot_page(robot, pose, None if folder is None else Path(folder))
    write_whole(path, [content])
    return notes


def robot_page(robot: Robot, pose: npt.ArrayLike | None, folder: Path | None) -> tuple[bytes, list[str]]:
    """Return the page and the notes of `write_robot_page`."""
    low, high = _ranges(robot)
    q = _start(robot, pose, low, high)
    ellipsoids, notes = inertia_parts(robot)
    meshes, unread = mesh_parts(robot, folder)
    notes += unread
    modes: dict[str, list[dict[str, Any]]] = {}
    try:
        for motors in MOTORS:
            of_motors = natural_modes(robot, q, motors=motors)
            modes[motors] = [mode_facts(of_motors, k) for k in range(len(of_motors.frequency))]
    except VdfmuError as error:
        notes.append(f"The modes cannot be calculated: {error}")
    arm = arm_of(robot, {})
    drawing = drawing_of(arm, np.maximum(np.abs(low), np.abs(high)))
    if meshes:
        drawing["parts"] = [*meshes, *(part.plain() for part in own_shapes([v.to_dict() for v in robot.visuals]))]
    frames = {
        "time": packed(np.zeros(1), "<f8"),
        "q": packed(q[:, None], "<f4"),
        "recipes": {"q": [[1.0, []]] * robot.n},
    }
    facts = {
        "sliders": [_slider(robot.joint_types[i], *ends) for i, ends in enumerate(zip(low, high, q, strict=True))],
        "limits": robot.limits,
        "modes": modes,
        "weightless": Chain(arm).weightless,
        "centres": [[body, p.tolist()] for body, p in centres(robot)],
        "ellipsoids": [part.plain() for part in ellipsoids],
    }
    run = {"name": robot.name, "arm": drawing, "frames": frames, "figures": [], "signals": []}
    items = "".join(f"<li>{escape(note)}</li>" for note in notes)
    body = "\n".join(
        [
            '<div class="bench"><section id="arm" class="card" aria-label="The arm in 3D"></section><div class="side">',
            '<section id="joints" class="card" aria-label="Joints"></section>',
            '<section id="modes" class="card" aria-label="Modes"></section>' if modes else "",
            "</div></div>",
            f'<section class="card"><h2>Notes</h2><ul>{items}</ul></section>' if notes else "",
            "<noscript><p>The arm needs scripts. Allow scripts in this browser.</p></noscript>",
            data_element({"runs": [run], "robot": facts}),
            libraries(),
        ]
    )
    about = robot.description or f"A robot of {robot.n} joints"
    return page(robot.name, about, body, 92, look(), scripts=scripts_of("robot")), notes


def _ranges(robot: Robot) -> tuple[Floats, Floats]:
    """Return the smallest and the largest position of each slider: (n,) [rad or m]."""
    if robot.limits:
        return robot.q_min, robot.q_max
    most = np.array([JOINT_TYPES[kind].travel for kind in robot.joint_types])
    return -most, most


def _start(robot: Robot, pose: npt.ArrayLike | None, low: Floats, high: Floats) -> Floats:
    """Return the start pose, (n,) [rad or m]; UsageError if it does not fit the robot."""
    q = np.array(middle_pose(robot) if pose is None else pose, dtype=np.float64)
    if q.shape != (robot.n,):
        raise UsageError(f"pose must have {robot.n} numbers, one for each joint of {robot.name}, got {q.size}.")
    for i, kind in enumerate(robot.joint_types):
        if not low[i] <= q[i] <= high[i]:
            limits = f"{low[i]:.4g} to {high[i]:.4g} {unit_of('position', kind)}"
            raise UsageError(f"pose: joint {i + 1} must be at {limits}, got {q[i]:g}.")
    return q


def _slider(kind: str, low: float, high: float, q: float) -> dict[str, Any]:
    """Return the ends and start of a joint's slider, to a tenth of its unit within the limits."""
    unit = JOINT_TYPES[kind].shown
    ends = [math.ceil(10.0 * unit.factor * low) / 10.0, math.floor(10.0 * unit.factor * high) / 10.0]
    return {"unit": unit.unit, "factor": unit.factor, "low": ends[0], "high": ends[1], "start": q}


def mode_facts(modes: Modes, k: int) -> dict[str, Any]:
    """Return the page's facts of mode k: real and imaginary parts of its shape, scaled to a largest length of 1."""
    shape = modes.links[k]
    shape = shape / (float(np.abs(shape).max()) or 1.0)
    joint = int(modes.joint[k])
    return {
        "frequency": float(modes.frequency[k]),
        "damping": float(modes.damping[k]),
        "joint": joint + 1,
        "share": float(modes.share[k, joint]),
        "real": shape.real.tolist(),
        "imaginary": shape.imag.tolist(),
    }
