"""The layout of a robot file: from its tables to a `Robot`, with every problem reported at once."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, cast

import numpy as np

from vdfmu.model.check import (
    LARGEST,
    check_drive,
    check_friction,
    check_inertia,
    check_rotation,
    check_stops,
)
from vdfmu.model.read import FloatArray, Problems, Table, nearest, shape_of, shown
from vdfmu.model.robot import (
    DRIVE_KEYS,
    FRICTION_ARRANGEMENTS,
    FRICTION_KEYS,
    GEOMETRY_KEYS,
    JOINT_FIELDS,
    JOINT_TYPES,
    LIMIT_KEYS,
    LINK_KEYS,
    Robot,
    joint_free,
    read_only,
    robot_argument,
)

ROBOT_KEYS = (
    "name", "description", "friction", "rotor_coupling", "gravity", "tool_offset", "payload", "joints", "sources",
)  # fmt: skip
JOINT_KEYS = ("type", *GEOMETRY_KEYS, "link", "drive", "friction", "limits")
SOURCE_KEYS = (
    "gravity",
    "tool_offset",
    *(f"payload.{key}" for key in LINK_KEYS),
    *(f"joints.{key}" for key in GEOMETRY_KEYS),
    *(f"joints.link.{key}" for key in LINK_KEYS),
    *(f"joints.drive.{key}" for key in DRIVE_KEYS),
    *(f"joints.friction.{key}" for key in FRICTION_KEYS),
    *(f"joints.limits.{key}" for key in LIMIT_KEYS),
)
# Key: (unit for a revolute joint, unit for a prismatic joint, bound, default, what is meant).
_NUMBERS: dict[str, tuple[str, str, dict[str, float], float | None, str]] = {
    "mass": ("kg", "kg", {"above": 0}, None, "Give the mass of the link."),
    "ell": ("", "rad/m", {"at_least": 1}, None, "Give the rotor angle for one unit of joint motion."),
    "I_m": ("kg.m2", "kg.m", {"above": 0}, None, "Give the rotor inertia times ell."),
    "K_f0": ("N.m/rad", "N/m", {"above": 0}, None, "Give the flexspline stiffness, link side."),
    "c_f": ("1/(N.m)", "1/N", {"above": 0}, None, "For a linear spring give a small value such as 1e-6."),
    "K_w0": ("N.m/rad", "N.m/rad", {"above": 0}, None, "Give the wave generator stiffness, motor side."),
    "c_w": ("1/(N.m)", "1/(N.m)", {"above": 0}, None, "For a linear spring give a small value such as 1e-3."),
    "theta_err_amplitude": (
        "rad",
        "m",
        {"at_least": 0},
        0.0,
        "Give 0 for none; shift the phase by pi for a sign.",
    ),
    "theta_err_phase": ("rad", "rad", {}, 0.0, ""),
    "f_c": ("N.m", "N", {"at_least": 0}, None, "Friction coefficients are not negative."),
    "f_s": ("N.m", "N", {"at_least": 0}, None, "Friction coefficients are not negative."),
    "f_v": ("N.m.s/rad", "N.s/m", {"at_least": 0}, None, "Friction coefficients are not negative."),
    "v_s": ("rad/s", "m/s", {"above": 0}, None, "For friction without the Stribeck effect set f_s = f_c."),
    "f_ck": ("N.m", "N.m", {"at_least": 0}, None, "Friction coefficients are not negative."),
    "eps": ("rad/s", "m/s", {"above": 0}, 1e-3, "It is the width of tanh(v/eps), which stands for sgn(v)."),
}
_LIMITS: dict[str, tuple[str, str, dict[str, float], str]] = {
    "q_min": ("rad", "m", {}, "Give the position of the lower end stop."),
    "q_max": ("rad", "m", {}, "Give the position of the upper end stop."),
    "stop_stiffness": ("N.m/rad", "N/m", {"above": 0}, "Give the stiffness of the end stops, link side."),
    "stop_damping": ("s/rad", "s/m", {"at_least": 0}, "Give 0 for stops without loss."),
    "tau_stall": ("N.m", "N.m", {"above": 0}, "Give the largest torque of the motor, motor side."),
    "kappa_dot_max": ("rad/s", "m/s", {"above": 0}, "Give the no-load speed of the motor divided by ell."),
}


def robot_from_dict(data: Mapping[str, Any], where: str = "robot") -> Robot:
    """Build a robot from the content of a robot file.

    Parameters
    ----------
    data : mapping
        The layout of a robot's TOML file; the inverse of `Robot.to_dict`.
    where : str
        What messages call the data.

    Raises
    ------
    ModelError
        With every problem found.
    """
    problems = Problems(where)
    file = Table(problems, data, "", ROBOT_KEYS)
    name = file.label("name")
    description = file.text("description", "")
    friction = file.text("friction", "lumped", FRICTION_ARRANGEMENTS)
    rotor_coupling = file.flag("rotor_coupling", True)
    gravity = file.numbers(
        "gravity", (3,), "m/s2", at_most=LARGEST["gravity"], way_out="Write +9.81 along the upward axis."
    )
    tool_offset = file.numbers("tool_offset", (3,), "m", np.zeros(3).tolist(), at_most=LARGEST["tool_offset"])
    payload = _payload(file) if "payload" in file.data else {}
    sources = _sources(file)
    joints = file.value("joints", "one table [[joints]] for each joint")
    if joints is not None and (not isinstance(joints, list) or not joints):
        got = shown(joints)
        problems.add(
            "joints",
            "one table [[joints]] for each joint",
            got,
            "Write [[joints]] in double brackets, at least once.",
        )
        joints = None
    read = [
        _joint(problems, joint, f"joints[{i}]") for i, joint in enumerate(cast("list[Any]", joints or []), 1)
    ]
    limits = any("limits" in joint for joint in read)
    for i, joint in enumerate(read, 1):
        if limits and "limits" not in joint:
            problems.add(
                f"joints[{i}].limits", "a table, as other joints have", "nothing", "Give it to all or none."
            )
    problems.raise_any()
    optional: dict[str, Any] = payload | {"limits": limits}
    optional |= {
        key: read_only([joint["limits"][key] if limits else 0.0 for joint in read]) for key in LIMIT_KEYS
    }
    return Robot(
        name=name,
        description=description,
        joint_types=tuple(cast(str, joint["type"]) for joint in read),
        **{key: read_only([joint[key] for joint in read]) for key in JOINT_FIELDS},
        gravity=read_only(gravity),
        tool_offset=read_only(tool_offset),
        friction=friction,
        rotor_coupling=rotor_coupling,
        sources=sources,
        **optional,
    )


def check_robot(robot: Robot, where: str = "") -> Robot:
    """Return the robot if it is physical, such as one from `Robot.with_parameters`.

    Raises
    ------
    ModelError
        With every problem found.
    """
    robot_argument(robot)
    robot_from_dict(robot.to_dict(), where or f"robot {robot.name}")
    return robot


def _joint(problems: Problems, data: object, path: str) -> dict[str, Any]:
    """Read one [[joints]] table: field of `Robot` to this joint's value."""
    table = Table(problems, data, path, JOINT_KEYS)
    joint: dict[str, Any] = {"type": table.text("type", choices=JOINT_TYPES)}
    joint["rotation"] = table.numbers("rotation", (3, 3), "", way_out="Its columns are the axes of B_i.")
    check_rotation(problems, table.key("rotation"), joint["rotation"])
    length = LARGEST["offset"]
    joint["offset"] = table.numbers(
        "offset", (3,), "m", at_most=length, way_out="It is the origin of B_i in B_(i-1)."
    )
    link = table.table("link", LINK_KEYS)
    joint["centroid"] = link.numbers(
        "centroid", (3,), "m", at_most=length, way_out="It is the centre of mass in B_i."
    )
    joint["inertia"] = _inertia(link)
    check_inertia(problems, link.key("inertia"), joint["inertia"])
    drive = table.table("drive", DRIVE_KEYS)
    friction = table.table("friction", FRICTION_KEYS)
    linear = int(joint["type"] == "prismatic")
    for key, (*units, bound, default, way_out) in _NUMBERS.items():
        group = link if key in LINK_KEYS else drive if key in DRIVE_KEYS else friction
        joint[key] = group.number(key, units[linear], default, **bound, at_most=LARGEST[key], way_out=way_out)
    if "limits" in table.data:
        joint["limits"] = _limits(table.table("limits", LIMIT_KEYS), linear)
    check_drive(problems, drive.path, joint["ell"], joint["theta_err_amplitude"])
    check_friction(problems, friction.path, joint["f_c"], joint["f_s"])
    return joint


