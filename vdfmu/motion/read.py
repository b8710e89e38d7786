"""Motions from files: the table ``[motion]`` of a TOML file, and points of the joints from CSV files."""

from __future__ import annotations

import csv
import io
import math
import os
import re
from collections.abc import Callable
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from vdfmu.arrays import Floats
from vdfmu.errors import ModelError, UsageError
from vdfmu.model import Robot
from vdfmu.model.read import Problems, Table, shape_of, shown
from vdfmu.model.toml_file import read_bytes, read_toml
from vdfmu.motion.cartesian import circle, line
from vdfmu.motion.excitation import multisine, sweep
from vdfmu.motion.fastest import fastest
from vdfmu.motion.polynomial import Motion
from vdfmu.motion.waypoints import samples, waypoints

_LIMITS = ("velocity", "acceleration")
_TOOL = ("start", "orientation", *_LIMITS, "speed", "duration", "dwell", "tolerance")
_SINES = ("start", "amplitude", *_LIMITS)
KINDS: dict[str, tuple[Callable[..., Motion], tuple[str, ...]]] = {
    "waypoints": (waypoints, ("file", "points", "times", *_LIMITS, "duration", "dwell")),
    "samples": (samples, ("file",)),
    "fastest": (fastest, ("file", "points", *_LIMITS, "torque", "smoothing")),
    "line": (line, ("points", *_TOOL)),
    "circle": (circle, ("centre", "axis", "angle", *_TOOL)),
    "sweep": (sweep, ("frequencies", "duration", "law", *_SINES)),
    "multisine": (multisine, ("lines", "period", "periods", "phases", "seed", *_SINES)),
}
"""Kind to the function that works it out and its keys."""
_OF_ROBOT = ("fastest", "line", "circle")
_TEXTS = ("file", "orientation", "law", "phases")
_WHOLE = ("periods", "seed", "lines")
_LARGEST = 2**26
"""Bytes of a CSV file."""
_FACTORS = {"revolute": {"rad": 1.0, "deg": math.pi / 180.0}, "prismatic": {"m": 1.0, "mm": 1e-3}}
_HEADING = re.compile(r"(time|t|dwell|q_?\[?(\d+)\]?)(?:\s*\[(.+)\])?")
_EXAMPLE = "time [s], q1 [rad], q2 [deg]"


class Points(NamedTuple):
    """Content of a CSV file: positions (k, n), and times and rests (k,) where it has these columns."""

    points: Floats
    times: Floats | None
    dwell: Floats | None


def load_motion(path: str | os.PathLike[str], robot: Robot) -> Motion:
    """Work out the motion of a file for a robot.

    Parameters
    ----------
    path : path
        A TOML file with a table ``[motion]``, such as a scenario, or with its keys by themselves; or a CSV file of
        samples with times.
    robot : Robot

    Raises
    ------
    ModelError
        For what is wrong with the file or with the motion; it lists every problem.
    """
    path = Path(path)
    problems = Problems(str(path))
    if path.suffix.lower() == ".csv":
        data: Any = {"kind": "samples", "file": path.name}
    else:
        data = read_toml(path)
        data = data.get("motion", data)
    motion = read_motion(problems, data, robot, path.parent)
    problems.raise_any()
    assert motion is not None
    return motion


