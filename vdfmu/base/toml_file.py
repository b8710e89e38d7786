"""Finding and reading of the TOML files of robots, scenarios and systems."""

from __future__ import annotations

import os
import stat
import tomllib
from pathlib import Path
from typing import Any, cast

from vdfmu.base.errors import ModelError, UsageError
from vdfmu.base.files import data_path
from vdfmu.base.plugins import Plugins
from vdfmu.base.text import nearest, printable
from vdfmu.base.version import format_problem

_DEEPEST = 50
"""Levels of lists and tables in a file; a robot has 7."""
_TOO_DEEP = "expected TOML, got lists or tables that are nested too deeply. Correct the brackets."


ROBOTS = Plugins("robots", "robot", "the path of a TOML file", lambda found: Path(found).is_file())


def _folder(kind: str) -> Path:
    return data_path("ssp") if kind == "systems" else data_path("models") / kind


def shipped_names(kind: str) -> list[str]:
    """Return the names of the files of a kind, robots, scenarios or systems, that travel with the package."""
    return sorted(path.stem for path in _folder(kind).glob("*.toml"))


def toml_names(kind: str) -> list[str]:
    """Return the names of files of a kind, robots, scenarios or systems: shipped ones, then those that others add."""
    shipped = shipped_names(kind)
    return [*shipped, *ROBOTS.all(shipped)] if kind == "robots" else shipped


def locate(path_or_name: str | os.PathLike[str], folder: str, start: Path | None = None) -> Path:
    """Return the path of a file by its name or path; UsageError if no shipped or added one has the name."""
    text = os.fspath(path_or_name)
    path = (start or Path()) / text
    separators = tuple(s for s in (os.sep, os.altsep, "/") if s)
    if os.path.isfile(path) or text.endswith(".toml") or any(s in text for s in separators):
        return path
    if not isinstance(path_or_name, str):
        return path
    if text in shipped_names(folder):
        return _folder(folder) / f"{text}.toml"
    added = ROBOTS.get(text) if folder == "robots" else None
    if added is None:
        raise UsageError(
            f"no {folder[:-1]} '{printable(text)}': expected a name or the path of a TOML file. "
            + nearest(text, toml_names(folder))
        )
    return Path(added)


def read_toml(path: Path) -> dict[str, Any]:
    """Return the content of a TOML file without its ``format``; ModelError if it cannot be read."""
    problem: str
    try:
        data = tomllib.loads(read_bytes(path, "a TOML file").decode("utf-8-sig"))
        problem = _TOO_DEEP if _too_deep(data) else format_problem(data.pop("format", 1))
        if not problem:
            return data
    except RecursionError:
        problem = _TOO_DEEP
    except UnicodeDecodeError as error:
        byte = f"byte 0x{error.object[error.start]:02x} at offset {error.start}"
        problem = f"expected UTF-8 text, got {byte}. Save the file as UTF-8."
    except tomllib.TOMLDecodeError as error:
        problem = f"expected TOML, got a syntax error: {error}. Correct that place; strings need quotes."
    except ValueError as error:  # of a number of more digits than Python reads
        problem = f"expected TOML, got what cannot be read: {error}. Correct it."
    raise ModelError(f"{path}: {problem}")


_LARGEST = 2**20
"""Bytes of a file; a robot of 100 joints has 80 kB."""


def read_bytes(path: Path, what: str, largest: int = _LARGEST) -> bytes:
    """Return the content of a file; ModelError if it cannot be read.

    No regular file, which may never end, is refused, as is one of more than `largest` bytes; `what` it should be goes
    into the messages.
    """
    try:
        return _content(path, largest)
    except FileNotFoundError:
        problem = f"expected {what}, got nothing: it does not exist. Check the path."
    except (IsADirectoryError, PermissionError) as error:
        if path.is_dir():
            problem = f"expected {what}, got a directory. Name a file in it."
        else:
            problem = f"expected a file that can be read, got: {error.strerror}. Check its permissions."
    except OSError as error:
        problem = f"expected a file that can be read, got: {error.strerror}. Check the path."
    except ValueError as error:  # of a path that no file has
        problem = f"expected {what}, got what cannot be read: {error}. Correct it."
    raise ModelError(f"{path}: {problem}")


def _content(path: Path, largest: int) -> bytes:
    status = path.stat()
    if stat.S_ISREG(status.st_mode) or stat.S_ISDIR(status.st_mode):
        with path.open("rb") as stream:
            content = stream.read(largest + 1)
        if len(content) <= largest:
            return content
        got = f"{max(status.st_size, len(content)) / 2**20:.3g} MiB"
        problem = f"expected a file of at most {largest / 2**20:g} MiB, got {got}. Is it the right one?"
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
