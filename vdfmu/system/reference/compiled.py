"""References in compiled code: DOP853 as scipy has it, and Radau IIA of order 9. scipy repeats intervals."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from ctypes import CDLL, CFUNCTYPE, Structure, addressof, byref, c_double, c_int, c_size_t, c_void_p, cast
from dataclasses import dataclass
from functools import cache
from hashlib import sha256
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from vdfmu.base.arrays import Floats, scipy_part
from vdfmu.base.compile import SHOWN, compile_library, load_library
from vdfmu.base.errors import FmuError, VdfmuError
from vdfmu.base.files import source_bytes
from vdfmu.base.platforms import this_platform
from vdfmu.system.reference.wired import Run, WiredUnits

Tolerances = Mapping[str, float]
Move = Callable[[float, float], None]
"""Moves states from a time [s] to another."""
_FILES = [Path(__file__).with_name(name) for name in ("dop853.c", "radau.c", "rows.c", "solvers.h")]
_FLAGS = ("-fno-unroll-loops",)
"""They take a third of the compile time; unrolled loops are no faster."""
_FIRST = 1e-4
"""First step of a continuous reference [s]."""
_FAILED = -1
_OTHER = CFUNCTYPE(c_int, c_double, c_double)


def _fields(pointers: str, numbers: str = "", sizes: str = "") -> list[tuple[str, Any]]:
    kinds = {c_void_p: pointers, c_double: numbers, c_size_t: sizes}
    return [(name, kind) for kind, names in kinds.items() for name in names.split()]


class _Problem(Structure):
    _fields_ = [*_fields("rate x x_dot room", sizes="n"), ("relative", c_double), ("absolute", c_double)]


class _Tables(Structure):
    _fields_ = _fields("A B C E3 E5")


class _Mover(Structure):
    _fields_ = [("problem", _Problem), *_fields("other"), ("steps", c_int), ("wait", c_int)]


class _Memory(Structure):
    _fields_ = _fields("m tables shown fed x", sizes="size shown_count fed_count x_count")


class _Motion(Structure):
    _fields_ = [*_fields("", "t stop h longest"), ("is_old", c_int)]


@cache
def _library() -> CDLL | None:
    """Return the library; None without a compiler or room."""
    sources = {file.name: (SHOWN.encode() if file.stem == "rows" else b"") + file.read_bytes() for file in _FILES}
    try:
        library = load_library(compile_library(sources, this_platform(), name="references", flags=_FLAGS), "references")
    except FmuError:
        return None
    library.sampled_rows.argtypes = [c_void_p, c_void_p, c_size_t, *[c_void_p] * 3, c_size_t, c_size_t, *[c_void_p] * 5]
    library.continuous_rows.argtypes = [*[c_void_p] * 5, c_size_t, c_void_p, c_void_p]
    library.sampled_rows.restype = library.continuous_rows.restype = c_size_t
    library.room.argtypes, library.room.restype = [c_size_t], c_size_t
    library.begin.argtypes = [c_void_p]
    return library


def source_key() -> str:
    """Return a digest of the C text."""
    return sha256(b"".join(map(source_bytes, _FILES))).hexdigest()


def compiles(run: Mapping[str, Run]) -> bool:
    """Whether the functions of a system are those of a compiled library, and the solvers can be compiled too."""
    return all(hasattr(each, "argtypes") for each in run.values()) and _library() is not None


@cache
def _tables() -> tuple[_Tables, list[Floats]]:
    """Return the coefficients of DOP853, and the arrays that hold them."""
    tables = scipy_part("scipy.integrate._ivp.dop853_coefficients")
    arrays = [np.ascontiguousarray(getattr(tables, name)) for name in ("A", "B", "C", "E3", "E5")]
    return _Tables(*(numbers.ctypes.data for numbers in arrays)), arrays


@dataclass
class Repeated:
    """Intervals of a compiled solution that scipy solved too."""

    intervals: int = 0
    difference: float = 0.0
    """Largest difference of a state [SI]."""

    @property
    def entries(self) -> dict[str, float]:
        """Return the entries of a summary; empty for a solution only by scipy."""
        return {"solved_by_scipy": self.intervals, "max_solver_difference": self.difference} if self.intervals else {}


class CompiledRows:
    """Rows of a system's outputs in compiled code, block by block.

    Attributes
    ----------
    before : (m, n) array
        For each row of the last block, the memory before its interval; of a continuous reference the states.
    after : (m, n_x) array
        States after it.
    intervals : (m, 2) array
        Start and end [s].
    """

    def __init__(self, system: WiredUnits, places: npt.NDArray[np.intp]) -> None:
        library = _library()
        assert library is not None
        self._library, self._system, self._places = library, system, places
        tables, *arrays = _tables()
        fed = np.array([place for place, _ in system.outside], np.intp)
        self._kept: list[Any] = [places, fed, tables, arrays]
        pointers = [system.memory.ctypes.data, addressof(tables)]
        pointers += [each.ctypes.data for each in (places, fed, system.x)]
        self._memory = _Memory(*pointers, system.memory.size, places.size, fed.size, system.x.size)
        self.before = self.after = self.intervals = np.empty((0, 0))

    def blocks(self, t: Floats, every: int, block: int) -> Iterator[Floats]:
        """Yield the outputs (m, k) at each `every`-th of the times `t` [s], at most `block` rows at a time."""
        start, m = self._system.memory[self._places], (t.size - 1) // every
        for first in range(0, m + 1, block):
            begin, end = max(first, 1), min(first + block, m + 1)
            out = np.empty((end - first, start.size))
            out[:1] = start  # replaced in all blocks but the first
            times = t[(begin - 1) * every : (end - 1) * every + 1]
            self.intervals = np.stack([times[every - 1 : -1 : every], times[every::every]], axis=1)
            self._advance(times, every, out[begin - first :])
            yield out

    def _advance(self, times: Floats, every: int, out: Floats) -> None:
        """Calculate rows of a block, from the state at the first of the times."""
        raise NotImplementedError

    def _problem(self, rate: Any, x: Floats, x_dot: Floats, tolerances: Tolerances) -> _Problem:
        """Return what both solvers integrate, with their memory."""
        room = np.zeros(self._library.room(x.size))
        self._kept.append(room)
        data = (cast(rate, c_void_p), x.ctypes.data, x_dot.ctypes.data, room.ctypes.data, x.size)
        problem = _Problem(*data, tolerances["rtol"], tolerances["atol"])
        self._library.begin(byref(problem))
        return problem


class CompiledSampled(CompiledRows):
    """Rows of a sampled reference. `moves` move the states of units that the compiled solver cannot.

    Before the interval of a row, the solver of each unit took ``steps[row]``, (m, k): this decides its first step.
    """

    steps: npt.NDArray[np.intc]

    def __init__(
        self, system: WiredUnits, places: npt.NDArray[np.intp], names: Sequence[str], run: Mapping[str, Run],
        moves: Mapping[str, Move], tolerances: Tolerances,
    ) -> None:  # fmt: skip
        super().__init__(system, places)
        self._names, self._error = names, None
        self._movers = (_Mover * len(names))()
        for i, (name, mover) in enumerate(zip(names, self._movers, strict=True)):
            mover.steps = 1
            if name in moves:
                call = _OTHER(self._caught(moves[name]))
                self._kept.append(call)
                mover.other = cast(call, c_void_p)
            else:
                unit = system.units[name]
                mover.problem = self._problem(run[f"rate_{i}"], unit.x, unit.x_dot, tolerances)
        parts: list[Any] = [run[f"part_{i}"] for i in range(len(names) + 1)]
        self._parts = (c_void_p * len(parts))(*(cast(part, c_void_p).value for part in parts))

    def _caught(self, move: Move) -> Callable[[float, float], int]:
        """Return a function for C that keeps an exception."""

        def call(t: float, to: float) -> int:
            try:
                move(t, to)
            except BaseException as error:
                self._error = error
                return _FAILED
            return 0

        return call

    def _advance(self, times: Floats, every: int, out: Floats) -> None:
        self.before = np.empty((len(out), self._system.memory.size))
        self.after = np.empty((len(out), self._system.x.size))
        inputs = np.array([[course.at(t)[0] for _, course in self._system.outside] for t in times.tolist()])
        self.steps, failed = np.empty((len(out), len(self._names)), np.intc), c_size_t()
        done = self._library.sampled_rows(
            byref(self._memory), self._movers, len(self._names), self._parts, times.ctypes.data, inputs.ctypes.data,
            len(out), every, self.before.ctypes.data, self.steps.ctypes.data, self.after.ctypes.data, out.ctypes.data,
            byref(failed),
        )  # fmt: skip
        if self._error is not None:
            raise self._error
        if done < times.size - 1:
            raise no_finite_state(self._names[failed.value], float(times[done]))


class CompiledContinuous(CompiledRows):
    """Rows of a continuous reference, with steps up to `longest` [s]."""

    def __init__(
        self, system: WiredUnits, places: npt.NDArray[np.intp], run: Mapping[str, Run], tolerances: Tolerances,
        stop: float, longest: float,
    ) -> None:  # fmt: skip
        super().__init__(system, places)
        memory = system.memory
        x, x_dot = (memory[each[0] : each[-1] + 1] for each in (system.solver_x, system.solver_x_dot))
        x[:] = self._x = memory[system.x]
        self._states = self._problem(run["rate"], x, x_dot, tolerances)
        outputs: Any = run["outputs"]
        self._motion, self._outputs = _Motion(0.0, stop, _FIRST, longest, 1), cast(outputs, c_void_p)

    def _advance(self, times: Floats, every: int, out: Floats) -> None:
        states = np.empty((len(out) + 1, self._x.size))
        states[0] = self._x
        done = self._library.continuous_rows(
            byref(self._memory), byref(self._states), byref(self._motion), self._outputs, times[1:].ctypes.data,
            len(out), states.ctypes.data, out.ctypes.data,
        )  # fmt: skip
        if done < len(out):
            raise VdfmuError(f"The continuous reference failed after t = {self._motion.t:.9g} s.")
        self.before, self.after, self._x = states[:-1], states[1:], states[-1]


def no_finite_state(name: str, t: float) -> VdfmuError:
    """Return the error of a unit after a time [s]."""
    return VdfmuError(
        f"The reference failed: {name} has no finite state after t = {t:.9g} s, or is too stiff for its solver. "
        "Take a shorter step, or run without the reference."
    )
