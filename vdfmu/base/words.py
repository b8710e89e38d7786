"""Words that have another name now: those that still work, and say so, and those that are gone, which are answered.

Both tables have, for each place, its old words and the new ones. A place is a function or command, by the name of the
function; no name is that of commands themselves; ``vdfmu`` and ``vdfmu.unit`` are names of the API; ``robots``,
``scenarios`` and ``systems`` keys of files, with the tables that they are in, ``joints.drive.ell``; the class of a unit
its variables.
"""

from __future__ import annotations

import inspect
import warnings
from collections.abc import Callable, Mapping
from functools import wraps
from typing import Any, ParamSpec, TypeVar

from vdfmu.base.progress import warn_once

_P = ParamSpec("_P")
_T = TypeVar("_T")
DEPRECATED: dict[str, dict[str, str]] = {}
"""Words that work on, for two minor versions and six months at least; then their row moves to `RENAMED`."""
RENAMED: dict[str, dict[str, str]] = {
    "": {"models": "robot, scenario or schema"},
    "simulate": {"time_limit": "wait_limit", "plot": "pictures"},
    "federate": {"time_limit": "wait_limit"},
    "Simulator": {"time_limit": "wait_limit"},
    "sweep": {"over": "vary", "keep": "record", "n": "points"},
    "sweep plot": {"measure": "by"},
    "sweep indices": {"measure": "by"},
    "tune": {"over": "combine", "spread_n": "spread_points", "budget": "evaluations"},
    "margins": {"open": "loop"},
    "modes": {"path": "scenario"},
    "identify": {"start": "pose"},
    "ssp": {"format": "ssp"},
}
"""Words that are gone: what takes them is an error that names the new one."""


def new_word(place: str, word: str, words: Mapping[str, Mapping[str, str]] = RENAMED) -> str:
    """Return what an old word is called now, in the form of the old, ``--time-limit`` or ``time_limit``; else empty."""
    new = words.get(place, {}).get(word.lstrip("-").replace("-", "_"), "")
    return f"--{new.replace('_', '-')}" if new and word.startswith("-") else new


def present_word(place: str, word: str, where: str = "", say: Callable[[str], None] = warn_once) -> str:
    """Return a word, or the new one of a deprecated word after a note that names it; `where` begins the note."""
    new = new_word(place, word, DEPRECATED)
    if new:
        say(f"{where}{word} is deprecated; write {new}. It goes with the next major version.")
    return new or word


def warn_python(text: str) -> None:
    """Warn the line outside of the package, and of decorators, that the call came from."""
    level, frame = 1, inspect.currentframe()
    while frame and frame.f_globals["__name__"].partition(".")[0] in ("vdfmu", "contextlib"):
        level, frame = level + 1, frame.f_back
    warnings.warn(text, DeprecationWarning, stacklevel=level)


def present_parameters(name: str, given: Mapping[str, Any]) -> dict[str, Any]:
    """Return the arguments of a function by the present names of its parameters, for a wrapper of the function."""
    return {present_word(name, word, f"{name}(): ", warn_python): value for word, value in given.items()}


def takes_old_words(function: Callable[_P, _T]) -> Callable[_P, _T]:
    """Let a function take its parameters by deprecated names too; one with ``**options`` does so by itself."""

    @wraps(function)
    def called(*args: _P.args, **kwargs: _P.kwargs) -> _T:
        return function(*args, **present_parameters(function.__name__, kwargs))  # type: ignore[arg-type]

    return called


def renamed(module: str, names: Mapping[str, Any], word: str) -> Any:
    """Return what a deprecated name of a public module is now: its ``__getattr__`` calls this with its names."""
    new = present_word(module, word, f"{module}.", warn_python)
    if new not in names:
        raise AttributeError(f"module {module!r} has no attribute {word!r}")
    return names[new]
