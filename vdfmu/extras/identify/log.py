"""Logs of an arm's motion: columns in files of any tool, read and checked against the robot."""

from __future__ import annotations

import os
import re
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from vdfmu.arm.robot import Robot
from vdfmu.base.arrays import Floats
from vdfmu.base.csv_file import MOST_FAULTS, TIME_UNITS, columns_of, open_csv, repeated, split_unit
from vdfmu.base.errors import UsageError
from vdfmu.base.foreign import TITLES, Foreign, read_foreign
from vdfmu.base.measure import JOINT_TYPES
from vdfmu.base.plugins import Plugins, PluginTable
from vdfmu.engine.results.csv_file import csv_results
from vdfmu.engine.results.parquet import parquet_results
from vdfmu.engine.results.results import Recorded
from vdfmu.engine.results.verdict import Check
from vdfmu.extras.identify.faults import LogColumn, check_motion, check_torques, even_times, unwrapped
from vdfmu.extras.matlab.mat_file import mat_results

_TIME = re.compile(r"(?:.*\.)?(?:t|(?:time|stamp|timestamp)(?:_\w+)?)", re.IGNORECASE)
_SECONDS = {"": 1.0, **TIME_UNITS}


def read_columns(path: Path, time: str, notes: list[str]) -> dict[str, LogColumn]:
    """Return the columns of a file, where `time` names the times; assumptions are noted."""
    suffix = path.suffix.lower()
    raw = READERS[suffix](path) if suffix in READERS else _csv(path)
    if isinstance(raw, Foreign):
        raw = _of_foreign(raw, notes)
    if isinstance(raw, Recorded):
        return {name: LogColumn(raw.time, np.asarray(raw[name], float), raw.units[name]) for name in raw}
    if raw and all(len(column) == 3 for column in raw.values()):
        times: dict[bytes, Floats] = {}  # columns with the same times share them
        timed: dict[str, LogColumn] = {}
        for name, (t, values, unit) in raw.items():
            t = np.asarray(t, float)
            timed[name] = LogColumn(times.setdefault(t.tobytes(), t), np.asarray(values, float), unit)
        return timed
    name, unit = split_unit(time)
    name = name or next((each for each in raw if _TIME.fullmatch(each)), "")
    if name not in raw:
        there = f"there are {', '.join(raw)}. Name it by --time" if raw else "the file has no columns"
        raise UsageError(f"{path}: expected a column {name or 'time'}; {there}.")
    stamps, stated = raw[name]
    unit = unit or stated or (match[1] if (match := re.fullmatch(r".*_(m?s|us|ns)", name)) else "")
    if unit not in _SECONDS:
        raise UsageError(f"{path}: {name}: expected s, ms, us or ns, got {unit!r}. Give it: --time '{name} [s]'.")
    if stamps.dtype.kind in "iu" and len(stamps):  # times since 1970 in ns have more digits than a float
        stamps = stamps.astype(np.int64)
        stamps -= stamps[0]
    t = np.asarray(stamps, float).reshape(-1) * _SECONDS[unit]
    if name != "time":
        notes.append(f"times are those of {name}, in {unit or 's'}")
    return {
        each: LogColumn(t, np.asarray(values, float).reshape(-1), unit)
        for each, (values, unit) in raw.items()
        if each != name and np.size(values) == len(t)
    }


_FileColumns = Mapping[str, tuple[Any, ...]]


def _csv(path: Path) -> Recorded | _FileColumns:
    with open_csv(path) as file:
        if file.unit_row and file.names[0] == "time" and file.units[0] == "s":
            return csv_results(path, file)
        columns = columns_of(file, texts=True)
    problems = [*(f"{name}: more than one column has this name" for name in repeated(file.names)), *columns.faults]
    if len(file.units) != len(file.names):
        problems.append(f"row 2: expected {len(file.names)} units of measurement, got {len(file.units)}")
    if problems:
        raise UsageError("\n".join(f"{path}: {problem}." for problem in problems[:MOST_FAULTS]))
    return dict(zip(file.names, zip(columns.values.T, file.units, strict=True), strict=True))


def _of_foreign(content: Foreign, notes: list[str]) -> Recorded | _FileColumns:
    """Return the results or the columns in a file of another tool."""
    notes += [f"ignored: {', '.join(content.left_out)}"] if content.left_out else []
    is_table = any(block.kind for block in content.blocks)
    if "vdfmu" in content.texts:
        return parquet_results(content) if is_table else mat_results(content)
    if is_table:
        split = {name: split_unit(name) for name in content.names}
        if twice := repeated(name for name, _ in split.values()):
            raise UsageError(
                f"{content.path}: {', '.join(twice)}: more than one column has this name. Rename the others."
            )
        return {
            split[raw][0]: (values, content.units.get(raw, split[raw][1])) for raw, values in content.arrays.items()
        }
    columns: dict[str, tuple[Any, str]] = {}
    for name, value in content.arrays.items():
        array = np.squeeze(value)
        if array.dtype.kind == "c" or array.ndim > 2:
            continue
        if array.ndim < 2:
            columns[name] = np.atleast_1d(array), ""
        else:  # some MATLAB arrays have a row per time, some a column
            for i, each in enumerate(array if array.shape[0] < array.shape[1] else array.T, 1):
                columns[f"{name}[{i}]"] = each, ""
    return columns


