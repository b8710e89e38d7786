"""Reads motions from files: the table ``[motion]`` of a TOML file, and joint positions from CSV files."""

from __future__ import annotations

import os
import re
from collections.abc import Callable
from dataclasses import replace
from functools import cache
from inspect import signature
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from vdfmu.arm.drive.limits import motor_torque
from vdfmu.arm.dynamics import inverse_dynamics
from vdfmu.arm.motion.joint_space import samples, waypoints
from vdfmu.arm.motion.polynomial import Motion
from vdfmu.arm.robot.plausible import position_notes, speed_notes
from vdfmu.arm.robot.robot import Robot, robot_argument
from vdfmu.base.arrays import Floats
from vdfmu.base.errors import ModelError, UsageError
from vdfmu.base.extras import extra_modules
from vdfmu.base.measure import JOINT_TYPES
from vdfmu.base.option import NUMBERS, checks_types
from vdfmu.base.toml_file import read_toml
from vdfmu.base.toml_tables import Problems, Table, shape_of, value_text
from vdfmu.engine.plan.inputs import csv_columns

_LOOKS = 1001
"""Number of times at which torques are compared with those of the motors."""
_EXAMPLE = "time [s], q1 [rad], q2 [deg]"


class Argument(NamedTuple):
    """Whether a parameter, by its annotation, is a text, a whole number or a single number, and is required."""

    text: bool
    whole: bool
    single: bool
    needed: bool


def _arguments_of(make: Callable[..., Any]) -> dict[str, Argument]:
    """Return the parameters of a function except for the robot, by name."""
    arguments: dict[str, Argument] = {}
    for name, parameter in signature(make).parameters.items():
        words = {*re.findall(r"\w+", parameter.annotation)}
        text, single = bool(words & {"str", "Literal"}), words <= {"float", "int", "None"}
        arguments[name] = Argument(text, "int" in words, single, parameter.default is parameter.empty)
    arguments.pop("robot", None)
    return arguments


class MotionKind(NamedTuple):
    """A kind of motion: the function that makes it, and its parameters, which are the keys of the table."""

    make: Callable[..., Motion]
    keys: dict[str, Argument]

    @property
    def of_file(self) -> bool:
        """Whether its points are joint positions, which may be in a CSV file; a line also has a start."""
        return "points" in self.keys and "start" not in self.keys


@cache
def kinds() -> dict[str, MotionKind]:
    """Return the kinds of motions by name: those of the core and those of the extras."""
    makers: list[Callable[..., Motion]] = [waypoints, samples]
    for module in extra_modules("motions"):
        makers += module.MOTIONS
    return {make.__name__: MotionKind(make, _arguments_of(make)) for make in makers}


@checks_types
def load_motion(path: str | os.PathLike[str], robot: Robot) -> Motion:
    """Calculate the motion of a file for a robot.

    Parameters
    ----------
    path : path
        A TOML file with a table ``[motion]``, such as a scenario, or with only the keys of this table; or a CSV file of
        samples.
    robot : Robot

    Returns
    -------
    Motion

    Raises
    ------
    ModelError
        If the file or the motion has problems; the error lists all of them.
    """
    robot_argument(robot)
    path = Path(path)
    problems = Problems(str(path))
    if path.suffix.lower() == ".csv":
        data: Any = {"kind": "samples", "file": path.name}
    else:
        data = read_toml(path)
        if "motion" not in data and "stop" in data:
            problems.add(
                "motion",
                "a table",
                "a scenario without one",
                f"Its motion is (57): 'vdfmu run {path.stem}' shows it. Or add the table.",
            )
            problems.raise_any()
        data = data.get("motion", data)
    motion = read_motion(problems, data, robot, path.parent)
    problems.raise_any()
    assert motion is not None
    return motion


def read_motion(problems: Problems, data: object, robot: Robot, folder: Path) -> Motion | None:
    """Calculate the motion of a table ``[motion]``, or of the TOML file that it names; None if there are problems."""
    if isinstance(data, str):
        if (folder / data).resolve() == Path(problems.where).resolve():
            problems.add("motion", "a table, or another file with it", "the file itself", "Write the table here.")
            return None
        try:
            return load_motion(folder / data, robot)
        except ModelError as error:
            problems.take(error)
            return None
    before = len(problems.lines)
    name = Table(problems, data, "motion", None).text("kind", choices=(*kinds(),))
    if name not in kinds():
        return None
    kind = kinds()[name]
    make, keys = kind
    table = Table(problems, data, "motion", ("kind", *(("file",) if kind.of_file else ()), *keys))
    values = {key: _value(table, key, keys[key]) for key in table.data if key in keys}
    if kind.of_file and "file" in table.data:
        read = read_points(folder / table.text("file"), robot, problems, keys)
        if twice := [key for key in read if key in values]:
            problems.add("motion.file", "values in one place", f"{', '.join(twice)} twice", "Remove one of them.")
        values |= read
    for key, argument in keys.items():
        if argument.needed and key not in values and len(problems.lines) == before:
            way = 'Add the key, or file = "points.csv".' if kind.of_file else "The key is missing: add it."
            problems.add(table.key(key), f"a value for {name}", "nothing", way)
    if len(problems.lines) > before:
        return None
    try:
        motion = make(**values, **({"robot": robot} if "robot" in signature(make).parameters else {}))
        check_motion(motion, robot)
        notes = _plausible(motion, robot)
    except UsageError as error:
        problems.take(error, "motion")
        return None
    return replace(motion, notes=(*motion.notes, *notes))


