"""What a co-simulation recorded."""

from __future__ import annotations

import csv
import io
import json
import math
import mmap
import re
from collections.abc import Callable, Iterator, Mapping, Sequence
from itertools import chain
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from vdfmu.arrays import Floats
from vdfmu.errors import UsageError, VdfmuError
from vdfmu.files import write_whole
from vdfmu.text import close_to

KINDS = ("real", "integer", "boolean")
_BLOCK = 512


class Signal(NamedTuple):
    """Where a signal is: `column` of the array of its `kind`.

    In all rows it has the values of the signal `of`, if that is not empty, or those that it had `late` rows before.
    """

    name: str
    kind: str
    unit: str
    column: int
    of: str = ""
    late: int = 0


class Results:
    """Recorded signals on the communication points.

    A row holds the outputs at its communication point; an input has the value that its unit used in the step
    that ended there (first row: as set during initialization).

    Parameters
    ----------
    time : (m,) array [s]
    signals : sequence of Signal
        In the order in which they are shown and written.
    data : mapping of str to (m, columns) array
        By kind: ``real`` float64, ``integer`` and ``boolean`` int32.
    summary : dict, optional
        Facts about the run.
    messages : sequence, optional
        The messages of the units (`vdfmu.engine.cosim.LogMessage`).

    Examples
    --------
    >>> results["plant.q[1]"]            # one signal, (m,)
    >>> results.array("plant.q")         # plant.q[1] ... plant.q[n], (m, n)
    >>> results.array("plant.R_O")       # plant.R_O[1,1] ... plant.R_O[3,3], (m, 3, 3)
    """

    def __init__(
        self,
        time: Floats,
        signals: Sequence[Signal],
        data: Mapping[str, NDArray[Any]],
        summary: dict[str, Any] | None = None,
        messages: Sequence[Any] = (),
    ) -> None:
        self.time = time
        self.summary: dict[str, Any] = {} if summary is None else summary
        self.messages = list(messages)
        self._signals = {signal.name: signal for signal in signals}
        self._data = dict(data)

    @property
    def names(self) -> list[str]:
        """The names of the signals, without time."""
        return list(self._signals)

    @property
    def signals(self) -> list[Signal]:
        """The signals, and which of them copy another (`Signal.of`)."""
        return list(self._signals.values())

    @property
    def units(self) -> dict[str, str]:
        """The unit of each signal; empty where it has none."""
        return {s.name: s.unit for s in self._signals.values()}

    @property
    def kinds(self) -> dict[str, str]:
        """``real``, ``integer`` or ``boolean`` for each signal."""
        return {s.name: s.kind for s in self._signals.values()}

    def __len__(self) -> int:
        return len(self.time)

    def __contains__(self, name: object) -> bool:
        return name in self._signals

    def __iter__(self) -> Iterator[str]:
        return iter(self._signals)

    def __getitem__(self, name: str) -> NDArray[Any]:
        """Return one signal, shape (m,); UsageError when there is none of that name."""
        signal = self._signals.get(name)
        if signal is None:
            raise UsageError(f"the results have no signal {name!r}{close_to(name, self._signals)}")
        column = np.asarray(self._data[signal.kind])[:, signal.column]
        return column.astype(bool) if signal.kind == "boolean" else column

    def array(self, name: str) -> NDArray[Any]:
        """Return the elements of an array in the order of their indices.

        Parameters
        ----------
        name : str
            Without indices.

        Returns
        -------
        (m, n) array of ``name[1]`` ... ``name[n]``, (m, j, k) array of ``name[1,1]`` ... ``name[j,k]``, and so on

        Raises
        ------
        UsageError
            There are no such signals, or they do not fill an array.
        """
        pattern = re.compile(re.escape(name) + r"\[(\d+(?:,\d+)*)\]")
        found = {
            tuple(map(int, match[1].split(","))): s for s in self._signals if (match := pattern.fullmatch(s))
        }
        if not found:
            raise UsageError(f"the results have no signals {name}[1], {name}[2], ...")
        ranks = {len(index) for index in found}
        shape = [len(set(axis)) for axis in zip(*found, strict=False)]
        if len(ranks) > 1 or math.prod(shape) != len(found):
            raise UsageError(
                f"the signals {', '.join(found.values())} are not all elements of an array; take them one by one"
            )
        listed = [self._signals[found[i]] for i in sorted(found)]
        kinds = {signal.kind for signal in listed}
        if len(kinds) == 1 and kinds != {"boolean"}:
            columns = np.asarray(self._data[listed[0].kind])[:, [signal.column for signal in listed]]
        else:
            columns = np.stack([self[signal.name] for signal in listed], axis=1)
        return columns.reshape(-1, *shape)

    def renamed(self, rename: Callable[[str], str]) -> Results:
        """Return the same results with other names of the signals."""
        signals = [
            signal._replace(name=rename(signal.name), of=rename(signal.of) if signal.of else "")
            for signal in self._signals.values()
        ]
        return Results(self.time, signals, self._data, self.summary, self.messages)

    def thinned(self, most: int) -> Results:
        """Return at most `most` rows at equal distances, with the first; the same results if there are no more."""
        stride = -(-len(self) // most)
        if stride <= 1:
            return self
        size = stride * -(-_BLOCK // stride)
        parts = [
            {kind: array[::stride].copy() for kind, array in block._data.items()}
            for block in self.blocks(size)
        ]
        data = {kind: np.concatenate([part[kind] for part in parts]) for kind in self._data}
        return Results(self.time[::stride], list(self._signals.values()), data, self.summary, self.messages)

    def blocks(self, rows: int) -> Iterator[Results]:
        """Yield stretches of at most `rows` rows; of an array that is on disk no page stays in memory."""
        signals = list(self._signals.values())
        for first in range(0, len(self), rows):
            part = slice(first, first + rows)
            yield Results(self.time[part], signals, {kind: array[part] for kind, array in self._data.items()})
            for array in self._data.values():
                if isinstance(array.base, mmap.mmap) and hasattr(mmap, "MADV_DONTNEED"):
                    array.base.madvise(mmap.MADV_DONTNEED)

    def write(self, path: str | Path) -> None:
        """Write a file of results: in Parquet if its suffix is ``.parquet``, else as `to_csv`.

        A Parquet file has the same bits in a third of the room, the units and the summary as metadata, and no signal
        that copies another; see `vdfmu.engine.cosim.parquet`.

        Raises
        ------
        UsageError
            Parquet needs the package pyarrow, ``pip install vdfmu[parquet]``.
        VdfmuError
            The file cannot be written.
        """
        path = Path(path)
        if path.suffix.lower() != ".parquet":
            self.to_csv(path)
            return
        from vdfmu.engine.cosim.parquet import write_parquet

        write_parquet(self, path)

    @classmethod
    def read(cls, path: str | Path) -> Results:
        """Read what `write` or a run wrote, with the copies of signals in the file.

        A Parquet file has its summary too; for CSV see `from_csv`.

        Raises
        ------
        UsageError
            The file is missing or of another form, or pyarrow is.
        """
        path = Path(path)
        if path.suffix.lower() != ".parquet":
            return cls.from_csv(path)
        from vdfmu.engine.cosim.parquet import read_parquet

        return read_parquet(path)

    def to_csv(self, path: str | Path) -> None:
        """Write all signals.

        The first line has the names, the second the units (``integer`` and ``boolean`` for these kinds),
        then follows a line a communication point. Numbers have the shortest form that reads back to the
        same bits. The file appears under its name only when it is complete.

        Raises
        ------
        VdfmuError
            The file cannot be written.
        """
        signals = list(self._signals.values())
        blocks = (slice(first, first + _BLOCK) for first in range(0, len(self.time), _BLOCK))
        lines = (csv_lines(self.time[rows], signals, self._data, rows) for rows in blocks)
        write_whole(Path(path), (text.encode() for text in chain([csv_head(signals)], lines)))

    @classmethod
    def from_csv(cls, path: str | Path) -> Results:
        """Read what `to_csv` or a run wrote; UsageError when the file is missing or of another form.

        What the ``summary.json`` beside it calls copies of signals in the file is among the results too.
        """
        path = Path(path)
        try:
            text = path.read_bytes().decode()
        except (OSError, UnicodeDecodeError) as error:
            raise UsageError(f"cannot read {path}: {getattr(error, 'strerror', None) or error}") from None
        stream = io.StringIO(text, newline="")
        reader = csv.reader(stream)
        try:
            names, units = next(reader), next(reader)
        except (StopIteration, csv.Error):
            raise UsageError(f"{path}: expected a line of names and a line of units") from None
        if len(names) != len(units) or names[:1] != ["time"]:
            raise UsageError(f"{path}: expected as many units as names, and 'time' as the first column")
        body = stream.read()
        try:
            table = (
                np.loadtxt(io.StringIO(body), delimiter=",", ndmin=2, comments=None)
                if body.strip()
                else np.empty((0, len(names)))
            )
        except ValueError as error:
            raise UsageError(f"{path}: {error}") from None
        if table.shape[1] != len(names):
            raise UsageError(f"{path}: expected {len(names)} columns, got {table.shape[1]}")
        signals: list[Signal] = []
        chosen: dict[str, list[int]] = {kind: [] for kind in KINDS}
        for index, (name, unit) in enumerate(zip(names[1:], units[1:], strict=True), start=1):
            kind = unit if unit in KINDS[1:] else "real"
            signals.append(Signal(name, kind, unit if kind == "real" else "", len(chosen[kind])))
            chosen[kind].append(index)
        data = {
            kind: table[:, columns].astype(np.float64 if kind == "real" else np.int32)
            for kind, columns in chosen.items()
        }
        signals, data = with_copies(signals, data, copies_beside(path))
        return cls(table[:, 0].copy(), signals, data)


def copies_of(signals: Sequence[Signal]) -> dict[str, dict[str, str]]:
    """Return copies by the rows that they are late: signal to the one that it copies, as ``summary.json`` has them."""
    found: dict[str, dict[str, str]] = {}
    for signal in signals:
        if signal.of:
            found.setdefault(str(signal.late), {})[signal.name] = signal.of
    return found


def copies_beside(path: Path) -> dict[str, tuple[str, int]]:
    """Return signal to the one that it copies, and how many rows late: what ``summary.json`` beside a file says."""
    try:
        return copies_in(json.loads(path.with_name("summary.json").read_bytes()))
    except (OSError, ValueError):  # none of ours
        return {}


def copies_in(summary: Any) -> dict[str, tuple[str, int]]:
    """Return signal to the one that it copies, and how many rows late, as a summary has it; nothing if it has not."""
    try:
        found = summary["copies"].items()
        return {str(name): (str(of), int(n)) for n, each in found for name, of in each.items()}
    except (KeyError, TypeError, ValueError, AttributeError):  # none of ours
        return {}


def with_copies(
    signals: Sequence[Signal], data: Mapping[str, NDArray[Any]], copies: Mapping[str, tuple[str, int]]
) -> tuple[list[Signal], dict[str, NDArray[Any]]]:
    """Return signals and data with the copies of those that are among them."""
    known = {signal.name: signal for signal in signals}
    more, added = list(signals), {kind: [array] for kind, array in data.items()}
    for name, (of, late) in copies.items():
        if of not in known or name in known:
            continue
        column, kind = known[of].column, known[of].kind
        if late:
            added[kind].append(later(data[kind][:, column], late)[:, None])
            column = sum(array.shape[1] for array in added[kind]) - 1
        more.append(known[of]._replace(name=name, column=column, of=of, late=late))
    return more, {kind: np.hstack(arrays) for kind, arrays in added.items()}


def later(column: NDArray[Any], rows: int) -> NDArray[Any]:
    """Return values that come some rows later; before that the first holds."""
    return column[np.maximum(np.arange(len(column)) - rows, 0)]


def no_rows(path: Path, error: OSError) -> VdfmuError:
    """Return the error of rows that cannot be written."""
    return VdfmuError(
        f"{path}: the rows cannot be written: {error.strerror or error}. Free space, or choose another folder with "
        "--out."
    )


def csv_head(signals: Sequence[Signal]) -> str:
    """Return the lines of names and of units."""
    head = ""
    for row in (
        ["time", *(s.name for s in signals)],
        ["s", *(s.unit if s.kind == "real" else s.kind for s in signals)],
    ):
        line = io.StringIO()
        csv.writer(line, lineterminator="\r\n").writerow(row)  # both of which are then quoted in names
        head += line.getvalue().removesuffix("\r\n") + "\n"
    return head


def csv_lines(time: Floats, signals: Sequence[Signal], data: Mapping[str, NDArray[Any]], rows: slice) -> str:
    """Return a line for each `time` and its row of `data`; numbers in their shortest form of the same bits."""
    if not len(time):
        return ""
    texts = {kind: _texts(array[rows]) for kind, array in data.items()}
    columns = [*_texts(time[:, None]), *(texts[s.kind][s.column] for s in signals)]
    return "".join(line + "\n" for line in map(",".join, zip(*columns, strict=True)))


def _texts(array: NDArray[Any]) -> list[list[str]]:
    """Return the texts of the numbers of each column of an array (m, n)."""
    if array.dtype.kind != "f" or not array.size:
        return [list(map(str, column)) for column in array.T.tolist()]
    # It takes a fifth of a second to import, and then a fifth of the time of Python's own texts.
    from scipy.io import mmwrite

    stream = io.BytesIO()
    mmwrite(stream, array, symmetry="general")  # a head, then a line a number, column by column
    texts = stream.getvalue().decode().splitlines()[-array.size :]
    return [texts[first : first + len(array)] for first in range(0, array.size, len(array))]
