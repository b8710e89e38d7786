"""Drives by a user's file: options as in `vdfmu.arm.drive`, and the class of their robots."""

from __future__ import annotations

import dataclasses
import sys
import traceback
from collections.abc import Mapping
from functools import lru_cache
from hashlib import sha256
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np

from vdfmu.arm.drive.option import DriveOption, Friction, JointMotion, Law, LinkTorque, Parallel, Sliding, Spring
from vdfmu.arm.robot.parameters import PARAMETERS, Row
from vdfmu.arm.robot.robot import Robot
from vdfmu.base.errors import UnitError, UsageError
from vdfmu.base.text import kind_text
from vdfmu.compiler.unit.load import check_may_run


def drive_text(value: str, folder: Path) -> str:
    """Read the file of a drive, or return a text of several lines. UsageError without a file."""
    if "\n" in value:
        return value
    try:
        return (folder / value).read_text(encoding="utf-8") + "\n"
    except (OSError, UnicodeDecodeError) as error:
        raise UsageError(f"drive must be a file of Python, got {value!r}: {kind_text(error)}.") from None


_FILE = "drive"
"""Name of the file in tracebacks and messages."""


def _place(error: BaseException) -> str:
    """Return the last line of the file that an error went through."""
    lines = [frame.lineno for frame in traceback.extract_tb(error.__traceback__) if frame.filename == _FILE]
    return f"{_FILE}, line {lines[-1]}" if lines else _FILE


@lru_cache(maxsize=32)
def robot_class(text: str) -> type[Robot]:
    """Run a drive's text. Return its robots' class. UnitError for faults, CodeNotRunError if no code may run."""
    check_may_run(Path("drive"))
    module = ModuleType(f"_vdfmu_drive_{sha256(text.encode()).hexdigest()[:12]}")
    sys.modules[module.__name__] = module
    try:
        exec(compile(text, _FILE, "exec"), vars(module))
    except SyntaxError as error:
        raise UnitError(f"drive, line {error.lineno}: {error.msg}.") from None
    except Exception as error:  # whatever code of others raises
        raise UnitError(f"{_place(error)}: {kind_text(error)}.") from None
    members: dict[str, Any] = dict(vars(module))
    options = {n: value for n, value in members.items() if isinstance(value, DriveOption) and not n.startswith("_")}
    tables = [t for t in members.values() if dataclasses.is_dataclass(t) and t.__module__ == module.__name__]
    fields = [f for table in tables for f in dataclasses.fields(table) if f.metadata]
    rows = {f.name: Row(f.name, *f.metadata["row"], **f.metadata["rest"]) for f in fields}
    _check(options, rows)
    attributes: dict[str, Any] = {"rows": PARAMETERS | rows, "own_options": tuple(options.values()), "drive": text}
    attributes["joint_fields"] = (*Robot.joint_fields, *(name for name, row in rows.items() if not row.shape))
    attributes |= {"__doc__": Robot.__doc__, "__reduce__": _reduced}
    robot: Any = type("Robot", (*tables, Robot), attributes)  # pyright: ignore[reportArgumentType]
    return dataclasses.dataclass(frozen=True, eq=False, kw_only=True)(robot)


def _check(options: Mapping[str, DriveOption], rows: Mapping[str, Row]) -> None:
    """Raise UnitError without a drive, or for a name that every arm has already."""
    if not options:
        raise UnitError("drive: the file must have a DriveOption of vdfmu.drive, such as MY_DRIVE = DriveOption(...).")
    names = [*rows, *dict.fromkeys(row.section for row in rows.values())]
    every = {f.name for f in dataclasses.fields(Robot)}
    if taken := {name for name in names if name in every or names.count(name) > 1}:
        raise UnitError(f"drive: {', '.join(sorted(taken))}: a name must be new, every arm has these. Rename them.")


def check_laws(robot: Robot) -> None:
    """Call each law of its own drive once, with 0.1 for every number of a joint. UnitError for one that fails."""
    x = np.full(robot.n, 0.1)
    friction, sliding, motion = Friction(x, x), Sliding(x, x, x, x), JointMotion(x, x, x, x, x, x, x)
    for option in robot.own_options:
        state = x if option.state else None
        calls: list[tuple[str, type, tuple[Any, ...]]] = [
            ("spring", Spring, (Spring(x, x, x), robot, x)),
            ("parallel", Parallel, (robot, x, state)),
            ("friction", Friction, (friction, robot, sliding, state)),
            ("friction", Friction, (friction, robot, sliding, None)),  # along a planned motion
            ("link", LinkTorque, (robot, x, x)),
            ("motor", object, (x, robot, x, state)),
            ("rate", object, (robot, motion, state)),
            ("rest", object, (robot, x)),
        ]
        for name, kind, arguments in calls:
            if (law := getattr(option, name)) is not None:
                _check_law(name, law, kind, arguments)


def _check_law(name: str, law: Law, kind: Any, arguments: tuple[Any, ...]) -> None:
    """Raise UnitError if a law fails for its arguments, or returns something of another kind."""
    try:
        with np.errstate(all="ignore"):
            result = law(*arguments)
    except Exception as error:  # whatever code of others raises
        raise UnitError(f"{_place(error)}: the law {name} fails: {kind_text(error).rstrip('.')}.") from None
    if not isinstance(result, kind):
        where = f"{_FILE}, line {code.co_firstlineno}" if (code := getattr(law, "__code__", None)) else _FILE
        expected = f"{kind.__name__}({', '.join(kind._fields)})"
        raise UnitError(f"{where}: the law {name} must return {expected}, got {type(result).__name__}.")


def _reduced(robot: Robot) -> tuple[Any, ...]:
    """Pickle a robot whose class is in no module."""
    return _restored, (robot.drive, {f.name: getattr(robot, f.name) for f in dataclasses.fields(robot)})


def _restored(text: str, fields: dict[str, Any]) -> Robot:
    return robot_class(text)(**fields)
