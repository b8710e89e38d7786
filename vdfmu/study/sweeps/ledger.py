"""The folder of a parameter study: a file per chunk of points, which is both result and record of progress.

A part is moved to its place when it is complete, so a killed study can resume, and no point occurs twice. When all are
done, the parts are merged into one file, ``sweep.parquet``; without pyarrow all files are CSV, see `PlainTable`.
"""

from __future__ import annotations

import csv
import json
import os
import re
from collections.abc import Iterator, Mapping, Sequence
from contextlib import suppress
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from vdfmu.base.cache import seal
from vdfmu.base.errors import UsageError, VdfmuError
from vdfmu.base.files import closed, make_folder, read_json, read_regular, replacing, sync
from vdfmu.base.interrupt import InterruptGuard
from vdfmu.base.text import elided
from vdfmu.engine.results.parquet import needed
from vdfmu.study.sweeps.axes import Points
from vdfmu.study.sweeps.job import Row
from vdfmu.study.sweeps.plain_table import TEXTS, PlainTable
from vdfmu.study.sweeps.worker import KILLED

TABLE, PLAIN = TABLES = "sweep.parquet", "sweep.csv"
"""All points, once they are done, in Parquet or in CSV."""
LEDGER = "sweep.json"
"""Facts of the study."""
_PARTS = "parts"
_METADATA = b"vdfmu"
_PART = re.compile(r"part_\d+_\d+\.(parquet|csv)")
_NUMBERS = ("failed_at", "wall_s")


