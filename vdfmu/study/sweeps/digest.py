"""Digest of a function or of data, because a study with another user function is a different study.

It covers the code of the function, its defaults and closure, and the numbers, functions and modules that it names.
Functions and modules of installed packages are represented by their names.
"""

from __future__ import annotations

import dis
import hashlib
import io
import pickle
import sysconfig
from collections.abc import Iterator
from contextlib import suppress
from dataclasses import fields, is_dataclass
from functools import partial
from itertools import chain
from pathlib import Path
from types import CodeType, FunctionType, MethodType, ModuleType
from typing import Any

import numpy as np

from vdfmu.base.files import PACKAGE

_INSTALLED = (*(sysconfig.get_path(name) for name in ("stdlib", "platstdlib", "purelib", "platlib")), str(PACKAGE))
_MOST = 1000
"""Most elements of a container that are digested one by one; a larger container is digested as a pickle."""
_PLAIN = (bool, int, float, complex, str, bytes, type(None), np.generic)


def value_digest(value: Any) -> str:
    """Return the digest of a function, a callable object, or data. Other objects that cannot be pickled are ignored."""
    return hashlib.sha256(b"\0".join(_facts(value, {}))).hexdigest()[:16]


def _facts(value: Any, seen: dict[int, Any]) -> Iterator[bytes]:
    """Yield the bytes that determine a value, omitting functions, classes and parents that were `seen`.

    For an object of this package only its fields count, not its caches.
    """
    if not isinstance(value, _PLAIN):
        if id(value) in seen:
            return
        seen[id(value)] = value
    inner: list[Any] = []
    if isinstance(value, ModuleType):
        yield value.__name__.encode()
        if _is_own(file := getattr(value, "__file__", None) or ""):
            with suppress(OSError):
                yield Path(file).read_bytes()
    elif isinstance(value, partial):
        yield b"partial"
        inner = [value.func, *value.args, *chain(*sorted(value.keywords.items()))]
    elif isinstance(value, MethodType):
        inner = [value.__func__, value.__self__]
    elif isinstance(value, FunctionType):
        yield f"{value.__module__}.{value.__qualname__}".encode()
        if _is_own(value.__code__.co_filename):
            yield from _code(value.__code__)
            inner = [*(value.__defaults__ or ()), *chain(*sorted((value.__kwdefaults__ or {}).items()))]
            for cell in value.__closure__ or ():
                with suppress(ValueError):  # in a function that names itself, still empty
                    inner.append(cell.cell_contents)
            inner += [value.__globals__[name] for name in _named(value.__code__) if name in value.__globals__]
    elif isinstance(value, type):
        yield f"{value.__module__}.{value.__qualname__}".encode()
        inner = _methods(value)
    elif is_dataclass(value):
        inner = [type(value), *(getattr(value, field.name) for field in fields(value))]
    elif isinstance(value, (list, tuple)) and len(value) <= _MOST:
        inner = [type(value), *value]
    elif isinstance(value, dict) and len(value) <= _MOST:
        inner = [*value, *value.values()]
    elif isinstance(value, (set, frozenset)):
        yield repr(sorted(value, key=repr)).encode()
    elif any(_is_own(method.__code__.co_filename) for method in _methods(type(value))):
        inner = [type(value), *vars(value), *vars(value).values()] if hasattr(value, "__dict__") else [type(value)]
    else:
        yield type(value).__qualname__.encode()
        if not type(value).__module__.startswith(f"{PACKAGE.name}."):
            with suppress(Exception):  # it counts only if it can
                yield _pickled(value)
    for part in inner:
        yield from _facts(part, seen)
    if not isinstance(value, (FunctionType, ModuleType, type)):
        seen.pop(id(value), None)  # it does not matter whether two equal values are one object


def _methods(kind: type) -> list[FunctionType]:
    return [value for value in vars(kind).values() if isinstance(value, FunctionType)]


def _is_own(file: str) -> bool:
    """Return whether a file, or text from a terminal or notebook, belongs to the user."""
    return bool(file) and not file.startswith(("<frozen", *_INSTALLED))


def _pickled(value: Any) -> bytes:
    """Return the pickle, independent of which parts of the value are one object."""
    buffer = io.BytesIO()
    pickler = pickle.Pickler(buffer, pickle.DEFAULT_PROTOCOL)
    pickler.fast = True
    pickler.dump(value)
    return buffer.getvalue()


def _codes(code: CodeType) -> Iterator[CodeType]:
    """Yield the code and the code of functions inside."""
    yield code
    for value in code.co_consts:
        if isinstance(value, CodeType):
            yield from _codes(value)


def _code(code: CodeType) -> Iterator[bytes]:
    """Yield instructions, names and constants, without places in files."""
    for part in _codes(code):
        yield part.co_code
        yield repr(part.co_names).encode()
        for value in part.co_consts:
            if isinstance(value, frozenset):  # whose order differs between processes
                value = sorted(value, key=repr)
            if not isinstance(value, CodeType):
                yield repr(value).encode()


def _named(code: CodeType) -> list[str]:
    """Return the global names that a function reads."""
    read = (i for part in _codes(code) for i in dis.get_instructions(part) if i.opname in ("LOAD_GLOBAL", "LOAD_NAME"))
    return sorted({i.argval for i in read})