def _limits(table: Table, linear: int) -> dict[str, float]:
    """Read [joints.limits] of one joint; its numbers are given together."""
    found = {
        key: table.number(key, units[linear], **bound, at_most=LARGEST[key], way_out=way_out)
        for key, (*units, bound, way_out) in _LIMITS.items()
    }
    check_stops(table.problems, table.path, found["q_min"], found["q_max"])
    return found


def _payload(file: Table) -> dict[str, Any]:
    """Read [payload]: field of `Robot` to its value; an inertia of 0, the default, is that of a point mass."""
    table = file.table("payload", LINK_KEYS)
    mass = table.number(
        "mass",
        "kg",
        at_least=0,
        at_most=LARGEST["mass"],
        way_out="Give 0 for none; it can be set at run time.",
    )
    centroid = table.numbers(
        "centroid",
        (3,),
        "m",
        np.zeros(3).tolist(),
        at_most=LARGEST["centroid"],
        way_out="It is the centre of mass in {O}.",
    )
    inertia = _inertia(table) if "inertia" in table.data else np.zeros((3, 3))
    if inertia.any():
        check_inertia(file.problems, table.key("inertia"), inertia)
    return {
        "payload": True,
        "payload_mass": read_only(mass),
        "payload_centroid": read_only(centroid),
        "payload_inertia": read_only(inertia),
    }


