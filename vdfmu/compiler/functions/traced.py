"""Traced functions, cached on disk and called through prepared buffers."""

from __future__ import annotations

import signal
from collections.abc import Collection, Mapping
from pathlib import Path
from typing import Any

import casadi as ca
import numpy as np

from vdfmu.base.arrays import Floats
from vdfmu.base.cache import cache_folder, load, store
from vdfmu.base.errors import KernelError
from vdfmu.base.interrupt import listening
from vdfmu.compiler.functions.chain import LOCAL
from vdfmu.compiler.functions.derivatives import DIRECTIONS, derivative


class KernelFunction:
    """A traced function with buffers for its arguments and results.

    Write to `args[name]`, call :meth:`run`, and read `results[name]`; no memory is allocated. Keep the object as long
    as its `run` is called, because it owns the buffers.

    `args` and `results` are float arrays (m,), rotations row by row, Jacobians of CasADi column by column. `buffers`
    may contain contiguous arrays of the caller, which are used without a copy.
    """

    def __init__(self, function: ca.Function, buffers: Mapping[str, Floats] | None = None) -> None:
        self.function = function
        buffers = buffers or {}
        self.args = {name: _buffer(buffers, name, function.numel_in(name)) for name in function.name_in()}
        self.results = {name: _buffer(buffers, name, function.numel_out(name)) for name in function.name_out()}
        self._buffer, self.run = function.buffer()
        # casadi's stub requires a size, but its wrapper reads the size of the memory
        for i, array in enumerate(self.args.values()):
            self._buffer.set_arg(i, memoryview(array.data))  # pyright: ignore[reportCallIssue]
        for i, array in enumerate(self.results.values()):
            self._buffer.set_res(i, memoryview(array.data))  # pyright: ignore[reportCallIssue]


def _buffer(buffers: Mapping[str, Floats], name: str, size: int) -> Floats:
    array = buffers[name] if name in buffers else np.zeros(size)
    if array.shape != (size,) or array.dtype != np.float64 or not array.flags.c_contiguous:
        raise KernelError(f"buffer of {name}: expected a contiguous float array of shape ({size},).")
    return array


class Functions:
    """Traced functions of one structure, each traced or loaded when first used.

    `key` is their folder in `cache`, by default :func:`cache_folder`. Without a cache, None, they are traced each time.
    """

    def __init__(self, key: str, cache: Path | None | str = "default") -> None:
        self._cache = cache_folder() if cache == "default" else Path(cache) if cache is not None else None
        self._key = key
        self._functions: dict[str, ca.Function] = {}

    def names(self) -> Collection[str]:
        """Names of the functions, without derivatives."""
        raise NotImplementedError

    def made(self, name: str) -> ca.Function:
        """Trace one of :meth:`names`."""
        raise NotImplementedError

    def casadi_function(self, name: str) -> ca.Function:
        """Return the CasADi function ``<name>``, ``<name>_forward`` or ``<name>_reverse``, see :mod:`.derivatives`."""
        if name not in self._functions:
            with listening(signal.SIGINT):  # CasADi would drop the exception of the default handler
                self._functions[name] = self._loaded(name)
        return self._functions[name]

    def _loaded(self, name: str) -> ca.Function:
        if self._cache is None:
            return self._made(name)
        path = self._cache / self._key / f"{name}.casadi"
        loaded = load(path, lambda content: ca.Function.deserialize(content.decode("ascii")))
        if loaded is not None and loaded.name() == name:
            return loaded
        function = self._made(name)
        store(path, function.serialize().encode("ascii"))
        return function

    def _made(self, name: str) -> ca.Function:
        if name in self.names():
            return self.made(name)
        base, _, direction = name.rpartition("_")
        if direction in DIRECTIONS and base in self.names():
            return derivative(self.casadi_function(base), direction)
        raise KernelError(f"traced function: must be one of {', '.join(self.names())}, got {name!r}.")

    def function(self, name: str, /, **buffers: Floats) -> KernelFunction:
        """Return a function with its own buffers, or with some of the caller's; see :class:`KernelFunction`."""
        function = self.casadi_function(name)
        if any(callee.name().startswith(LOCAL) for callee in function.find_functions(0)):
            function = function.expand(name)  # CasADi takes twice as long with calls of parts
        return KernelFunction(function, buffers)


def renamed(function: ca.Function, name: str) -> ca.Function:
    """Return a function with another name."""
    symbols = (ca.SX if function.is_a("SXFunction") else ca.MX).sym
    inputs: list[Any] = [symbols(each, function.sparsity_in(each)) for each in function.name_in()]
    return ca.Function(name, inputs, function.call(inputs, True), function.name_in(), function.name_out())


def traced_function(name: str, inputs: dict[str, ca.SX], outputs: dict[str, ca.SX]) -> ca.Function:
    """Make a function of named columns."""
    # cse merges terms that the equations compute more than once, such as the motion in all solver stages
    expressions = ca.cse([ca.densify(expression) for expression in outputs.values()])
    return ca.Function(name, list(inputs.values()), expressions, list(inputs), list(outputs))
