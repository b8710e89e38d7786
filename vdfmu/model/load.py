"""Loading of robots and scenarios by name or path."""

from __future__ import annotations

import os
import stat
import tomllib
from pathlib import Path
from typing import Any, cast

from vdfmu.data import data_path
from vdfmu.errors import ModelError, UsageError
from vdfmu.model.read import Problems, nearest, printable
from vdfmu.model.robot import Robot
from vdfmu.model.robot_file import check_robot, robot_from_dict
from vdfmu.model.scenario import Scenario
from vdfmu.model.scenario_file import read_scenario
from vdfmu.model.system_file import SystemFile, read_system_file

__all__ = [
    "check_robot",
    "load_robot",
    "load_scenario",
    "load_system",
    "robot_from_dict",
    "robot_names",
    "scenario_names",
]

_DEEPEST = 50
"""Levels of lists and tables in a file; a robot has 7."""
_TOO_DEEP = "expected TOML, got lists or tables that are nested too deeply. Correct the brackets."


def robot_names() -> list[str]:
    """Return the names of the robots that travel with the package."""
    return _names("robots")


def scenario_names() -> list[str]:
    """Return the names of the scenarios that travel with the package."""
    return _names("scenarios")


def load_robot(path_or_name: str | os.PathLike[str]) -> Robot:
    """Load a robot by the name of a shipped one or by the path of a TOML file.

    A value with a path separator, one that ends in ``.toml`` and the name of an existing file are paths.

    Raises
    ------
    UsageError
        If no shipped robot has the name.
    ModelError
        If the file cannot be read or describes no physical robot; it lists every problem.
    """
    path = _locate(path_or_name, "robots")
    return robot_from_dict(_read(path), str(path))


def load_scenario(path_or_name: str | os.PathLike[str], robot: Robot | str | None = None) -> Scenario:
    """Load a scenario by the name of a shipped one or by the path of a TOML file.

    Parameters
    ----------
    path_or_name : str or path
        As for `load_robot`. A relative path of a robot in the file starts at the file's folder.
    robot : Robot, str or None
        Robot in place of the one that the file names; a str as for `load_robot`. The paper's numbers are
        left out where its name is not the file's.

    Raises
    ------
    UsageError
        If no shipped scenario, or robot given here, has the name.
    ModelError
        If the scenario or its robot has problems; it lists every one of both files.
    """
    path = _locate(path_or_name, "scenarios")
    data = _read(path)
    problems = Problems(str(path))
    written = data.get("robot")
    if isinstance(robot, str):
        robot = load_robot(robot)
    used = robot
    robot_problems: list[str] = []
    if used is None and isinstance(written, str) and written:
        try:
            located = _locate(written, "robots", path.parent)
            used = robot_from_dict(_read(located), str(located))
        except ModelError as error:
            robot_problems = error.problems
        except UsageError as error:
            robot_problems = [f"{path}: robot: {error}"]
    if robot is not None and robot.name != Path(str(written)).stem:
        data.pop("paper", None)
    system: SystemFile | None = None
    named = data.get("system", "system")
    if isinstance(named, str) and named:
        try:
            system = load_system(named, path.parent)
        except ModelError as error:
            robot_problems += error.problems
        except UsageError as error:
            robot_problems.append(f"{path}: system: {error}")
    scenario = read_scenario(problems, data, used, system)
    problems.lines.extend(robot_problems)
    problems.raise_any()
    assert scenario is not None  # else there are problems
    return scenario


