"""Compiled functions in this process, fast enough for a solver or a loop of Python."""

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
from vdfmu.compiler.c.functions import kernel_source
from vdfmu.compiler.c.platforms import PLATFORMS, native_available, this_platform
from vdfmu.compiler.c.text import c_prototype

_Library = TypeVar("_Library", bound=CDLL)

SHOWN = """#ifdef _WIN32
#define SHOWN __declspec(dllexport)
#else
#define SHOWN __attribute__((visibility("default")))
#endif
"""
"""C text that defines the mark of functions for Python."""


def loaded(files: Mapping[str, bytes], name: str, kind: type[_Library] = CDLL) -> _Library:
    """Compile C files, or take their library `name` from the cache, and load it.

    `kind`: functions of a `CDLL` let other threads run. For short functions this change takes longer than the function:
    use `PyDLL`. FmuError without a compiler or room.
    """
    return load_library(compile_library(files, this_platform(), name=name), name, kind)


def load_library(library: bytes, name: str, kind: type[_Library] = CDLL) -> _Library:
    """Load a compiled library of this platform."""
    with temporary_folder("vdfmu_library_") as folder:
        path = Path(folder) / f"{name}{PLATFORMS[this_platform()].suffix}"
        path.write_bytes(library)
        return kind(str(path))


def compiled_rows(function: ca.Function) -> Callable[[Sequence[Floats], Floats], None] | None:
    """Return a function that sets the rows of an array (k, m) from rows of its arguments; None without the compiler.

    Each argument is (k, size), or (size,) for the same in each row.
    """
    if not native_available():
        return None
    given = [f"given[{i}] + k * step[{i}]" for i in range(function.n_in())]
    text = f"""#include <stddef.h>

{SHOWN}
{c_prototype(function)};
SHOWN void rows(const double *const *given, const size_t *step, double *out, size_t n)
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