def read_motion(problems: Problems, data: object, robot: Robot, folder: Path) -> Motion | None:
    """Work out the motion of a table ``[motion]``, or of the TOML file that its text names; None with problems."""
    if isinstance(data, str):
        try:
            return load_motion(folder / data, robot)
        except ModelError as error:
            problems.lines.extend(error.problems)
            return None
    before = len(problems.lines)
    kind = Table(problems, data, "motion", list(data) if isinstance(data, dict) else ()).text(
        "kind", choices=tuple(KINDS)
    )
    if kind not in KINDS:
        return None
    make, keys = KINDS[kind]
    table = Table(problems, data, "motion", ("kind", *keys))
    values = {key: _value(table, key) for key in table.data if key in keys and key != "file"}
    if "file" in table.data:
        file = folder / table.text("file")
        if also := [key for key in ("points", "times") if key in values]:
            problems.add(
                "motion.file", "points in one place", f"a file and {', '.join(also)}", "Remove one of them."
            )
        found = read_points(file, robot, problems)
        if found is not None:
            read = {key: value for key, value in found._asdict().items() if value is not None}
            ignored = [
                key
                for key in read
                if key not in (*keys, "points", *(("times",) if kind == "samples" else ()))
            ]
            if ignored:
                problems.lines.append(
                    f"{file}: {', '.join(ignored)}: a motion of kind {kind} has no such column."
                )
            values |= read
    elif "points" in keys and "points" not in values or kind == "samples":
        problems.add(
            "motion.points", "points", "nothing", 'Give points, or the file that has them: file = "path.csv".'
        )
    if kind == "samples" and "file" in table.data and "times" not in values and len(problems.lines) == before:
        problems.lines.append(f"{folder / table.data['file']}: expected a column time. Samples have times.")
    if len(problems.lines) > before:
        return None
    try:
        motion = make(**values, **({"robot": robot} if kind in _OF_ROBOT else {}))
        if motion.n != robot.n:
            raise UsageError(f"expected positions of the {robot.n} joints of {robot.name}, got {motion.n}.")
        check_motion(motion, robot)
    except (UsageError, TypeError) as error:
        text = str(error).replace(f"{make.__name__}() ", "") if isinstance(error, TypeError) else str(error)
        problems.lines.extend(f"{problems.where}: motion: {one}" for one in text.splitlines())
        return None
    return motion


def check_motion(motion: Motion, robot: Robot) -> None:
    """Raise UsageError for a motion beyond the end stops of a robot, or faster than its motors are."""
    if not robot.limits:
        return
    low, high = motion.extremes(0)
    problems = [
        f"joint {j + 1}: expected positions between its end stops, {robot.q_min[j]:g} and {robot.q_max[j]:g}, got "
        f"{value[i, j]:.4g} at {motion.knots[i]:.4g} to {motion.knots[i + 1]:.4g} s. Choose other points."
        for j in range(robot.n)
        for value, beyond in ((low, low < robot.q_min), (high, high > robot.q_max))
        for i in np.flatnonzero(beyond[:, j])[:1]
    ]
    fast = motion.peaks[0] > robot.kappa_dot_max
    problems += [
        f"joint {j + 1}: expected at most the no-load speed of its motor, {robot.kappa_dot_max[j]:g}, got a speed of "
        f"{motion.peaks[0, j]:.4g}. Give more time."
        for j in np.flatnonzero(fast)
    ]
    if problems:
        raise UsageError("\n".join(problems))


def _value(table: Table, key: str) -> Any:
    value = table.data[key]
    if key in _TEXTS and isinstance(value, str):
        return table.text(key)
    shape = shape_of(value)
    if key in _TEXTS and key != "orientation" or shape is None or len(shape) > 2 or 0 in shape:
        expected = "a text" if key in _TEXTS else "a number, or a list or rows of numbers of one length"
        table.problems.add(table.key(key), expected, shown(value), "Correct it.")
        return None
    if key in _WHOLE and not all(type(one) is int for one in (value if shape else [value])):
        table.problems.add(table.key(key), "whole numbers", shown(value), "Correct it.")
        return None
    if not shape:
        return int(value) if key in _WHOLE else table.number(key, "")
    return table.numbers(key, shape, "").astype(int if key in _WHOLE else float)


def read_points(path: Path, robot: Robot, problems: Problems) -> Points | None:
    """Read a CSV file of positions of the joints; None if there are problems, which are noted with their lines.

    The heading names the columns in any order: ``q1 [rad]`` to ``qn``, in rad or deg, or in m or mm for a prismatic
    joint, in SI where no unit is given; ``time [s]`` and ``dwell [s]`` where they are needed.
    """
    where = Problems(str(path))
    table = _columns(path, robot, where)
    problems.lines.extend(where.lines)
    if table is None or where.lines:
        return None
    points = np.column_stack([table[f"q{j + 1}"] for j in range(robot.n)])
    return Points(points, table.get("time"), table.get("dwell"))


