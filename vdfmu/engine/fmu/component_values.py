"""Values of calls of a component of WebAssembly, as the C interface of wasmtime has them.

The package wasmtime makes an object for each number of a call. Here the values of a list are one array: a value
of wasmtime is 32 bytes, `ROW`, which begin with its kind; a number follows after 8 bytes, or the size of a list and its
address.
"""

from __future__ import annotations

import ctypes as ct
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

Words = NDArray[np.uint64]
ROW = 32
"""Bytes of a value."""
_ENTRY = 48
"""Bytes of a field of a record: size and address of its name, and a value."""
_NUMBERS = {
    np.dtype(name): kind
    for kind, name in enumerate(("bool", "i1", "u1", "i2", "u2", "i4", "u4", "i8", "u8", "f4", "f8"))
}
"""Types of numbers to kinds of values."""
_TYPES = {kind: dtype for dtype, kind in _NUMBERS.items()}
_READ = [np.ctypeslib.as_ctypes_type(dtype) for dtype in _NUMBERS]
"""Numbers by kind."""
_PLACES = 1000
_STRING, _LIST, _RECORD, _ENUM, _OPTION, _RESULT, _RESOURCE = 12, 13, 14, 17, 18, 19, 21


@dataclass(frozen=True)
class Handle:
    """A resource of a component, by the address of its handle."""

    address: int


@dataclass(frozen=True)
class Failed:
    """The error of a result."""

    value: Any


@dataclass(frozen=True)
class Optional:
    """A value that may be missing."""

    value: Any


def rows(dtype: Any, n: int) -> tuple[Words, NDArray[Any]]:
    """Return the values of a list of `n` numbers, and the numbers in them."""
    dtype = np.dtype(dtype)
    words = np.zeros((n, ROW // 8), np.uint64)
    words[:, 0] = _NUMBERS[dtype]
    return words, numbers(words, dtype)


def numbers(words: Words, dtype: np.dtype[Any]) -> NDArray[Any]:
    """Return the numbers in values, in place."""
    return words.view(dtype)[:, 8 // dtype.itemsize]


def encode(values: Sequence[Any], kept: list[Any]) -> Words:
    """Return values for a call; `kept` gets the memory that they point to."""
    words = np.zeros((len(values), ROW // 8), np.uint64)
    kept.append(words)
    for row, value in zip(words, values, strict=True):
        if isinstance(value, Handle):
            row[:2] = _RESOURCE, value.address
        elif isinstance(value, Optional):
            inner = encode([] if value.value is None else [value.value], kept)
            row[:2] = _OPTION, inner.ctypes.data if len(inner) else 0
        elif isinstance(value, str):
            text = np.frombuffer(value.encode("utf-8", "replace"), np.uint8)
            kept.append(text)
            row[:3] = _STRING, text.size, text.ctypes.data
        elif isinstance(value, np.ndarray):
            inner, places = rows(value.dtype, value.size)
            places[:] = value
            kept.append(inner)
            row[:3] = _LIST, len(inner), inner.ctypes.data
        else:
            dtype = np.dtype(type(value))
            row[0] = _NUMBERS[dtype]
            numbers(row[None], dtype)[0] = value
    return words


class Places(dict[int, Any]):
    """Objects on memory, made once for each address: wasmtime takes few addresses in turn for the result of a call."""

    def __init__(self, make: Callable[[int], Any]) -> None:
        super().__init__()
        self._make = make

    def __missing__(self, address: int) -> Any:
        if len(self) == _PLACES:
            self.clear()
        made = self[address] = self._make(address)
        return made


def heads() -> Places:
    """Return size and address of the content of values, by their addresses."""
    return Places(lambda address: (ct.c_uint64 * 2).from_address(address + 8))


def views(dtype: Any, size: int) -> Places:
    """Return the numbers of lists of one type and size, by addresses."""
    room = ct.c_uint64 * (ROW // 8) * size
    dtype = np.dtype(dtype)

    def view(address: int) -> NDArray[Any]:
        words: Any = np.ctypeslib.as_array(room.from_address(address))
        return numbers(words, dtype)

    return Places(view)


def list_at(size: int, address: int) -> Any:
    """Return a list: numbers as an array of their own, else a list of values."""
    if not size:
        return []
    kind = ct.c_uint8.from_address(address).value
    if kind not in _TYPES:
        return [decode(address + ROW * k) for k in range(size)]
    return views(_TYPES[kind], size)[address].copy()


def decode(address: int) -> Any:
    """Return the value at an address."""
    kind = ct.c_uint8.from_address(address).value
    if kind < len(_READ):
        return _READ[kind].from_address(address + 8).value
    first, second = (ct.c_uint64.from_address(address + at).value for at in (8, 16))
    if kind == _LIST:
        return list_at(first, second)
    if kind in (_STRING, _ENUM):
        return ct.string_at(second, first).decode("utf-8", "replace")
    if kind == _RECORD:
        return [decode(second + _ENTRY * k + 16) for k in range(first)]
    if kind == _OPTION:
        return decode(first) if first else None
    if kind == _RESULT:
        return decode(second) if first & 0xFF else Failed(decode(second))
    if kind == _RESOURCE:
        return Handle(first)
    raise ValueError(f"a value of kind {kind} is not of FMI")
