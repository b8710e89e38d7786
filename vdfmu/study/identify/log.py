"""Logs of a motion: files of this project, CSV of any tool with a mapping of columns, and public data sets."""

from __future__ import annotations

import os
from collections.abc import Mapping
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from vdfmu.arm.robot import Robot
from vdfmu.base.arrays import Floats
from vdfmu.base.errors import UsageError
from vdfmu.base.measure import WIDE_ANGLE
from vdfmu.engine.plan.inputs import read_inputs
from vdfmu.engine.results.formats import suffix_of
from vdfmu.engine.results.results import Results

_KNOWN = {
    "kappa": ("plant.kappa[{}]", "kappa[{}]"),
    "theta": ("theta[{}]",),
    "q": ("plant.q[{}]", "q[{}]"),
    "tau": ("controller.tau[{}]", "plant.tau[{}]", "tau[{}]"),
    "tau_link": ("tau_link[{}]",),
}
"""Quantities taken from a log, to its columns; {} is the joint, from 1."""
_FACTORS = {
    "": 1.0, "rad": 1.0, "deg": np.pi / 180.0, "m": 1.0, "mm": 1e-3, "N.m": 1.0, "Nm": 1.0, "N m": 1.0, "N": 1.0,
    "mN.m": 1e-3,
}  # fmt: skip
_KIND = {"rad": "angle", "deg": "angle", "m": "length", "mm": "length", "N": "force"}
_FEWEST = 500
"""Rows of a log."""
_UNEVEN = 0.01
"""Largest difference of a time step from the middle one, as a share; more is a gap."""


class Log(NamedTuple):
    """Samples of a motion: times (m,) [s], and (m, n) each."""

    where: str
    t: Floats
    kappa: Floats
    """Rotor positions divided by ell [rad or m]."""
    tau: Floats
    """Motor torques [N.m], motor-side."""
    q: Floats | None
    """Link positions [rad or m], if they are measured."""

    @property
    def step(self) -> float:
        """Time from one row to the next [s]."""
        return float((self.t[-1] - self.t[0]) / (len(self.t) - 1))


def read_log(path: str | os.PathLike[str], robot: Robot, columns: Mapping[str, str] | None = None) -> Log:
    """Read a log.

    Parameters
    ----------
    path : path
        ``results.csv`` or ``results.parquet`` of a run; a CSV of any tool, with a column ``time`` in s and units in
        brackets, ``q[1] [deg]``, without which angles must go over less than 4 pi; or a ``.mat`` of the KUKA KR300
        R2500 data set (Weigand et al. 2022), a recording or the file for forward identification.
    robot : Robot
        Its number of joints and ratios count.
    columns : mapping, optional
        ``kappa``, rotors divided by ell, or ``theta``, motors; ``tau``, motor-side, or ``tau_link``, times ell; and
        ``q``, links: to the name of a column with ``{}`` for the joint, from 1 or by its name in the robot file, such
        as ``axis{}_pos``, or ``{}`` alone for columns headed by the names.

    Raises
    ------
    UsageError
        For a log that cannot be read, is not finite, has gaps, or is too short; with all problems.
    """
    path = Path(path)
    columns = columns or {}
    if wrong := [name for name in columns if name not in _KNOWN]:
        raise UsageError(f"columns: {', '.join(wrong)}: expected some of {', '.join(_KNOWN)}.")
    if wrong := [f"{what}={name}" for what, name in columns.items() if "{}" not in name and robot.n > 1]:
        raise UsageError(f"columns: {', '.join(wrong)}: expected a name with {{}} for the joint.")
    is_matlab = path.suffix.lower() == ".mat"
    t, found = _kuka(path, robot.n) if is_matlab else _table(path, robot, columns)
    for given, wanted in (("theta", "kappa"), ("tau_link", "tau")):
        if given in found:
            found[wanted] = found.pop(given) / robot.ell
    _check(path, t, found)
    return Log(str(path), t, found["kappa"], found["tau"], found.get("q"))