class Ledger:
    """Finished points of a study, in a folder that only one process writes to, in Parquet, or CSV without pyarrow.

    The study has `facts` and their digest `key`; each row gets the axes' values, `points`. UsageError if the folder
    contains another study and `overwrite` is not set, is in use, cannot be written to, or needs pyarrow.
    """

    def __init__(
        self, folder: Path, facts: Mapping[str, Any], key: str, points: Points, overwrite: bool = False
    ) -> None:
        self.notes: list[str] = []
        self.folder, self._parts, self._key, self._points = folder, folder / _PARTS, key, points
        self._facts: dict[str, Any] = {**facts, "key": key}
        self._facts["seal"] = seal(self._facts, str(folder.resolve()))
        self._overwrite = overwrite

    def __enter__(self) -> Ledger:
        try:
            make_folder(self._parts)
            self._lock = _locked(self.folder / ".lock")
        except OSError as error:
            raise UsageError(
                f"{self.folder}: cannot hold the study: {error.strerror or error}. Choose another folder with --out."
            ) from None
        try:
            self._choose_format()
            self._check()
        except BaseException:
            self.__exit__(None, None, None)
            raise
        return self

    def __exit__(self, *_: object) -> None:
        closed(self._lock)
        with suppress(OSError):  # it contains parts
            self._parts.rmdir()

    def _choose_format(self) -> None:
        """Choose CSV if the folder has CSV, or has no files and pyarrow is missing; UsageError if it is needed."""
        plain = [file.suffix == Path(PLAIN).suffix for file in files_of(self.folder)]
        try:
            if not any(plain):
                self._arrow, self._parquet = needed()
        except UsageError:
            if plain:
                raise
            way = "'pip install vdfmu[parquet]' makes it smaller and faster to read"
            self.notes.append(f"The table is CSV, because pyarrow is not installed; {way}.")
            plain = [True]
        self._table_name = TABLES[any(plain)]

    def _check(self) -> None:
        """Claim the folder if it is empty or has this study."""
        place = self.folder / LEDGER
        facts: dict[str, Any] = {}
        try:
            facts = read_json(readable(place)) if place.exists() else {}
            key = facts.get("key")
        except (ValueError, AttributeError):
            facts, key = {}, ""
        if key == self._key:
            return
        if files := files_of(self.folder):
            if not self._overwrite:
                raise UsageError(
                    f"{self.folder}: holds another study; expected this study or an empty folder."
                    f"{self._difference(facts)} Choose another folder with --out, or replace it with --overwrite."
                )
            for file in files:
                file.unlink()
            sync(self.folder)
        self._put(place, json.dumps(self._facts, indent=1).encode() + b"\n")

    def _difference(self, facts: Mapping[str, Any]) -> str:
        """Return how the study in the folder differs, if its `facts` can be read."""
        names = {"vdfmu": "release", "systems": "units, values or files"}
        apart = {"source", "options", "search", "key", "seal", "points", "units"}
        differing = [names.get(n, n) for n, fact in self._facts.items() if n not in apart and facts.get(n) != fact]
        return f" They differ in {', '.join(differing)}." if facts and differing else ""

    def _put(self, place: Path, content: bytes) -> None:
        try:
            with InterruptGuard(), replacing(place) as file:
                file.write(content)
        except OSError as error:
            raise VdfmuError(
                f"{place}: cannot be written: {error.strerror or error}. Completed points are kept: free space, "
                "and repeat the command."
            ) from None

    def done(self, again: str = KILLED) -> NDArray[np.bool_]:
        """Return whether each point is done, (n,).

        Incomplete files are set aside with a note, and rows of points whose reason of failure begins with `again` are
        removed, so that these points are run again. UsageError for a file that cannot be read.
        """
        done = np.zeros(self._facts["n"], dtype=bool)
        for table in self._kept(again, len(done)):
            done[table["point"].to_numpy()] = True
        return done

    def reopen(self) -> list[Row]:
        """Return the rows of a study that may get more points; see `done`."""
        for _ in self._kept(KILLED):
            pass
        return [row for file in self._files() for row in table_of(file).to_pylist()]

    def _files(self) -> list[Path]:
        """Return the files, after removing parts that a kill left although the table already has them."""
        files = files_of(self.folder)
        if len(files) > 1 and files[0].name in TABLES:
            points = set(table_of(files[0], ["point"])["point"].to_pylist())
            for file in files[1:]:
                if points.issuperset(table_of(file, ["point"])["point"].to_pylist()):
                    file.unlink()
                    files.remove(file)
        return files

    def _kept(self, again: str, n: int | None = None) -> Iterator[Any]:
        """Yield points, below `n`, and reasons of failure in the intact part of each file; see `done`."""
        for file in files_of(self.folder):
            try:
                rows = table_of(file, ["point", "failed"])
                _require_rows(file, rows, n)
            except BrokenError as error:
                self._set_aside(error)
                continue
            reasons = rows["failed"]
            if reasons.null_count == len(reasons):  # none failed, so no row is read
                yield rows
                continue
            good = [why is None or not why.startswith(again) for why in reasons.to_pylist()]
            kept = rows.filter(good)
            if kept.num_rows < rows.num_rows:
                points = kept["point"].to_numpy()
                place = self._place(points[0], points[-1]) if len(points) else None
                if place is not None:
                    self._write(table_of(file).filter(good), place)
                if place != file:
                    file.unlink()
            yield kept

    def _set_aside(self, error: BrokenError) -> None:
        """Rename an incomplete file to an unused name."""
        number = 0
        while (aside := error.file.with_name(f"{error.file.name}.broken{number or ''}")).exists():
            number += 1
        os.replace(error.file, aside)
        self.notes.append(f"{error}, so its points are run again. It is now {aside}")

    def add(self, rows: Sequence[Row]) -> None:
        """Store the rows of consecutive points."""
        if rows:
            self._write(self._table(rows), self._place(rows[0]["point"], rows[-1]["point"]))

    def _place(self, first: int, last: int) -> Path:
        return self._parts / f"part_{first:08d}_{last:08d}{Path(self._table_name).suffix}"

    def _write(self, table: Any, place: Path) -> None:
        """Write a part; the facts of the study, maybe thousands of values, are only in `LEDGER`, once for all parts."""
        if isinstance(table, PlainTable):
            self._put(place, table.packed())
            return
        buffer = self._arrow.BufferOutputStream()
        self._parquet.write_table(table.replace_schema_metadata(), buffer, compression="zstd", write_page_checksum=True)
        self._put(place, buffer.getvalue())

    def _table(self, rows: Sequence[Row]) -> Any:
        if self._table_name == PLAIN:
            axes = self._points.items()
            kept = [row | {target: values[row["point"]] for target, values in axes} for row in rows]
            return PlainTable.of_rows(kept, ("point", *self._points, *TEXTS, *_NUMBERS))
        pa = self._arrow
        index = np.array([row["point"] for row in rows])
        columns: dict[str, Any] = {"point": pa.array(index, pa.int64())}
        for target, values in self._points.items():
            columns[target] = pa.array(values[index])
        for name, kind in (dict.fromkeys(TEXTS, pa.string()) | dict.fromkeys(_NUMBERS, pa.float64())).items():
            columns[name] = pa.array([row.get(name) for row in rows], kind)
        for name in dict.fromkeys(name for row in rows for name in row):
            if name not in columns:
                values = [row.get(name) for row in rows]
                several = any(isinstance(value, np.ndarray) for value in values)
                columns[name] = pa.array(values, pa.list_(pa.float64()) if several else pa.float64())
        return pa.table(columns)

    def finish(self) -> Path:
        """Merge the parts into one file, in the order of the points, and return it."""
        place = self.folder / self._table_name
        files = self._files()
        if not files or files == [place]:
            return place
        if self._table_name == PLAIN:
            self._write(PlainTable.joined([table_of(file) for file in files]).sort_by("point"), place)
            self._files()
            return place
        pa = self._arrow
        try:
            schema = pa.unify_schemas(
                [table_of(file, []).schema for file in files], promote_options="permissive"
            ).with_metadata({_METADATA: json.dumps(self._facts)})
            with InterruptGuard(), replacing(place) as stream:
                with self._parquet.ParquetWriter(
                    stream, schema, compression="zstd", write_page_checksum=True
                ) as writer:
                    for tables in _groups((table_of(file) for file in files), _in_order(files)):
                        together = pa.concat_tables([schema.empty_table(), *tables], promote_options="permissive")
                        writer.write_table(together.sort_by("point").cast(schema))
        except BrokenError as error:
            self._set_aside(error)
            raise VdfmuError(f"{self.notes[-1]}: repeat the command to run them.") from None
        except pa.ArrowException as error:
            raise VdfmuError(
                f"{self._parts}: its files have columns that do not fit together: {error}. Choose another folder with "
                "--out, or replace the study with --overwrite."
            ) from None
        except OSError as error:
            raise VdfmuError(
                f"{place}: cannot be written: {error.strerror or error}. The points are in {self._parts}: free space, "
                "and repeat the command."
            ) from None
        self._files()
        return place


