"""Traced functions, cached on disk, called through prepared buffers."""

from __future__ import annotations

import math
import signal
import threading
from collections.abc import Collection, Mapping, Sequence
from pathlib import Path

import casadi as ca
import numpy as np
import numpy.typing as npt

from vdfmu.arm.robot import Robot
from vdfmu.arm.robot.structure import structure_key, values
from vdfmu.arm.robot.traced import FUNCTIONS, trace
from vdfmu.base.arrays import Floats
from vdfmu.base.errors import KernelError
from vdfmu.base.interrupt import listening
from vdfmu.compiler.functions.cache import cache_folder, load, store
from vdfmu.compiler.functions.derivatives import DIRECTIONS


class KernelFunction:
    """A traced function with buffers for its arguments and results.

    For speed, write into `args[name]`, call :meth:`run`, read `results[name]`; nothing is allocated. Keep the object as
    long as its `run` is called: the buffers are its own. Calling
    the object does the same with a check of shapes and copies of the results.

    Parameters
    ----------
    function : casadi.Function
    buffers : mapping of str to numpy.ndarray, optional
        Memory of the caller for some arguments or results, contiguous float arrays of the right length: the
        function reads and writes there without a copy.

    Attributes
    ----------
    args, results : dict of str to numpy.ndarray
        Float arrays, (m,). A rotation is laid out row by row, a Jacobian, which is CasADi's, column by column.
    """

    def __init__(self, function: ca.Function, buffers: Mapping[str, Floats] | None = None) -> None:
        self.function = function
        given = buffers or {}
        self.args = {name: _buffer(given, name, function.numel_in(name)) for name in function.name_in()}
        self.results = {name: _buffer(given, name, function.numel_out(name)) for name in function.name_out()}
        self._buffer, self.run = function.buffer()
        # casadi's stub asks for a size that the wrapper takes from the memory
        for i, array in enumerate(self.args.values()):
            self._buffer.set_arg(i, memoryview(array.data))  # pyright: ignore[reportCallIssue]
        for i, array in enumerate(self.results.values()):
            self._buffer.set_res(i, memoryview(array.data))  # pyright: ignore[reportCallIssue]

    def __call__(self, *arguments: npt.ArrayLike) -> Floats | tuple[Floats, ...]:
        """Run on `arguments`, in the order of `args`; return a copy of each result."""
        if len(arguments) != len(self.args):
            raise KernelError(
                f"{self.function.name()}: expected {len(self.args)} arguments ({', '.join(self.args)}), "
                f"got {len(arguments)}."
            )
        for (name, array), value in zip(self.args.items(), arguments, strict=True):
            value = np.asarray(value, dtype=float).ravel()
            if value.shape != array.shape:
                raise KernelError(
                    f"{self.function.name()}: {name}: expected {len(array)} numbers, got {len(value)}."
                )
            array[:] = value
        self.run()
        results = tuple(array.copy() for array in self.results.values())
        return results[0] if len(results) == 1 else results


def _buffer(given: Mapping[str, Floats], name: str, size: int) -> Floats:
    array = given.get(name)
    if array is None:
        return np.zeros(size)
    if array.shape != (size,) or array.dtype != np.float64 or not array.flags.c_contiguous:
        raise KernelError(f"buffer of {name}: expected a contiguous float array of shape ({size},).")
    return array


class Functions:
    """Traced functions of one structure, each traced or loaded when it is first asked for.

    Parameters
    ----------
    key : str
        What decides the functions: their folder in the cache.
    cache : path or None, optional
        Folder of the cache; None traces every time. Default is :func:`cache_folder`.
    """

    def __init__(self, key: str, cache: Path | None | str = "default") -> None:
        self._cache = cache_folder() if cache == "default" else Path(cache) if cache is not None else None
        self._key = key
        self._known: dict[str, ca.Function] = {}

    def names(self) -> Collection[str]:
        """Names of the functions, but for derivatives of them."""
        raise NotImplementedError

    def made(self, name: str) -> ca.Function:
        """Trace one of :meth:`names`."""
        raise NotImplementedError

    def casadi_function(self, name: str) -> ca.Function:
        """CasADi function of a name, or ``<name>_forward`` or ``<name>_reverse``, see :mod:`.derivatives`."""
        if name not in self._known:
            if name not in self.names() and self._derivative(name) is None:
                raise KernelError(
                    f"There is no traced function {name!r}. There are: {', '.join(self.names())}."
                )
            with listening(signal.SIGINT):  # of which CasADi would drop what the default handler raises
                self._known[name] = self._casadi_function(name)
        return self._known[name]

    def _derivative(self, name: str) -> tuple[str, str] | None:
        """Return function and direction of the name of a derivative; None for any other name."""
        base, _, direction = name.rpartition("_")
        return (base, direction) if direction in DIRECTIONS and base in self.names() else None

    def _casadi_function(self, name: str) -> ca.Function:
        if self._cache is None:
            return self._made(name)
        path = self._cache / self._key / f"{name}.casadi"
        stored = load(path)
        if stored is not None:
            loaded = ca.Function.deserialize(stored.decode("ascii"))
            if loaded.name() == name:
                return loaded
        function = self._made(name)  # an unreadable or wrong file is replaced
        store(path, function.serialize().encode("ascii"))
        return function

    def _made(self, name: str) -> ca.Function:
        derivative = self._derivative(name)
        if derivative is None:
            return self.made(name)
        base, direction = derivative
        return DIRECTIONS[direction](self.casadi_function(base))

    def function(self, name: str, /, **buffers: Floats) -> KernelFunction:
        """Return a function with buffers of its own, so that two users of it do not meet.

        Parameters
        ----------
        name : str
        **buffers : (m,) arrays
            Memory of the caller for some arguments or results, see :class:`KernelFunction`.
        """
        return KernelFunction(self.casadi_function(name), buffers)


