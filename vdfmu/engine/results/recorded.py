"""Recorded signals of a co-simulation, in memory."""

from __future__ import annotations

import math
import mmap
import re
from collections.abc import Callable, Iterator, Mapping, Sequence
from functools import cached_property, lru_cache
from typing import Any, NamedTuple, Self

import numpy as np
from numpy.typing import NDArray

from vdfmu.base.arrays import Floats
from vdfmu.base.errors import UsageError
from vdfmu.base.text import close_to

TYPES = {"real": np.float64, "integer": np.int32, "boolean": np.int32}
KINDS = (*TYPES,)
_BLOCK = 512
_ELEMENT = re.compile(r"(.+)\[(\d+(?:,\d+)*)\]")


@lru_cache(2**14)
def group_of(name: str) -> tuple[str, tuple[int, ...]]:
    """Return the name of a signal without indices, and its indices."""
    match = _ELEMENT.fullmatch(name)
    return (match[1], tuple(map(int, match[2].split(",")))) if match else (name, ())


class Signal(NamedTuple):
    """Where a signal is: `column` of the array of its `kind`."""

    name: str
    kind: str
    unit: str
    column: int


class Recorded:
    """Recorded signals at the communication points, without files and pictures; see :class:`vdfmu.Results`."""

    def __init__(
        self,
        time: Floats,
        signals: Sequence[Signal],
        data: Mapping[str, NDArray[Any]],
        summary: dict[str, Any] | None = None,
        messages: Sequence[Any] = (),
    ) -> None:
        self.time = time
        self._summary: dict[str, Any] = {} if summary is None else summary
        self._judge: Callable[[Any], object] | None = None
        self._draw: Callable[[Any], str] | None = None
        self.messages = list(messages)
        self._signals = {signal.name: signal for signal in signals}
        self.data = dict(data)

    @property
    def summary(self) -> dict[str, Any]:
        """Facts about the run. The verdict of :meth:`judge_by` is made when the summary is first read."""
        judge, self._judge = self._judge, None
        if judge is not None:
            judge(self)
        return self._summary

    def judge_by(self, judge: Callable[[Any], object]) -> None:
        """Set the function that adds a verdict when the summary is first read, so that runs stay fast."""
        self._judge = judge

    def __getstate__(self) -> dict[str, Any]:
        """Return the results with their verdict but without the functions that made it, for another process."""
        return self.__dict__ | {"_summary": self.summary, "_judge": None, "_draw": None}

    @property
    def names(self) -> list[str]:
        """The names of the signals without the time."""
        return list(self._signals)

    @property
    def signals(self) -> list[Signal]:
        """The signals."""
        return list(self._signals.values())

    @property
    def units(self) -> dict[str, str]:
        """The unit of each signal; may be empty."""
        return {s.name: s.unit for s in self._signals.values()}

    @property
    def kinds(self) -> dict[str, str]:
        """``real``, ``integer`` or ``boolean`` for each signal."""
        return {s.name: s.kind for s in self._signals.values()}

    def __len__(self) -> int:
        return len(self.time)

    def __contains__(self, name: object) -> bool:
        return name in self._signals or name in self.groups

    def __iter__(self) -> Iterator[str]:
        return iter(self._signals)

    @cached_property
    def groups(self) -> dict[str, dict[tuple[int, ...], str]]:
        """Names without indices to the signals by index: ``{"plant.q": {(1,): "plant.q[1]", ...}, ...}``.

        A signal without indices is a group with the index ``()``.
        """
        groups: dict[str, dict[tuple[int, ...], str]] = {}
        for name in self._signals:
            group, index = group_of(name)
            groups.setdefault(group, {})[index] = name
        return groups

    def __getitem__(self, name: str) -> NDArray[Any]:
        """Return a signal, or, without indices, the elements of an array in the order of their indices.

        Returns
        -------
        (m,) array of a signal, (m, n) of ``name[1]`` ... ``name[n]``, (m, j, k) of ``name[1,1]`` ... ``name[j,k]``

        Raises
        ------
        UsageError
            For an unknown name, or signals that do not fill an array.
        """
        signal = self._signals.get(name) if isinstance(name, str) else None  # pyright: ignore[reportUnnecessaryIsInstance]
        if signal is not None:
            column = np.asarray(self.data[signal.kind])[:, signal.column]
            return column.astype(bool) if signal.kind == "boolean" else column
        names = self.members(name)
        shape = self.shape_of(name)
        if shape is None:
            raise UsageError(f"the signals {', '.join(names)} do not fill an array; read them one by one")
        group = self.groups[name]
        listed = [self._signals[group[index]] for index in sorted(group)]
        kinds = {signal.kind for signal in listed}
        if len(kinds) == 1 and kinds != {"boolean"}:
            columns = np.asarray(self.data[listed[0].kind])[:, [signal.column for signal in listed]]
        else:
            columns = np.stack([self[signal.name] for signal in listed], axis=1)
        return columns.reshape(-1, *shape)

    def members(self, name: str) -> list[str]:
        """Return the signal of this name, or the elements of the array; UsageError for an unknown name."""
        if not isinstance(name, str):  # pyright: ignore[reportUnnecessaryIsInstance]
            raise UsageError(
                f"expected the name of a signal, got {name!r:.60}. Give several names as separate arguments."
            )
        if name in self._signals:
            return [name]
        if name not in self.groups:
            raise UsageError(f"the results have no signal {name!r}{close_to(name, [*self._signals, *self.groups])}")
        return list(self.groups[name].values())

    def shape_of(self, group: str) -> tuple[int, ...] | None:
        """Return the shape of a row of a group; None if its signals do not fill an array."""
        indices = self.groups[group]
        shape = tuple(len(set(axis)) for axis in zip(*indices, strict=False))
        whole = len({len(index) for index in indices}) == 1 and math.prod(shape) == len(indices)
        return shape if whole else None

    def renamed(self, rename: Callable[[str], str]) -> Self:
        """Return the same results with other signal names."""
        signals = [signal._replace(name=rename(signal.name)) for signal in self._signals.values()]
        return type(self)(self.time, signals, self.data, self.summary, self.messages)

    def first(self, rows: int) -> Self:
        """Return the results with only the first rows; unchanged if there are no more."""
        if rows >= len(self):
            return self
        data = {kind: array[:rows] for kind, array in self.data.items()}
        return type(self)(self.time[:rows], list(self._signals.values()), data, self.summary, self.messages)

    def thinned(self, most: int) -> Self:
        """Return at most `most` evenly spaced rows, including the first; unchanged if there are few enough."""
        stride = -(-len(self) // most)
        if stride <= 1:
            return self
        size = stride * -(-_BLOCK // stride)
        parts = [{kind: array[::stride].copy() for kind, array in block.data.items()} for block in self.blocks(size)]
        data = {kind: np.concatenate([part[kind] for part in parts]) for kind in self.data}
        return type(self)(self.time[::stride], list(self._signals.values()), data, self.summary, self.messages)

    def blocks(self, rows: int, overlap: int = 0) -> Iterator[Self]:
        """Yield blocks of at most `rows` rows, each after the last `overlap` rows before it.

        So any ``overlap + 1`` consecutive rows are together in exactly one block, even if the last block is a single
        row, and a difference over them is taken once. Pages of arrays on disk are released from memory.
        """
        signals = list(self._signals.values())
        for first in range(0, len(self), rows):
            part = slice(max(0, first - overlap), first + rows)
            yield type(self)(self.time[part], signals, {kind: array[part] for kind, array in self.data.items()})
            for array in self.data.values():
                if isinstance(array.base, mmap.mmap) and hasattr(mmap, "MADV_DONTNEED"):
                    array.base.madvise(mmap.MADV_DONTNEED)