def _plausible(motion: Motion, robot: Robot) -> list[str]:
    """Return notes on positions and speeds that seem to be in another unit."""
    widest, fastest = np.abs(motion.extremes(0)).max(axis=(0, 1)), motion.peaks[0]
    notes = (
        list(position_notes(f"position of joint {j + 1}", widest[j], kind))
        or list(speed_notes(f"speed of joint {j + 1}", fastest[j], kind))
        for j, kind in enumerate(robot.joint_types)
    )
    return [note for of_joint in notes for note in of_joint]


def check_motion(motion: Motion, robot: Robot) -> None:
    """Raise UsageError if a motion has another number of joints, or exceeds end stops or the motors of a rigid arm."""
    if motion.n != robot.n:
        raise UsageError(f"expected positions of the {robot.n} joints of {robot.name}, got {motion.n}.")
    if not robot.limits:
        return
    low, high = motion.extremes(0)
    labels = robot.joint_labels
    stops = [
        f"joint {labels[j]}: expected positions between its end stops, {robot.q_min[j]:g} and {robot.q_max[j]:g}, got "
        f"{value[i, j]:.4g} at {motion.knots[i]:.4g} to {motion.knots[i + 1]:.4g} s."
        for j in range(robot.n)
        for value, beyond in ((low, low < robot.q_min), (high, high > robot.q_max))
        for i in np.flatnonzero(beyond[:, j])[:1]
    ]
    t = np.linspace(0.0, motion.duration, _LOOKS)
    q, q_dot, q_ddot = motion.at(t)[:3]
    tau = inverse_dynamics(robot, q, q_dot, q_ddot) / robot.ell + robot.I_m * q_ddot
    lacking = np.abs(tau) - np.abs(motor_torque(robot, tau, q_dot))
    weak = [
        f"joint {labels[j]}: expected at most the torque of its motor at this speed, got {abs(tau[i, j]):.4g} "
        f"N.m, {lacking[i, j]:.4g} N.m more, at {t[i]:.4g} s."
        for j, i in enumerate(lacking.argmax(axis=0))
        if lacking[i, j] > 1e-9 * abs(tau[i, j])
    ]
    ways = ((stops, "Choose other points."), (weak, "Give more time."))
    if problems := ["\n".join(lines) + f" {way}" for lines, way in ways if lines]:
        raise UsageError("\n".join(problems))


def _value(table: Table, key: str, argument: Argument) -> Any:
    """Return the value of a key: a text, a number or an array."""
    value = table.data[key]
    if argument.text and isinstance(value, str):
        return table.text(key)
    shape, numbers = shape_of(value), np.array(value, dtype=object).ravel()
    if shape and argument.single:
        table.problems.add(table.key(key), "one number", value_text(value), "Correct it.")
    elif shape is None or len(shape) > 2 or 0 in shape:
        table.problems.add(table.key(key), NUMBERS, value_text(value), "Correct it.")
    elif argument.whole and any(type(number) is not int for number in numbers):
        table.problems.add(table.key(key), "whole numbers", value_text(value), "Correct it.")
    elif not shape:
        return int(value) if argument.whole else table.number(key, "")
    else:
        return table.numbers(key, shape, "")
    return None


def read_points(path: Path, robot: Robot, problems: Problems, allowed: Any) -> dict[str, Floats]:
    """Read ``points`` (k, n) [rad or m], ``times`` and ``dwell`` (k,) [s] of a CSV file; problems have lines.

    The heading has the columns in any order: ``q1`` to ``qn``, or the names of joints in the robot's file, with rad or
    deg in brackets, m or mm for a prismatic joint, by default SI; of the keys `allowed`, ``time [s]``, ``dwell [s]``.
    """
    lines: list[str] = []
    columns = csv_columns(path, lines, timed=False)
    if columns is not None:
        names, units, values = columns.file.names, columns.file.units, columns.values
        keys = {"time": "times", "dwell": "dwell"}
        numbered = [f"q{j + 1}" for j in range(robot.n)]
        of_names = dict(zip(robot.joint_names, numbered, strict=False))
        table: dict[str, Floats] = {}
        unknown: list[str] = []
        wrong: dict[str, list[str]] = {}
        for heading, unit, column in zip(names, units, values.T, strict=True):
            name = of_names.get(heading, heading)
            factors = {"s": 1.0}
            if name in numbered:
                factors = JOINT_TYPES[robot.joint_types[numbered.index(name)]].position_factors
            elif keys.get(name) not in allowed:
                unknown.append(heading)
                continue
            if unit and unit not in factors:
                wrong.setdefault(f"expected {' or '.join(factors)}, got {unit!r}", []).append(heading)
            if name in table:
                lines.append(f"{path}: row 1: {heading}: expected one column for {name}, got another one.")
            table[name] = column * factors.get(unit, 1.0)
        if unknown:
            also = "".join(f", {key}" for key, value in keys.items() if value in allowed)
            also = (f", or {', '.join(filter(None, of_names))}" if any(of_names) else "") + also
            lines.append(
                f"{path}: row 1: {', '.join(unknown)}: expected q1 to q{robot.n}{also}. Write a heading such as "
                f"{_EXAMPLE}."
            )
        for mismatch, headings in wrong.items():
            plural = "s" if len(headings) > 1 else ""
            lines.append(f"{path}: row 1: {', '.join(headings)}: {mismatch}. Convert the column{plural}.")
        if missing := [name for name in numbered if name not in table]:
            lines.append(f"{path}: row 1: expected a column for each joint, got none of {', '.join(missing)}.")
        if not lines:
            points = np.column_stack([table[name] for name in numbered])
            return {"points": points} | {keys[key]: table[key] for key in keys if key in table}
    problems.lines.extend(lines)
    return {}