class Kernel(Functions):
    """The functions of :data:`~vdfmu.arm.robot.traced.FUNCTIONS` for one robot structure.

    Parameters
    ----------
    robot : Robot
        Its structure decides the functions; `p` holds the values of its run-time parameters.
    cache : path, None or "default"
        As of :class:`Functions`.
    """

    def __init__(self, robot: Robot, cache: Path | None | str = "default") -> None:
        super().__init__(structure_key(robot), cache)
        self.robot = robot
        self.p = values(robot)
        self._prepared = threading.local()

    def names(self) -> Collection[str]:
        """Names of the functions, but for derivatives of them."""
        return FUNCTIONS.keys()

    def made(self, name: str) -> ca.Function:
        """Trace one of :meth:`names`."""
        return trace(name, self.robot)

    def rows(self, name: str, arguments: Sequence[npt.ArrayLike], sizes: Sequence[int]) -> Floats:
        """Call a function of one result for arrays (m,) or batches (k, m), with this robot's parameters."""
        prepared = getattr(self._prepared, name, None)
        if prepared is None:
            prepared = _Prepared(self.casadi_function(name), sizes, self.p)
            setattr(self._prepared, name, prepared)
        if prepared.takes(arguments):
            return prepared.calculated()
        names = list(prepared.buffers)
        arrays = [_checked(name, a, v, size) for a, v, size in zip(names, arguments, sizes, strict=True)]
        batches = {len(a) for a in arrays if a.ndim == 2}
        if len(batches) > 1:
            raise KernelError(f"{name}: batches of different lengths {sorted(batches)}: expected one length.")
        out = np.empty((batches.pop() if batches else 1, len(prepared.result)))
        self.calculate(name, prepared, arrays, out)
        return out if any(array.ndim == 2 for array in arrays) else out[0]

    def calculate(
        self,
        name: str,
        prepared: _Prepared,
        arrays: Sequence[Floats],
        out: Floats,
    ) -> None:
        """Calculate a batch: the rows of `out` from those of `arrays`, of which each may be a single one."""
        wide = [np.broadcast_to(a, (len(out), a.shape[-1])) for a in arrays]
        for result, *row in zip(out, *wide, strict=True):
            for buffer, array in zip(prepared.buffers.values(), row, strict=True):
                buffer[:] = array
            result[:] = prepared.calculated()


class _Prepared:
    """A function of one result with buffers for one state; each thread has its own."""

    def __init__(self, function: ca.Function, sizes: Sequence[int], p: Floats) -> None:
        self._all = np.zeros(sum(sizes))
        parts = np.split(self._all, np.cumsum(sizes)[:-1])
        self.buffers = dict(zip(function.name_in(), parts, strict=False))
        """Of the arguments but for the parameters, next to each other in memory."""
        self._function = KernelFunction(function, {**self.buffers, "p": p})
        (self.result,) = self._function.results.values()
        self._places = [(buffer, buffer.shape) for buffer in parts]

    def takes(self, arguments: Sequence[npt.ArrayLike]) -> bool:
        """Take over arguments if they are those of one state, and small enough that their squares are finite."""
        try:
            for (buffer, shape), argument in zip(self._places, arguments, strict=True):
                array = np.asarray(argument, dtype=float)
                if array.shape != shape:
                    return False
                buffer[:] = array
        except (TypeError, ValueError):
            return False
        return math.isfinite(self._all.dot(self._all))

    def calculated(self) -> Floats:
        """Return the result for what the buffers hold."""
        self._function.run()
        return self.result.copy()


def _checked(function: str, name: str, value: npt.ArrayLike, size: int) -> Floats:
    try:
        array = np.asarray(value, dtype=float)
    except (TypeError, ValueError) as error:
        raise KernelError(
            f"{function}: {name}: expected numbers of shape ({size},) or (m, {size}): {error}"
        ) from error
    if array.ndim not in (1, 2) or array.shape[-1] != size:
        raise KernelError(f"{function}: {name}: expected shape ({size},) or (m, {size}), got {array.shape}.")
    if not np.all(np.isfinite(array)):
        where = np.argwhere(~np.isfinite(array))[0].tolist()
        raise KernelError(f"{function}: {name}{where}: expected a finite number, got {array[tuple(where)]}.")
    return array