PLUGINS = Plugins("logs", "reader of logs", "a function of the path of a log", callable)
READERS: PluginTable[Callable[[Path], Recorded | Foreign | _FileColumns]] = PluginTable(
    PLUGINS, {".csv": _csv, ".txt": _csv, **dict.fromkeys(TITLES, read_foreign)}, prefix="."
)
"""Readers by suffix. Each returns results, the content of a file of another tool, or columns: name to numbers and unit,
"" for none. Columns have the same length, or each has its times [s] before its numbers."""


_PATTERNS = {
    "kappa": ("plant.kappa[{}]", "kappa[{}]", "/joint_states.position[{}]"),
    "theta": ("theta[{}]",),
    "q": ("plant.q[{}]", "q[{}]"),
    "tau": ("controller.tau[{}]", "plant.tau[{}]", "tau[{}]"),
    "tau_link": ("tau_link[{}]", "/joint_states.effort[{}]"),
}
"""Quantities read from a log, to the columns; {} is the joint, from 1."""
_OTHER = {"kappa": "theta", "theta": "kappa", "tau": "tau_link", "tau_link": "tau"}
"""A quantity that is not searched for if the other quantity on its side of the gear is named."""
_FACTORS = {
    "angle": {"rad": 1.0, "deg": np.pi / 180.0, "degrees": np.pi / 180.0, "mrad": 1e-3, "rev": 2.0 * np.pi},
    "length": {"m": 1.0, "mm": 1e-3},
    "torque": {"N.m": 1.0, "Nm": 1.0, "N m": 1.0, "mN.m": 1e-3, "kN.m": 1e3},
    "force": {"N": 1.0, "kN": 1e3},
}
_UNIT = re.compile(r"([+-]?[\d.]+(?:[eE][+-]?\d+)?)?\s*(.*)")
"""A factor, if there is one, and a unit."""
_FEWEST = 500
"""Number of rows of a log."""


class Log(NamedTuple):
    """Samples of a motion: times (m,) [s], the others (m, n)."""

    where: str
    t: Floats
    kappa: Floats
    """Rotor positions divided by ell [rad or m]."""
    tau: Floats
    """Motor torques [N.m], motor-side."""
    q: Floats | None
    """Link positions [rad or m] if any are measured; all NaN for a joint without an encoder behind its gear."""
    notes: tuple[str, ...] = ()
    """Assumptions and corrections."""
    checks: tuple[Check, ...] = ()
    """Likely faults of ratios, units, signs and the order of columns."""

    @property
    def step(self) -> float:
        """Time between rows [s]."""
        return float((self.t[-1] - self.t[0]) / (len(self.t) - 1))


def read_log(
    path: str | os.PathLike[str], robot: Robot, columns: Mapping[str, str] | None = None, *, time: str = ""
) -> Log:
    """Read a log.

    Parameters
    ----------
    path : path
        Results of a run in any format, or a CSV, Parquet or MATLAB file of any tool, or one that a plugin reads. Units
        are in brackets, ``q[1] [deg]``; angles without a unit must span less than 4 pi.
    robot : Robot
        Its joints, ratios and limits are used, and its inertias for the comparison of torques with the motion.
    columns : mapping, optional
        Quantity to the name of its columns. Quantities are ``kappa`` (rotor positions divided by ell) or ``theta``
        (motor positions), ``tau`` (motor-side torques) or ``tau_link`` (the same times ell), and ``q`` (link
        positions). In a name, such as ``axis{}_pos``, ``{}`` is the number of the joint, from 1 or 0, or its name in
        the robot file. A unit may follow, with a factor: ``current_{} [-1.81 N.m]``. ``q[2]`` and so on name the
        column of one joint. Joints without a column of ``q`` lack an encoder behind their gears.
    time : str, optional
        Column of the times with its unit, ``stamp [us]``; by default one called ``time``, ``t`` or similar.

    Raises
    ------
    UsageError
        For a log that cannot be read, is not finite, is too short, or has gaps, columns in another order, or other
        signs or units; it lists all problems.
    """
    path = Path(path)
    names = dict(columns or {})
    allowed = {*_PATTERNS, *(f"{key}[{i + 1}]" for key in _PATTERNS for i in range(robot.n))}
    if wrong := [name for name in names if name not in allowed]:
        raise UsageError(f"columns: {', '.join(wrong)}: expected some of {', '.join(_PATTERNS)}.")
    if wrong := [f"{k}={name}" for k, name in names.items() if k in _PATTERNS and "{}" not in name and robot.n > 1]:
        raise UsageError(f"columns: {', '.join(wrong)}: expected a name with {{}} for the joint.")
    notes: list[str] = []
    problems: list[str] = []
    checks: list[Check] = []
    table = read_columns(path, time, notes)
    chosen = _chosen(table, robot, names, notes, problems)
    if not problems:
        t, arrays = even_times(chosen, _FEWEST, notes, problems)
        for motor, wanted in (("theta", "kappa"), ("tau_link", "tau")):
            if motor in arrays:
                arrays[wanted] = arrays.pop(motor) / robot.ell
        if len(t) > 1:
            checks = check_motion(t, arrays, robot, notes, problems)
        if not problems:
            checks = check_torques(t, arrays, robot, checks)
            q = arrays.get("q")
            none = q is None or not np.isfinite(q).any()
            return Log(str(path), t, arrays["kappa"], arrays["tau"], None if none else q, tuple(notes), tuple(checks))
    raise UsageError("\n".join(f"{path}: {problem}." for problem in problems))


