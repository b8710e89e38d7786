"""Drives from a user's file: options as in `vdfmu.arm.drive`, and the class of their robots."""

from __future__ import annotations

import dataclasses
import sys
import traceback
from collections.abc import Mapping
from functools import lru_cache
from hashlib import sha256
from types import ModuleType
from typing import Any

from vdfmu.arm.drive.option import DriveOption
from vdfmu.arm.robot.drive_file import DriveFile
from vdfmu.arm.robot.parameters import PARAMETERS, Row
from vdfmu.arm.robot.robot import Robot
from vdfmu.base.errors import UnitError
from vdfmu.base.text import kind_text
from vdfmu.base.trust import before_code


@lru_cache(maxsize=32)
def robot_class(drive: DriveFile) -> type[Robot]:
    """Run the file of a drive; return its robots' class. UnitError for faults, CodeNotRunError if it must not run."""
    name, file = drive.name, drive.place or drive.name
    try:
        code = compile(drive.text, file, "exec")
    except SyntaxError as error:
        raise UnitError(f"{name}, line {error.lineno}: {error.msg}.") from None
    except (ValueError, RecursionError, MemoryError) as error:
        raise UnitError(f"{name}: cannot be read as Python: {error or type(error).__name__}.") from None
    before_code(file)
    module = ModuleType(f"_vdfmu_drive_{sha256(drive.text.encode()).hexdigest()[:12]}")
    sys.modules[module.__name__] = module
    try:
        exec(code, vars(module))
    except (Exception, SystemExit) as error:  # whatever foreign code raises
        lines = [f.lineno for f in traceback.extract_tb(error.__traceback__) if f.filename == file]
        raise UnitError(f"{name}, line {lines[-1]}: {kind_text(error)}." if lines else f"{name}: {error}.") from None
    members: dict[str, Any] = dict(vars(module))
    options = {n: value for n, value in members.items() if isinstance(value, DriveOption) and not n.startswith("_")}
    tables = [t for t in members.values() if dataclasses.is_dataclass(t) and t.__module__ == module.__name__]
    fields = [f for table in tables for f in dataclasses.fields(table) if f.metadata]
    rows = {f.name: Row(f.name, *f.metadata["row"], **f.metadata["rest"]) for f in fields}
    _check(name, options, rows)
    attributes: dict[str, Any] = {"rows": PARAMETERS | rows, "own_options": tuple(options.values()), "drive": drive}
    attributes["joint_fields"] = (*Robot.joint_fields, *(name for name, row in rows.items() if not row.shape))
    attributes |= {"__doc__": Robot.__doc__, "__reduce__": _reduced}
    robot: Any = type("Robot", (*tables, Robot), attributes)  # pyright: ignore[reportArgumentType]
    return dataclasses.dataclass(frozen=True, eq=False, kw_only=True)(robot)


def _check(file: str, options: Mapping[str, DriveOption], rows: Mapping[str, Row]) -> None:
    """Raise UnitError if there is no drive, or for a name that every arm already has."""
    if not options:
        raise UnitError(f"{file} must have a DriveOption of vdfmu.drive, such as MY_DRIVE = DriveOption(...).")
    names = [*rows, *dict.fromkeys(row.section for row in rows.values())]
    every = {f.name for f in dataclasses.fields(Robot)}
    if taken := {name for name in names if name in every or names.count(name) > 1}:
        raise UnitError(f"{file}: {', '.join(sorted(taken))}: every arm already has such names. Rename them.")


def _reduced(robot: Robot) -> tuple[Any, ...]:
    """Pickle a robot whose class is not in a module."""
    return _restored, (robot.drive, {f.name: getattr(robot, f.name) for f in dataclasses.fields(robot)})


def _restored(drive: DriveFile, fields: dict[str, Any]) -> Robot:
    return robot_class(drive)(**fields)
