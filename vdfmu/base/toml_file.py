"""Find, read and write TOML files of robots, scenarios and systems."""

from __future__ import annotations

import json
import os
import re
import tomllib
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any, cast

from vdfmu.base.errors import ModelError, UsageError
from vdfmu.base.files import data_path, read_regular
from vdfmu.base.plugins import Plugins
from vdfmu.base.text import nearest, printable
from vdfmu.base.version import FORMAT, __version__

_DEEPEST = 50
"""Nesting of lists and tables that a file may have. A robot has 7 levels."""
_TOO_DEEP = "expected TOML, got lists or tables that are nested too deeply. Correct the brackets."
_LARGEST = 2**20
"""Largest file [byte]. A robot of 100 joints has 80 kB."""
ROBOTS = Plugins("robots", "robot", "the path of a TOML file", lambda file: Path(file).is_file())


def _folder(kind: str) -> Path:
    return data_path("ssp") if kind == "systems" else data_path("models") / kind


def shipped_names(kind: str) -> list[str]:
    """Return the names of the shipped files of a kind: robots, scenarios or systems."""
    return sorted(path.stem for path in _folder(kind).glob("*.toml"))


def toml_names(kind: str) -> list[str]:
    """Return the names of the files of a kind: shipped ones, then those from plugins."""
    shipped = shipped_names(kind)
    return [*shipped, *ROBOTS.all(shipped)] if kind == "robots" else shipped


def locate(path_or_name: str | os.PathLike[str], folder: str, start: Path | None = None) -> Path:
    """Return the path of a file from its name or path. UsageError for an unknown name."""
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
    """Return the content of a TOML file without its ``format``. ModelError if it cannot be read."""
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
        fix = "Correct that place. Strings need quotes, numbers a digit before the point."
        problem = f"expected TOML, got a syntax error: {error}. {fix}"
    except ValueError as error:  # a number with more digits than Python reads
        problem = f"expected TOML, got unreadable content: {error}. Correct it."
    raise ModelError(f"{path}: {problem}")


def kind_of(content: Mapping[str, Any]) -> str:
    """Return the kind of a file, ``robot``, ``system`` or ``scenario``, by its keys."""
    if isinstance(content.get("joints"), list):
        return "robot"  # the joints of a scenario are a table
    return "scenario" if content.keys().isdisjoint(("components", "units", "extends", "connections")) else "system"


def read_bytes(path: Path, expected: str, largest: int = _LARGEST) -> bytes:
    """Return the content of a regular file of at most `largest` bytes. ModelError with the `expected` kind otherwise.

    Devices and pipes are refused, because reading them may never end.
    """
    try:
        return read_regular(path, largest)
    except FileNotFoundError:
        problem = f"expected {expected}, got nothing: it does not exist. Check the path."
    except (IsADirectoryError, PermissionError) as error:
        problem = f"expected a file that can be read, got: {error.strerror}. Check its permissions."
        if path.is_dir():
            problem = f"expected {expected}, got a directory. Name a file in it."
    except OSError as error:
        problem = f"expected {expected} that can be read, but {error.strerror}. Check the path."
    except ValueError as error:  # an impossible path
        problem = f"expected {expected}, got unreadable content: {error}. Correct it."
    raise ModelError(f"{path}: {problem}")


def _too_deep(data: object, levels: int = _DEEPEST) -> bool:
    """Return whether lists and tables are nested deeper than some levels."""
    children: Any = cast("dict[str, object]", data).values() if isinstance(data, dict) else data
    return not levels or isinstance(data, (dict, list)) and any(_too_deep(each, levels - 1) for each in children)


ROUNDING = 1e-16
"""Largest rounding error of a zero after frames were rotated, relative to the largest number of its list."""


def toml_text(table: Mapping[str, Any], rounding: float = 0.0) -> str:
    """Return the text of a file, in each table the values before the tables. `rounding`: see `toml_value`."""
    return "\n".join(_lines(table, "", rounding)).lstrip("\n") + "\n"


def toml_value(value: Any, rounding: float = 0.0) -> str:
    """Return a value in TOML. Numbers in a list become zero if they are at most `rounding` times its largest."""
    if getattr(value, "ndim", None) == 0:
        value = value.item()  # a scalar of numpy
    if isinstance(value, str):
        return json.dumps(value, ensure_ascii=False).replace("\x7f", "\\u007f")  # JSON allows it unescaped
    if isinstance(value, bool):
        return str(value).lower()
    if not hasattr(value, "__len__"):
        return repr(int(value)) if isinstance(value, int) else repr(float(value))
    import numpy as np  # not for a number

    # an array of texts drops a trailing NUL
    whole = np.asarray(value, dtype=object if any(isinstance(each, str) for each in value) else None)
    if whole.dtype.kind in "Oib":
        return f"[{', '.join(map(toml_value, whole.tolist()))}]"
    clean = np.asarray(value, dtype=float)
    if rounding:
        clean = np.where(np.abs(clean) <= rounding * np.abs(clean).max(initial=0.0), 0.0, clean)
    return f"[{', '.join(toml_value(entry, rounding) for entry in clean)}]"


def _lines(table: Mapping[str, Any], path: str, rounding: float) -> Iterator[str]:
    inner = {key: v for key, v in table.items() if isinstance(v[0] if isinstance(v, list) and v else v, dict)}
    for key, value in table.items():
        if key not in inner:
            yield f"{_key(key)} = {toml_value(value, rounding)}"
    for key, value in inner.items():
        name = f"{path}.{_key(key)}" if path else _key(key)
        for each in value if isinstance(value, list) else [value]:
            yield ""
            yield f"[[{name}]]" if isinstance(value, list) else f"[{name}]"
            yield from _lines(each, name, rounding)


def _key(key: str) -> str:
    return key if re.fullmatch("[A-Za-z0-9_-]+", key) else toml_value(key)


def format_problem(number: object) -> str:
    """Return the problem with a file's key ``format``, or an empty text."""
    if isinstance(number, int) and not isinstance(number, bool) and 1 <= number <= FORMAT:
        return ""
    readable = "1" if FORMAT == 1 else f"1 to {FORMAT}"
    later = isinstance(number, int) and number > FORMAT
    fix = f"A version later than {__version__} wrote it: update vdfmu." if later else "Leave the key out."
    return f"format: expected {readable}, got {number!r}. {fix}"