def _chosen(
    table: Mapping[str, LogColumn], robot: Robot, columns: Mapping[str, str], notes: list[str], problems: list[str]
) -> dict[str, list[LogColumn | None]]:
    """Return the columns of each quantity, in SI units and unwrapped; None without an encoder."""
    by_key: dict[str, list[LogColumn | None]] = {}
    counted = [[str(i + first) for i in range(robot.n)] for first in (1, 0)]
    joints = [counted[0], *([robot.joint_names] if all(robot.joint_names) and robot.joint_names else []), counted[1]]
    named = {key.partition("[")[0] for key in columns}
    for key, patterns in _PATTERNS.items():
        if key not in named and _OTHER.get(key) in named:
            continue
        chosen = [split_unit(columns[key])] if key in columns else [(pattern, "") for pattern in patterns]
        some = [
            [
                split_unit(columns[f"{key}[{i}]"]) if f"{key}[{i}]" in columns else (p.replace("{}", joint), unit)
                for i, joint in enumerate(each, 1)
            ]
            for each in joints
            for p, unit in chosen
        ]
        best = max(some, key=lambda each: sum(name in table for name, _ in each))
        if not (any if key == "q" else all)(name in table for name, _ in best):
            if key in named:
                wanted = ", ".join(name for name, _ in some[0])
                problems.append(f"{key}: expected columns {wanted}; there are {', '.join(table)}")
            continue
        if best[0][0] == chosen[0][0].replace("{}", "0"):
            notes.append(f"{key}: joint 1 is {best[0][0]}: counted from 0")
        if "/joint_states" in best[0][0]:
            notes.append(
                f"{key} is {best[0][0]} and so on, which in ROS are positions and torques behind the gears; if these "
                "are not, name the columns by --column"
            )
        there = [name for name, _ in best if name in table and not (key == "q" and np.isnan(table[name].values).all())]
        if lacks := [name for name, _ in best if name not in there]:
            notes.append(
                f"{', '.join(lacks)}: missing or without numbers, so treated as without an encoder behind the gear"
            )
        by_key[key] = [
            _converted(key, name, table[name], unit, robot, i, notes, problems) if name in there else None
            for i, (name, unit) in enumerate(best)
        ]
    for group in (("kappa", "theta"), ("tau", "tau_link")):
        if not problems and not any(name in by_key for name in group):
            looked = [p.format(1) for name in group for p in _PATTERNS[name]]
            problems.append(
                f"expected {' or '.join(looked)} and so on for {robot.n} joints; there are "
                f"{', '.join(table)}. Name them by --column {group[0]}=NAME{{}}"
            )
    return by_key


def _converted(
    key: str, name: str, column: LogColumn, stated: str, robot: Robot, i: int, notes: list[str], problems: list[str]
) -> LogColumn:
    turns = key == "theta" or not JOINT_TYPES[robot.joint_types[i]].slides
    kind = "angle" if turns else "length"
    if key in ("tau", "tau_link"):
        kind = "force" if key == "tau_link" and not turns else "torque"
    match = _UNIT.fullmatch(stated or column.unit)
    factor, unit = (match[1] or "1", match[2]) if match else ("1", stated)
    if unit and unit not in _FACTORS[kind]:
        problems.append(f"{name}: expected the unit {' or '.join(_FACTORS[kind])}, got {unit!r}")
        return column
    span = float(np.ptp(column.values)) if len(column.values) else 0.0
    joint = JOINT_TYPES[robot.joint_types[i]]
    if not stated and not unit and not joint.slides and key in ("kappa", "q") and span > joint.far:
        problems.append(
            f"{name}: expected a unit in its heading, {name} [deg] or [rad], got none, and the values span {span:.4g}. "
            "If they are angles of a motor, name them by --column theta=NAME{}"
        )
    values = column.values * (float(factor) * _FACTORS[kind].get(unit, 1.0))
    if kind == "angle":
        turn = 2.0 * np.pi
        periods = (turn, turn / robot.ell[i]) if key == "kappa" else (turn,)
        values = unwrapped(name, values, periods, notes, problems)
    return column._replace(values=values)