def _inertia(link: Table) -> FloatArray:
    """Read an inertia as 3 x 3 matrix, from one number, three principal moments or the matrix itself."""
    shape = shape_of(link.data.get("inertia"))
    way_out = "One number (isotropic), 3 principal moments or a symmetric 3 x 3 matrix will do."
    most = LARGEST["inertia"]
    if shape == (3, 3):
        return link.numbers("inertia", (3, 3), "kg.m2", at_most=most, way_out=way_out)
    if shape != () or "inertia" not in link.data:
        return np.diag(link.numbers("inertia", (3,), "kg.m2", at_most=most, way_out=way_out))
    return link.number("inertia", "kg.m2", at_most=most, way_out=way_out) * np.eye(3)


def _sources(file: Table) -> dict[str, str]:
    """Read [sources], whose keys may be quoted or nested: "joints.link.mass" or joints.link.mass."""
    found: dict[str, str] = {}

    def walk(value: object, path: str) -> None:
        if isinstance(value, dict):
            for key, entry in cast("dict[str, object]", value).items():
                walk(entry, f"{path}.{key}" if path else key)
        elif not isinstance(value, str):
            file.problems.add(f"sources.{path}", "a string", shown(value), "Say where the number is from.")
        elif joint_free(path) not in SOURCE_KEYS:
            file.problems.add(
                f"sources.{path}", "a key of this file", "an unknown one", nearest(path, SOURCE_KEYS)
            )
        else:
            file.check_text(f"sources.{path}", value)
            found[path] = value

    sources = file.value("sources", "a table", {})
    if isinstance(sources, dict):
        walk(cast(object, sources), "")
    else:
        file.problems.add(
            "sources", "a table", shown(sources), "Its entries are: key = where its number is from."
        )
    return found
