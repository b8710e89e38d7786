"""Values between the memory of the master and the calls of FMUs, which may have other types and whole arrays."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from ctypes import addressof, byref, c_char, c_size_t, c_uint, create_string_buffer, string_at
from typing import Any

import numpy as np
from numpy.typing import NDArray

from vdfmu.engine.cosim.variables import Value, Variable

Call = tuple[Any, Any, Any, Any, Any, str]
"""An FMI function, its last four arguments, and its name for messages."""
DTYPES: dict[str, Any] = {
    "Real": np.float64, "Integer": np.int64, "Boolean": np.int32, "String": np.uintp, "Binary": np.uintp,
}  # fmt: skip
"""How the master holds the kinds of variables; of texts and binary values their address in a `Heap`."""
KINDS = tuple(DTYPES)
_FEWEST = 4096
"""Texts that a heap keeps at least."""


class Heap:
    """Copies of texts and binary values, which those of a unit outlive; the same address for the same content.

    It forgets the longest unused of more than `_FEWEST` and four for each variable.
    """

    def __init__(self, variables: int = 0) -> None:
        self._copies: dict[bytes, Any] = {}
        self._contents: dict[int, bytes] = {}
        self._most = _FEWEST + 4 * variables

    def put(self, content: bytes) -> int:
        """Return the address of a copy."""
        copy = self._copies.pop(content, None)
        if copy is None:
            copy = create_string_buffer(content, len(content) + 1)
            self._contents[addressof(copy)] = content
        self._copies[content] = copy  # the last used is the last
        if len(self._copies) > self._most:
            del self._contents[addressof(self._copies.pop(next(iter(self._copies))))]
        return addressof(copy)

    def content(self, address: int) -> bytes:
        """Return what is at an address; nothing at none."""
        return self._contents[address] if address else b""

    def number(self, kind: str, value: Any) -> Any:
        """Return how the master holds a value."""
        if kind == "String":
            return self.put(str(value).encode("utf-8", "surrogateescape"))
        return self.put(bytes(value)) if kind == "Binary" else value

    def value(self, kind: str, number: Any) -> Value:
        """Return the value that a number of the master stands for."""
        if kind == "String":
            return self.content(int(number)).decode("utf-8", "surrogateescape")
        return self.content(int(number)) if kind == "Binary" else number.item()


class Transfer:
    """Variables of one type of an FMU between a window of the master's memory and the memory of a call.

    That is the window itself where both have the same type and order. An array of FMI 3.0 is got and set as a whole:
    elements that the window does not have are set to `known`.

    Parameters
    ----------
    verb : "Get" or "Set"
    variables : sequence of Variable
    places : sequence of int
        Their positions in `values`.
    values : array
        The window.
    dtype : type
        Of the memory of the call.
    heap : Heap
    known : callable
        Returns the values of all elements of a variable, by its value reference.
    failure : callable
        Returns the error of a call, from its name and the reason.
    """

    def __init__(
        self,
        verb: str,
        variables: Sequence[Variable],
        places: Sequence[int],
        values: NDArray[Any],
        dtype: Any,
        heap: Heap,
        known: Callable[[int], Sequence[Value]],
        failure: Callable[[str, str], Exception],
    ) -> None:
        self._failure = failure
        self.verb, self.native, self._kind, self._heap = verb, variables[0].native, variables[0].kind, heap
        self.name = f"{verb.lower()}{self.native}"
        lengths = {v.reference: v.length for v in variables}
        whole = [(reference, i) for reference, length in lengths.items() for i in range(length)]
        elements = [(v.reference, v.index) for v in variables]
        self.references = (c_uint * len(lengths))(*lengths)
        self._values, self._where = values, np.array(places, np.intp)
        ordered = elements == whole and list(places) == list(range(places[0], places[0] + len(places)))
        self.direct = ordered and np.dtype(dtype) == values.dtype
        if self._kind == "Binary" or (self._kind == "String" and verb == "Get"):
            self.direct = False  # sizes go beside; what an FMU gives is to be copied
        position = {element: i for i, element in enumerate(whole)}
        self._places = np.array([position[element] for element in elements], np.intp)
        self.sizes = np.zeros(len(whole), np.uintp)
        """Of binary values."""
        if self.direct:
            self.memory = values[places[0] : places[0] + len(places)]
            return
        self.memory = np.zeros(len(whole), dtype)
        """What the call reads or fills."""
        if verb == "Set" and len(elements) < len(whole):
            rest = [value for reference in lengths for value in known(reference)]
            self.memory[:] = [heap.number(self._kind, value) for value in rest]

    @property
    def counts(self) -> tuple[Any, Any]:
        """Numbers of references and of values as arguments."""
        return c_size_t.from_param(len(self.references)), c_size_t.from_param(self.memory.size)

    @property
    def pointer(self) -> Any:
        """The memory as an argument."""
        return byref(c_char.from_buffer(self.memory))  # pyright: ignore[reportArgumentType]

    def around(self, function: Callable[..., int]) -> Callable[..., int]:
        """Return the function of a call with what moves the values."""
        if self.direct:
            return function

        def get(*arguments: Any) -> int:
            status = function(*arguments)
            self._fetch()
            return status

        def put(*arguments: Any) -> int:
            self._bring()
            return function(*arguments)

        return get if self.verb == "Get" else put

    def _fetch(self) -> None:
        found = self.memory[self._places]
        if self._kind == "String":
            found = [self._heap.put(string_at(int(a)) if a else b"") for a in found]
        elif self._kind == "Binary":
            sizes = self.sizes[self._places]
            found = [
                self._heap.put(string_at(int(a), int(n)) if a else b"")
                for a, n in zip(found, sizes, strict=True)
            ]
        elif self.native == "UInt64":
            self._refuse(
                found > np.iinfo(np.int64).max, found, "the largest that the master passes on, 2^63 - 1"
            )
        self._values[self._where] = found

    def _bring(self) -> None:
        wanted = self._values[self._where]
        with np.errstate(over="ignore"):  # of Float32: infinite, as the type has it
            self.memory[self._places] = wanted
        if self._kind == "Binary":
            self.sizes[:] = [len(self._heap.content(int(address))) for address in self.memory]
        elif self._kind == "Integer":
            bad = (self.memory[self._places] != wanted) | (wanted < 0) & (self.native == "UInt64")
            self._refuse(bad, wanted, f"a value of type {self.native}")

    def _refuse(self, bad: NDArray[np.bool_], values: NDArray[Any], expected: str) -> None:
        if bad.any():
            raise self._failure(self.name, f"expected {expected}, got {values[int(np.argmax(bad))]}")
