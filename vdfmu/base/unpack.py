"""Files of other tools: a budget of unpacked bytes, and a reader of MATLAB files that opens no other file."""

from __future__ import annotations

import math
import struct
import zlib
from collections.abc import Iterator
from importlib import import_module
from itertools import islice
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np

from vdfmu.base.errors import UsageError

LEAST, RATIO = 256 * 2**20, 20
"""Bytes that any file may unpack to, and the largest ratio of a larger one: logs of float64 shrink 2 to 4 times."""
COUNT = 10_000
"""Most variables of a file."""
_MATRIX, _PACKED = 14, 15
_TYPES = {1: "i1", 2: "u1", 3: "i2", 4: "u2", 5: "i4", 6: "u4", 7: "f4", 9: "f8", 12: "i8", 13: "u8"}
"""Numeric element types of version 5, as stored."""
_CLASSES = {6: "f8", 7: "f4", 8: "i1", 9: "u1", 10: "i2", 11: "u2", 12: "i4", 13: "u4", 14: "i8", 15: "u8"}
"""Numeric array classes."""
_STRUCT, _CHAR = 2, 4
_CODECS = {2: "latin-1", 4: "utf-16", 16: "utf-8", 17: "utf-16"}
_DEFLATE = 1
_FILTERS = ([], [_DEFLATE], [2, _DEFLATE], [_DEFLATE, 3], [2, _DEFLATE, 3])
"""Supported filters of HDF5, in their order: 2 shuffles bytes, 3 adds a check sum."""
_CHUNK, _ELEMENT = 1024, 64
"""Bytes that count for each chunk of HDF5 and each element of version 5, beside the content."""


class UnpackBudget:
    """Limit of bytes and variables of a file, counted before memory is allocated."""

    def __init__(self, path: Path) -> None:
        self.path, self.count, self.left = path, 0, max(LEAST, RATIO * path.stat().st_size)
        self._limit = self.left

    def spend(self, size: int, count: int = 0) -> None:
        """Count bytes and variables. UsageError beyond the limit."""
        self.left -= size
        self.count += count
        if self.left < 0:
            got = f"{(self._limit - self.left) / 2**20:.0f} MiB or more"
            raise self.refused(f"unpack to at most {self._limit / 2**20:.0f} MiB", got, "Save a shorter part of it")
        if self.count > COUNT:
            raise self.refused(f"have at most {COUNT} variables", "more", "Save fewer of them")

    def refused(self, must: str, got: str, way: str) -> UsageError:
        """Return the error of a file that breaks a rule."""
        return UsageError(f"{self.path}: the file must {must}, got {got}. {way}.")


def imported(feature: str, package: str, extra: str, *modules: str) -> tuple[ModuleType, ...]:
    """Import modules of the optional package of a format. UsageError if it is not installed."""
    try:
        return tuple(import_module(module) for module in modules)
    except ImportError as error:
        raise UsageError(
            f"{feature} needs the package {package}, which cannot be imported: {error}. Install it with "
            f"'pip install vdfmu[{extra}]'. The results of a run can be CSV, which needs no package: --format csv."
        ) from None


def mat_variables(path: Path) -> dict[str, Any]:
    """Return numeric arrays and texts of a MATLAB file of any version, with fields of structs as ``rec.position``.

    Cells, arrays of structs and objects are left out. UsageError if the file is unreadable, needs other files or
    exceeds the budget.
    """
    variables: dict[str, Any] = {}

    def add(name: str, value: Any) -> None:
        if isinstance(value, dict):
            for field, each in value.items():
                add(f"{name}.{field}" if name else field, each)
        elif value is not None and name[:1] not in ("", "_", "#"):
            variables[name] = value

    try:
        with open(path, "rb") as file:
            budget, head = UnpackBudget(path), file.read(128)
            if head[124:128] in (b"\0\2IM", b"\2\0MI"):
                (h5py,) = imported("a MATLAB file of version 7.3", "h5py", "matlab", "h5py")
                with h5py.File(file, "r") as tree:
                    add("", _group(tree, budget, {tree}))
            elif 0 in head[:4]:  # version 4 is neither packed nor nested
                from scipy.io import loadmat

                add("", loadmat(file))
            else:
                order = {b"IM": "<", b"MI": ">"}.get(head[126:128], "")
                if not order:
                    raise ValueError("it has no head of version 4, 5 or 7.3")
                for kind, content in _elements(memoryview(file.read()), order, budget):
                    add(*_variable(content, order, budget) if kind == _MATRIX else ("", None))
    except UsageError:
        raise
    except Exception as error:  # damage shows in a dozen kinds
        why = getattr(error, "strerror", None) or str(error) or type(error).__name__
        raise UsageError(f"{path}: expected a MATLAB file, got unreadable content: {why}") from None
    return variables


