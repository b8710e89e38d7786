"""Traced functions as compiled C, with the compiler and the flags of the native FMUs."""

from __future__ import annotations

import ctypes
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from vdfmu.compiler.c.compile import compile_library
from vdfmu.compiler.c.files import kernel_source
from vdfmu.compiler.c.platforms import PLATFORMS, this_platform
from vdfmu.compiler.functions.functions import Functions


def write_library(functions: Functions, names: Sequence[str], folder: Path, flags: Sequence[str] = ()) -> Path:
    """Compile traced functions into one shared library that exports them.

    Parameters
    ----------
    flags : sequence of str, optional
        Further flags of the compiler.

    Raises
    ------
    FmuError
        If the compiler is not installed.
    """
    sources = {f"kernel_{name}.c": kernel_source(functions.casadi_function(name)).encode() for name in names}
    platform = this_platform()
    library = compile_library(sources, platform, name="kernel", flags=("-fvisibility=default", *flags))
    path = folder / f"kernel{PLATFORMS[platform].suffix}"
    path.write_bytes(library)
    return path


class CompiledFunction:
    """A function of such a library with buffers for its arguments and results, as a `KernelFunction` has them.

    Attributes
    ----------
    args, results : dict of str to (m,) array
    call : ctypes function
    pointers : list of pointers to the buffers, in the order of the function's arguments
    """

    def __init__(self, library: Path, functions: Functions, name: str) -> None:
        function = functions.casadi_function(name)
        self.args = {key: np.zeros(function.numel_in(key)) for key in function.name_in()}
        self.results = {key: np.zeros(function.numel_out(key)) for key in function.name_out()}
        self.call: Any = getattr(ctypes.CDLL(str(library)), name)
        self.call.restype = None
        buffers = [*self.args.values(), *self.results.values()]
        self.pointers = [ctypes.c_void_p(buffer.ctypes.data) for buffer in buffers]

    def run(self) -> None:
        """Call the function on its buffers."""
        self.call(*self.pointers)
