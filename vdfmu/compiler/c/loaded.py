"""Compiled functions in this process: what is fast enough for a solver or a loop of Python."""

from __future__ import annotations

from collections.abc import Mapping
from ctypes import CDLL
from pathlib import Path
from typing import TypeVar

from vdfmu.base.files import temporary_folder
from vdfmu.compiler.c.compile import compile_library
from vdfmu.compiler.c.platforms import PLATFORMS, this_platform

_Library = TypeVar("_Library", bound=CDLL)

SHOWN = """#ifdef _WIN32
#define SHOWN __declspec(dllexport)
#else
#define SHOWN __attribute__((visibility("default")))
#endif
"""
"""C text that defines the mark of functions that Python is to find."""


def loaded(files: Mapping[str, bytes], name: str, kind: type[_Library] = CDLL) -> _Library:
    """Compile C files, or take their library from the cache, and load it.

    Parameters
    ----------
    files : mapping of str to bytes
    name : str
        Name of the library.
    kind : type
        `CDLL`, whose functions run while other threads do, or `PyDLL` for those that take less time than that change.

    Raises
    ------
    FmuError
        If there is no compiler, or no room.
    """
    return load_library(compile_library(files, this_platform(), name=name), name, kind)


def load_library(library: bytes, name: str, kind: type[_Library] = CDLL) -> _Library:
    """Load a compiled library of this platform."""
    with temporary_folder("vdfmu_library_") as folder:
        path = Path(folder) / f"{name}{PLATFORMS[this_platform()].suffix}"
        path.write_bytes(library)
        return kind(str(path))
