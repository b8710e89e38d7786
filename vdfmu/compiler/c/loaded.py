"""Rows of traced functions evaluated by compiled code, fast enough for a solver or a Python loop."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from ctypes import POINTER, c_size_t, c_void_p

import casadi as ca
import numpy as np

from vdfmu.base.arrays import Floats
from vdfmu.base.compile import SHOWN, loaded
from vdfmu.base.errors import FmuError, KernelError
from vdfmu.base.platforms import native_available
from vdfmu.compiler.c.functions import kernel_source
from vdfmu.compiler.c.text import c_prototype, elementary_files


def compiled_rows(function: ca.Function) -> Callable[[Sequence[Floats], Floats], None] | None:
    """Return a function that sets the rows of an array (k, m) from rows of its arguments; None without the compiler.

    Each argument is (k, size), or (size,) for the same in each row.
    """
    if not native_available():
        return None
    argument_texts = [f"given[{i}] + k * step[{i}]" for i in range(function.n_in())]
    text = f"""#include <stddef.h>

{SHOWN}
{c_prototype(function)};
SHOWN void rows(const double *const *given, const size_t *step, double *out, size_t n)
{{
    for (size_t k = 0; k < n; k++)
        {function.name()}({", ".join(argument_texts)}, out + k * {function.numel_out(0)});
}}
"""
    try:
        files = {"rows.c": text, f"kernel_{function.name()}.c": kernel_source(function), **elementary_files()}
        rows = loaded({name: content.encode() for name, content in files.items()}, "rows").rows
    except (FmuError, KernelError):  # no disk space, or an operation without C text
        return None
    rows.argtypes, rows.restype = (POINTER(c_void_p), POINTER(c_size_t), c_void_p, c_size_t), None

    def run(arguments: Sequence[Floats], out: Floats) -> None:
        arrays = [np.ascontiguousarray(array) for array in arguments]
        pointers = (c_void_p * len(arrays))(*(array.ctypes.data for array in arrays))
        steps = (c_size_t * len(arrays))(*(array.shape[1] if array.ndim == 2 else 0 for array in arrays))
        rows(pointers, steps, out.ctypes.data, len(out))

    return run