class BrokenError(UsageError):
    """A file is incomplete, or does not belong to a study."""

    def __init__(self, file: Path, why: object) -> None:
        super().__init__(f"{file}: is not whole: {why}")
        self.file = file


def files_of(folder: Path) -> list[Path]:
    """Return the existing files of a study, the table first; UsageError if the disk fails."""
    try:
        parts = sorted(name for name in os.listdir(folder / _PARTS) if _PART.fullmatch(name))
    except FileNotFoundError:
        parts = []
    except OSError as error:
        raise _refused(folder / _PARTS, error) from None
    tables = [folder / name for name in TABLES if (folder / name).exists()]
    return [*tables, *(folder / _PARTS / name for name in parts)]


def table_in(folder: Path) -> Path:
    """Return the path of the table of a study, in CSV if it is there."""
    return folder / TABLES[(folder / PLAIN).exists()]


def _refused(path: Path, error: OSError) -> UsageError:
    return UsageError(
        f"{path}: cannot be read: {error.strerror or error}. It is left as it is: repeat the command once it "
        "can be read, or choose another folder with --out."
    )


def readable(path: Path) -> bytes:
    """Return the content of a study's file; UsageError if it cannot be read now. Nothing is changed."""
    try:
        return read_regular(path)
    except OSError as error:
        raise _refused(path, error) from None


def table_of(path: Path, columns: Sequence[str] | None = None) -> Any:
    """Return the table of a file, or some of its columns; `BrokenError` if it is damaged.

    The bytes are read first, because Arrow accepts only names in UTF-8 and reports errors of the disk as errors of the
    file. Threads are off, because `parquet.read_table` waits for them forever if memory is short, and a thread that
    starts as the process ends aborts it.
    """
    if path.suffix == Path(PLAIN).suffix:
        try:
            return PlainTable.read(readable(path), columns)
        except (ValueError, csv.Error) as error:
            raise BrokenError(path, elided(str(error))) from None
    pyarrow, parquet = needed()
    content = pyarrow.BufferReader(readable(path))
    try:
        if columns is not None and not columns:
            return parquet.read_schema(content).empty_table()
        file = parquet.ParquetFile(content, page_checksum_verification=True)
        return file.read(columns=columns, use_threads=False)
    except MemoryError:
        raise UsageError(f"{path}: the memory does not hold it.") from None
    except (pyarrow.ArrowException, OSError, ValueError) as error:
        raise BrokenError(path, elided(str(error))) from None


def _require_rows(file: Path, rows: Any, n: int | None) -> None:
    """Raise BrokenError unless rows have points, below `n`, and reasons of failure."""
    if isinstance(rows, PlainTable):
        types, expected = set(map(type, rows["point"] if "point" in rows.names else ())), {int}
    else:
        pa, _ = needed()
        types, expected = rows.schema.types, [pa.int64(), pa.string()]
    if rows.schema.names != ["point", "failed"] or types != expected:
        raise BrokenError(file, "expected columns of points and of reasons of failure")
    points = rows["point"]
    most = np.inf if n is None else n
    if not len(points) or points.null_count or not _within(points.to_numpy(), most):
        raise BrokenError(file, f"expected points from 0 to {most - 1:g}")


def _within(points: NDArray[np.int64], most: float) -> bool:
    return bool(((points >= 0) & (points < most)).all())


def _in_order(files: Sequence[Path]) -> bool:
    """Return whether the points of each file are known to follow those of the previous file."""
    if files[0].name in TABLES and len(files) > 1:
        return False
    ends = [int(number) for file in files for number in file.stem.split("_")[1:]]
    return all(a <= b for a, b in pairwise(ends))


def _groups(tables: Iterator[Any], ordered: bool, most: int = 16 * 2**20) -> Iterator[list[Any]]:
    """Concatenate tables up to a number of bytes, or all of them if their points are mixed."""
    group: list[Any] = []
    size = 0
    for table in tables:
        group.append(table)
        size += table.nbytes
        if ordered and size > most:
            yield group
            group, size = [], 0
    if group:
        yield group


def _locked(path: Path) -> int:
    """Open a file that only one process may hold; UsageError if another holds it."""
    handle = os.open(path, os.O_RDWR | os.O_CREAT, 0o666)
    try:
        if os.name == "nt":
            import msvcrt

            msvcrt.locking(handle, msvcrt.LK_NBLCK, 1)  # pyright: ignore
        else:
            import fcntl

            fcntl.flock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except OSError:
        closed(handle)
        raise UsageError(
            f"{path.parent}: another process runs this study. Wait for it, or choose another folder with --out."
        ) from None
    return handle
