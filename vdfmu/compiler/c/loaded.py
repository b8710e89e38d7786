"""Compiled functions in this process: what is fast enough for a solver, a loop of Python, or the rows of arrays."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from ctypes import CDLL, POINTER, c_size_t, c_void_p
from pathlib import Path
from typing import TypeVar

import casadi as ca
import numpy as np

from vdfmu.base.arrays import Floats
from vdfmu.base.errors import FmuError, KernelError
from vdfmu.base.files import temporary_folder
from vdfmu.compiler.c.compile import compile_library
from vdfmu.compiler.c.expressions import c_prototype
from vdfmu.compiler.c.files import kernel_source
from vdfmu.compiler.c.platforms import PLATFORMS, native_available, this_platform

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


def compiled_rows(function: ca.Function) -> Callable[[Sequence[Floats], Floats], None] | None:
    """Return what sets the rows of an array (k, m) to a function of the rows of others; None without the compiler.

    Each argument is (k, size), or (size,) for the same in each row.
    """
    if not native_available():
        return None
    given = [f"given[{i}] + k * step[{i}]" for i in range(function.n_in())]
    text = f"""#include <stddef.h>

{SHOWN}
{c_prototype(function)};
SHOWN void rows(const double *const *given, const size_t *step, double *out, size_t n);

void rows(const double *const *given, const size_t *step, double *out, size_t n)
{{
    for (size_t k = 0; k < n; k++)
        {function.name()}({", ".join(given)}, out + k * {function.numel_out(0)});
}}
"""
    try:
        files = {"rows.c": text.encode(), f"kernel_{function.name()}.c": kernel_source(function).encode()}
        rows = loaded(files, "rows").rows
    except (FmuError, KernelError):  # no room, or an operation that has no C text
        return None
    rows.argtypes, rows.restype = (POINTER(c_void_p), POINTER(c_size_t), c_void_p, c_size_t), None

    def run(arguments: Sequence[Floats], out: Floats) -> None:
        arrays = [np.ascontiguousarray(array) for array in arguments]
        pointers = (c_void_p * len(arrays))(*(array.ctypes.data for array in arrays))
        steps = (c_size_t * len(arrays))(*(array.shape[1] if array.ndim == 2 else 0 for array in arrays))
        rows(pointers, steps, out.ctypes.data, len(out))

    return run