def _columns(path: Path, robot: Robot, problems: Problems) -> dict[str, Floats] | None:
    """Return the columns of a CSV file in SI units."""
    try:
        text = read_bytes(path, "a CSV file", _LARGEST).decode("utf-8-sig")
        reader = csv.reader(io.StringIO(text, newline=""), strict=True)
        lines = [
            (reader.line_num, [cell.strip() for cell in row])
            for row in reader
            if any(cell.strip() for cell in row)
        ]
    except ModelError as error:
        problems.lines.extend(error.problems)
        return None
    except (UnicodeDecodeError, csv.Error) as error:
        problems.lines.append(f"{path}: expected a CSV file, got what cannot be read: {error}.")
        return None
    if len(lines) < 3:
        problems.lines.append(
            f"{path}: expected a heading, such as {_EXAMPLE!r}, and at least two rows of numbers."
        )
        return None
    names: list[str] = []
    factors: list[float] = []
    for cell in lines[0][1]:
        name, factor = _column(cell, robot, problems, lines[0][0])
        names.append(name)
        factors.append(factor)
    if not problems.lines:
        missing = [f"q{j + 1}" for j in range(robot.n) if f"q{j + 1}" not in names]
        twice = sorted({name for name in names if names.count(name) > 1})
        if missing:
            got = f"nothing for {', '.join(missing)}"
            problems.add(
                f"line {lines[0][0]}",
                f"a column for each of the {robot.n} joints",
                got,
                f"Such as {_EXAMPLE}.",
            )
        if twice:
            problems.add(
                f"line {lines[0][0]}", "each column once", f"{', '.join(twice)} twice", "Remove one."
            )
    rows = [_numbers(number, cells, names, problems) for number, cells in lines[1:]]
    if problems.lines:
        return None
    values = np.array(rows) * factors
    if "time" in names:
        t = values[:, names.index("time")]
        for i in np.flatnonzero(np.diff(t) <= 0.0):
            expected = f"a time after the {t[i]:g} s of the row before"
            problems.add(f"line {lines[i + 2][0]}", expected, f"{t[i + 1]:g} s", "Sort the rows.")
    return dict(zip(names, values.T, strict=True))


def _column(cell: str, robot: Robot, problems: Problems, line: int) -> tuple[str, float]:
    """Return the name of a column and the factor to SI of its unit."""
    match = _HEADING.fullmatch(cell)
    joint = int(match[2]) if match and match[2] else 0
    if match is None or joint > robot.n or (match[2] and not joint):
        expected = f"time [s], dwell [s], or q1 to q{robot.n} with a unit in brackets"
        problems.add(f"line {line}", expected, shown(cell), f"Write a heading such as {_EXAMPLE}.")
        return cell, 1.0
    known = _FACTORS[robot.joint_types[joint - 1]] if joint else {"s": 1.0}
    unit = match[3] or next(iter(known))
    if unit not in known:
        problems.add(
            f"line {line}", f"{match[1]} in {' or '.join(known)}", shown(unit), "Convert the column."
        )
    name = f"q{joint}" if joint else "time" if match[1] == "t" else match[1]
    return name, known.get(unit, 1.0)


def _numbers(line: int, cells: list[str], names: list[str], problems: Problems) -> list[float]:
    """Return the numbers of a row."""
    if len(cells) != len(names):
        problems.add(f"line {line}", f"{len(names)} cells", str(len(cells)), "Separate columns with commas.")
        return []
    found: list[float] = []
    for name, cell in zip(names, cells, strict=True):
        try:
            number = 0.0 if name == "dwell" and not cell else float(cell)
        except ValueError:
            number = math.nan
        if not math.isfinite(number) or (name == "dwell" and number < 0.0):
            problems.add(f"line {line}: {name}", "a finite number", shown(cell), "Correct it.")
        found.append(number)
    return found