def _elements(data: memoryview, order: str, budget: UnpackBudget) -> Iterator[tuple[int, memoryview]]:
    """Yield type and content of each element of version 5, unpacked."""
    place = 0
    while place < len(data):
        budget.spend(_ELEMENT)
        kind, size = struct.unpack_from(f"{order}II", data, place)
        start = place + 8
        if kind >> 16:  # a small element, in its own head
            kind, size, start = kind & 0xFFFF, kind >> 16, place + 4
            place += 8
        else:
            place += 8 + size + (-size % 8 if kind != _PACKED else 0)
        content = data[start : start + size]
        if len(content) < size:
            raise ValueError("it ends within an element")
        if kind == _PACKED:
            content = memoryview(zlib.decompressobj().decompress(content, budget.left + 1))
            budget.spend(len(content))
            yield from _elements(content, order, budget)
        else:
            yield kind, content


def _variable(data: memoryview, order: str, budget: UnpackBudget) -> tuple[str, Any]:
    """Return name and value of a matrix of version 5. None unless it has numbers, text or a single struct."""
    budget.spend(0, 1)
    parts = _elements(data, order, budget)
    flags, shape, name = (next(parts, (0, memoryview(b"")))[1] for _ in range(3))
    kind = np.frombuffer(flags, f"{order}u4")[0] & 0xFF if flags else 0
    dims, value = np.frombuffer(shape, f"{order}i4"), None
    if kind in _CLASSES:
        numbers = [np.frombuffer(content, order + _TYPES[stored]) for stored, content in islice(parts, 2)]
        budget.spend(8 * sum(map(len, numbers)))
        real, *imaginary = (each.astype(_CLASSES[kind]).reshape(dims, order="F") for each in numbers)
        value = real + 1j * imaginary[0] if imaginary else real
    elif kind == _CHAR:
        stored, content = next(parts)
        value = str(content, _CODECS[stored].replace("16", f"16-{'lb'[order == '>']}e"))
    elif kind == _STRUCT and dims.prod() == 1:
        width, names = np.frombuffer(next(parts)[1], f"{order}i4")[0], bytes(next(parts)[1])
        fields = [names[k : k + width].split(b"\0")[0].decode() for k in range(0, len(names), width)]
        value = {field: _variable(content, order, budget)[1] for field, (_, content) in zip(fields, parts, strict=True)}
    return str(name, "utf-8"), value


def _group(group: Any, budget: UnpackBudget, seen: set[Any]) -> dict[str, Any]:
    """Return the numeric arrays of a group of HDF5, with its groups as dicts."""
    arrays: dict[str, Any] = {}
    for name in group:
        link = type(group.get(name, getlink=True)).__name__
        if link != "HardLink":
            raise budget.refused(f"hold {name} itself", f"a link ({link})", "Save it without links")
        item = group[name]
        budget.spend(0, 1)
        if hasattr(item, "keys"):
            if item in seen:
                raise budget.refused(f"hold {name} once", "a second link to it", "Save it without links")
            seen.add(item)
            arrays[name] = _group(item, budget, seen)
        elif hasattr(item, "shape") and item.dtype.kind in "fiub" and item.shape is not None:
            arrays[name] = _dataset(item, budget)
    return arrays


def _dataset(item: Any, budget: UnpackBudget) -> Any:
    """Return an array of HDF5 after a check that its file holds all of it and its chunks have the stated size."""
    if item.external or item.is_virtual:
        raise budget.refused(f"hold the numbers of {item.name} itself", "the name of another file", "Save it whole")
    chunk = math.prod(item.chunks or ()) * item.dtype.itemsize
    count = math.prod(-(-n // of) for n, of in zip(item.shape, item.chunks, strict=True)) if item.chunks else 0
    budget.spend(max(item.nbytes, chunk) + _CHUNK * count)
    plan = item.id.get_create_plist()
    filters = [plan.get_filter(k)[0] for k in range(plan.get_nfilters())]
    if filters not in _FILTERS:
        raise budget.refused(f"have {item.name} packed by gzip", f"filters {filters} of HDF5", "Save it with gzip")
    for part in item.iter_chunks() if filters else ():
        start = tuple(each.start for each in part)
        if item.id.get_chunk_info_by_coord(start).byte_offset is not None:
            mask, packed = item.id.read_direct_chunk(start)
            plain = mask >> filters.index(_DEFLATE) & 1
            if not plain and len(zlib.decompressobj().decompress(packed, chunk + 1)) > chunk:
                raise budget.refused(f"have chunks of {chunk} bytes in {item.name}", "a larger one", "Save it anew")
    return item[()].T