def _table(path: Path, robot: Robot, columns: Mapping[str, str]) -> tuple[Floats, dict[str, Floats]]:
    if suffix_of(path) != ".csv":
        results = Results.read(path)
        t, units = results.time, results.units
        names, values = list(results), {name: results[name] for name in results}
    else:
        (table,) = read_inputs(path)
        t, names = table.t, list(table.names)
        units, values = (dict(zip(names, each, strict=True)) for each in (table.units, table.values.T))
    found: dict[str, Floats] = {}
    problems: list[str] = []
    for what, patterns in _KNOWN.items():
        chosen = [columns[what]] if what in columns else patterns
        joints = [[str(i + 1) for i in range(robot.n)], *([robot.joint_names] if all(robot.joint_names) else [])]
        some = [[p.replace("{}", joint) for joint in each] for each in joints if each for p in chosen]
        own = next((each for each in some if all(name in values for name in each)), None)
        if own is None:
            if what in columns:
                problems.append(f"{what}: expected columns {', '.join(some[0])}; there are {', '.join(names)}")
            continue
        factors = []
        for name, kind in zip(own, robot.joint_types, strict=True):
            unit = units.get(name, "")
            angle = what == "theta" or kind == "revolute"
            wanted = "angle" if angle else "length"
            if what in ("tau", "tau_link"):
                wanted = "force" if what == "tau_link" and not angle else "torque"
            if unit not in _FACTORS or (unit and _KIND.get(unit, "torque") != wanted):
                fitting = [u for u in _FACTORS if u and _KIND.get(u, "torque") == wanted]
                problems.append(f"{name}: expected the unit {' or '.join(fitting)}, got {unit!r}")
            span = float(np.ptp(values[name])) if len(t) else 0.0
            if not unit and kind == "revolute" and what in ("kappa", "q") and span > WIDE_ANGLE:
                problems.append(
                    f"{name}: expected a unit in its heading, {name} [deg] or [rad], for values that go over "
                    f"{span:.4g}, which looks like degrees; got none"
                )
            factors.append(_FACTORS.get(unit, 1.0))
        found[what] = np.column_stack([values[name] for name in own]) * factors
    for group in (("kappa", "theta"), ("tau", "tau_link")):
        if not problems and not any(name in found for name in group):
            looked = [p.format(1) for name in group for p in _KNOWN[name]]
            problems.append(
                f"expected {' or '.join(looked)} and so on for {robot.n} joints; there are "
                f"{', '.join(names)}. Name them by --column {group[0]}=NAME{{}}"
            )
    if problems:
        raise UsageError("\n".join(f"{path}: {problem}." for problem in problems))
    return t, found


def _kuka(path: Path, n: int) -> tuple[Floats, dict[str, Floats]]:
    """Read the KUKA KR300 R2500 data set: arrays (6, m), angles in degrees, torques in N.m."""
    from scipy.io import loadmat

    try:
        data: dict[str, Any] = loadmat(path)
    except (OSError, ValueError, NotImplementedError) as error:
        raise UsageError(f"{path}: expected a MATLAB file, got what cannot be read: {error}.") from None
    forms = (
        ("time", {"kappa": "q_mot_meas", "q": "q_se_meas", "tau_link": "tau_meas"}),
        ("time_train", {"kappa": "y_train", "tau_link": "u_train"}),
    )
    for time, names in forms:
        if all(name in data for name in (time, *names.values())):
            found = {what: np.array(data[name], np.float64).T for what, name in names.items()}
            for what in found.keys() - {"tau_link"}:
                found[what] = np.deg2rad(found[what])
            if any(each.shape[1:] != (n,) for each in found.values()):
                raise UsageError(f"{path}: expected a robot of {found['kappa'].shape[1]} joints, got one of {n}.")
            return np.array(data[time], np.float64).ravel(), found
    known = " or ".join(", ".join((time, *names.values())) for time, names in forms)
    raise UsageError(f"{path}: expected {known}; there are {', '.join(k for k in data if k[0] != '_')}.")


def _check(path: Path, t: Floats, found: Mapping[str, Floats]) -> None:
    problems = [f"{len(t)} rows: expected at least {_FEWEST}"] if len(t) < _FEWEST else []
    if any(len(each) != len(t) for each in found.values()):
        problems.append("expected as many rows of all signals as times")
    elif not np.isfinite(t).all():
        problems.append("time: expected finite numbers")
    for what, each in found.items():
        bad = np.argwhere(~np.isfinite(each))
        if len(bad):
            problems.append(f"{what}[{bad[0, 1] + 1}], row {bad[0, 0] + 1}: expected a finite number")
    if len(t) > 2:
        steps = np.diff(t)
        middle = float(np.median(steps))
        far = np.flatnonzero(~(np.abs(steps - middle) <= _UNEVEN * middle))
        if far.size:
            problems.append(
                f"expected even times, a row every {middle:g} s; from {t[far[0]]:g} s to {t[far[0] + 1]:g} s there is "
                f"a gap, and {far.size - 1} more. Cut the log there, or resample it"
            )
    if problems:
        raise UsageError("\n".join(f"{path}: {problem}." for problem in problems))
