"""Moves values between the master's memory and the calls of FMUs: converts types, and handles whole arrays."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from ctypes import addressof, c_uint, create_string_buffer, string_at
from itertools import accumulate
from typing import Any

import numpy as np
from numpy.typing import NDArray

from vdfmu.engine.fmu.variables import FmuVariable
from vdfmu.engine.package.system import Value

Call = tuple[Any, tuple[Any, ...], str]
"""An FMI function, its prepared arguments, and its name for messages."""
Ends = tuple[NDArray[Any], NDArray[np.intp], NDArray[Any], NDArray[np.intp]]
"""Ends of a copy: the target and places in it, the source and places in it."""
DTYPES: dict[str, Any] = {
    "Real": np.float64,
    "Integer": np.int64,
    "Boolean": np.int32,
    "String": np.object_,
    "Binary": np.object_,
}
"""Types of the kinds of variables in the master; texts and binary values are ``bytes``."""
KINDS = tuple(DTYPES)
TEXTS = ("String", "Binary")
"""Kinds that are not in tables of results and that iterations cannot improve."""


def held(kind: str, value: Any) -> Any:
    """Return a value in the form that the master stores."""
    if kind == "String":
        return str(value).encode("utf-8", "surrogateescape")
    return bytes(value) if kind == "Binary" else value


def shown(kind: str, number: Any) -> Value:
    """Return the value of a number or ``bytes`` stored in the master: the inverse of `held`."""
    if kind == "String":
        return number.decode("utf-8", "surrogateescape")
    return number if kind == "Binary" else number.item()


def shown_all(kind: str, numbers: NDArray[Any]) -> list[Value]:
    """Return the values of an array, see `shown`."""
    return [shown(kind, number) for number in numbers] if kind in TEXTS else numbers.tolist()


def shared(kind: Any, values: NDArray[Any]) -> Any:
    """Return an array of a ctypes type that shares the memory of `values`."""
    return (kind * values.size).from_buffer(values)


class Transfer:
    """Moves an FMU's variables of one type between a window of the master's memory and the memory of a call.

    If type and order agree, both are the same memory. FMI 3.0 gets and sets whole arrays; elements outside of the
    window have values from `values_of`.

    Parameters
    ----------
    verb : "Get" or "Set"
    variables, places : sequences
        The variables and their positions in the window.
    values : array
        The window.
    dtype : type
        Type in the memory of the call.
    values_of, failure : callables
        Return the values of all elements of a variable, given its value reference, and the error of a call, given its
        name and the reason.
    """

    def __init__(
        self,
        verb: str,
        variables: Sequence[FmuVariable],
        places: Sequence[int],
        values: NDArray[Any],
        dtype: Any,
        values_of: Callable[[int], Sequence[Value]],
        failure: Callable[[str, str], Exception],
    ) -> None:
        self._failure = failure
        self.verb, self.native, self._kind = verb, variables[0].native, variables[0].kind
        self.name = f"{verb.lower()}{self.native}"
        lengths = {v.reference: v.length for v in variables}
        *begins, size = accumulate(lengths.values(), initial=0)
        begin = dict(zip(lengths, begins, strict=True))
        self.references = (c_uint * len(lengths))(*lengths)
        self._values, self._where = values, np.array(places, np.intp)
        self._places = np.array([begin[v.reference] + v.index for v in variables], np.intp)
        ordered = np.array_equal(self._places, np.arange(size)) and bool(np.all(np.diff(self._where) == 1))
        self.partial = verb == "Set" and len(variables) < size
        """Whether the memory holds known values."""
        self.direct = ordered and np.dtype(dtype) == values.dtype
        self.sizes = np.zeros(size, np.uintp)
        """Sizes of the binary values."""
        if self.direct:
            self.memory = values[places[0] : places[0] + len(places)]
            return
        self.memory = np.zeros(size, dtype)
        """Memory that the call reads or writes."""
        self._slots: dict[int, tuple[bytes, Any]] = {}
        """Texts and binary values by place: the content, and the copy whose address is in the memory."""
        if self.partial:
            rest = [held(self._kind, value) for reference in lengths for value in values_of(reference)]
            self._put(range(len(rest)), rest)

    def around(self, function: Callable[..., int]) -> Callable[..., int]:
        """Return the call's function, wrapped to move the values."""
        if self.direct:
            return function

        def get(*arguments: Any) -> int:
            status = function(*arguments)
            self.move()
            return status

        def put(*arguments: Any) -> int:
            self.move()
            return function(*arguments)

        return get if self.verb == "Get" else put

    @property
    def ends(self) -> Ends:
        """The ends of the copy made by `move`."""
        call, master = (self.memory, self._places), (self._values, self._where)
        return (*call, *master) if self.verb == "Set" else (*master, *call)

    def move(self) -> None:
        """Copy the values between the master's memory and that of the call; CosimError for an integer out of range."""
        (self._fetch if self.verb == "Get" else self._bring)()

    def _fetch(self) -> None:
        received = self.memory[self._places]
        if self._kind in TEXTS:
            sizes = self.sizes[self._places] if self._kind == "Binary" else [-1] * len(received)
            for i, address, size in zip(self._where, received, sizes, strict=True):
                self._values[i] = string_at(int(address), int(size)) if address else b""
            return
        if self.native == "UInt64":
            self._refuse(received > np.iinfo(np.int64).max, received, "at most 2^63 - 1, the limit of the master")
        self._values[self._where] = received

    def _bring(self) -> None:
        sent = self._values[self._where]
        self._put(self._places, sent)
        if self._kind == "Integer":
            bad = (self.memory[self._places] != sent) | (sent < 0) & (self.native == "UInt64")
            self._refuse(bad, sent, f"a value of type {self.native}")

    def _put(self, places: Any, values: Any) -> None:
        """Write values to the memory of the call. A text keeps its address until its variable changes."""
        if self._kind not in TEXTS:
            with np.errstate(over="ignore"):  # Float32 overflows to infinity
                self.memory[places] = values
            return
        for place, content in zip(places, values, strict=True):
            if place not in self._slots or self._slots[place][0] is not content:
                self._slots[place] = content, create_string_buffer(content, len(content) + 1)
                self.memory[place], self.sizes[place] = addressof(self._slots[place][1]), len(content)

    def _refuse(self, bad: NDArray[np.bool_], values: NDArray[Any], expected: str) -> None:
        if bad.any():
            raise self._failure(self.name, f"expected {expected}, got {values[int(np.argmax(bad))]}")