def load_system(path_or_name: str | os.PathLike[str], start: Path | None = None) -> SystemFile:
    """Load a system by the name of a shipped one or by the path of a TOML file.

    Parameters
    ----------
    path_or_name : str or path
        As for `load_robot`.
    start : Path, optional
        Folder at which a relative path starts.

    Raises
    ------
    UsageError
        If no shipped system has the name.
    ModelError
        If the file cannot be used; it lists every problem.
    """
    path = _locate(path_or_name, "systems", start)
    data = _read(path)
    problems = Problems(str(path))
    base: SystemFile | None = None
    if "extends" in data:
        try:
            base = load_system(str(data["extends"]), path.parent)
        except RecursionError:
            raise ModelError(f"{path}: extends: the files extend each other.") from None
        except UsageError as error:
            problems.lines.append(f"{path}: extends: {error}")
    system = read_system_file(problems, data, path, base)
    problems.raise_any()
    return system


def _folder(kind: str) -> Path:
    return data_path("ssp") if kind == "systems" else data_path("models") / kind


def _names(kind: str) -> list[str]:
    return sorted(path.stem for path in _folder(kind).glob("*.toml"))


def _locate(path_or_name: str | os.PathLike[str], folder: str, start: Path | None = None) -> Path:
    text = os.fspath(path_or_name)
    path = (start or Path()) / text
    separators = tuple(s for s in (os.sep, os.altsep, "/") if s)
    if os.path.isfile(path) or text.endswith(".toml") or any(s in text for s in separators):
        return path
    if not isinstance(path_or_name, str):
        return path
    shipped = _folder(folder) / f"{text}.toml"
    if text not in _names(folder):
        raise UsageError(
            f"no {folder[:-1]} '{printable(text)}': expected a name or the path of a TOML file. "
            + nearest(text, _names(folder))
        )
    return shipped


def _read(path: Path) -> dict[str, Any]:
    problem: str
    try:
        data = tomllib.loads(_content(path).decode("utf-8-sig"))
        if not _too_deep(data):
            return data
        problem = _TOO_DEEP
    except RecursionError:
        problem = _TOO_DEEP
    except FileNotFoundError:
        problem = "expected a TOML file, got nothing: it does not exist. Check the path."
    except (IsADirectoryError, PermissionError) as error:
        if path.is_dir():
            problem = "expected a TOML file, got a directory. Name a file in it."
        else:
            problem = f"expected a file that can be read, got: {error.strerror}. Check its permissions."
    except OSError as error:
        problem = f"expected a file that can be read, got: {error.strerror}. Check the path."
    except UnicodeDecodeError as error:
        byte = f"byte 0x{error.object[error.start]:02x} at offset {error.start}"
        problem = f"expected UTF-8 text, got {byte}. Save the file as UTF-8."
    except tomllib.TOMLDecodeError as error:
        problem = f"expected TOML, got a syntax error: {error}. Correct that place; strings need quotes."
    except ValueError as error:  # of a number of more digits than Python reads, or a path that no file has
        problem = f"expected TOML, got what cannot be read: {error}. Correct it."
    raise ModelError(f"{path}: {problem}")


_LARGEST = 2**20
"""Bytes of a file; a robot of 100 joints has 80 kB."""


def _content(path: Path) -> bytes:
    """Read a file; `ModelError` for what is no regular file, which may never end, and for one that is too large."""
    status = path.stat()
    if stat.S_ISREG(status.st_mode) or stat.S_ISDIR(status.st_mode):
        with path.open("rb") as stream:
            content = stream.read(_LARGEST + 1)
        if len(content) <= _LARGEST:
            return content
        got = f"{max(status.st_size, len(content)) / 2**20:.3g} MiB"
        problem = f"expected a file of at most {_LARGEST / 2**20:g} MiB, got {got}. Is it the right one?"
    else:
        problem = "expected a regular file, got a pipe, a device or another special file. Name a file."
    raise ModelError(f"{path}: {problem}")


def _too_deep(data: object) -> bool:
    level = [data]
    for _ in range(_DEEPEST):
        level = [inner for value in level for inner in _entries(value)]
    return bool(level)


def _entries(value: object) -> list[object]:
    if isinstance(value, dict):
        return list(cast("dict[str, object]", value).values())
    return cast("list[object]", value) if isinstance(value, list) else []
