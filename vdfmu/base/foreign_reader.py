"""The process that reads files of other tools; see `vdfmu.base.foreign`."""

from __future__ import annotations

import errno
import os
import pickle
import warnings
from collections.abc import Iterator
from pathlib import Path
from typing import IO, Any

import numpy as np
from numpy.typing import NDArray

from vdfmu.base.csv_file import repeated
from vdfmu.base.errors import UsageError
from vdfmu.base.foreign import ARROW, imported
from vdfmu.base.process import Parent, limit

_LIBRARIES = 2**30
"""Address space [byte] of Python and the libraries; 0.45 GiB was measured."""
_COPIES = 2
"""Number of copies of the content that a library may hold in memory."""
_ENTRY = 64
"""Bytes counted for each array in addition to its content and name."""
_ALIGNED = 16
"""Alignment of an array in its file [byte]."""
_ROWS = 2**16
"""Number of rows of a table read at a time."""
_MATLAB_NUMBERS = (
    "double",
    "single",
    "logical",
    "int8",
    "uint8",
    "int16",
    "uint16",
    "int32",
    "uint32",
    "int64",
    "uint64",
)
_CLASSES = {"function_handle": "a function handle", "cell": "a cell array", "struct": "an array of structs"}
"""Names of MATLAB's classes without numbers; all others are objects."""


class Handover:
    """Arrays for the parent, written to files in a folder up to a total size."""

    def __init__(self, folder: Path, most: int) -> None:
        self._folder, self._most, self._size = folder, most, 0
        self._files: dict[str, IO[bytes]] = {}
        self.names: list[str] = []
        self.blocks: list[Any] = []
        self.texts: dict[str, str] = {}
        self.units: dict[str, str] = {}
        self.left_out: list[str] = []

    def room(self, size: int) -> None:
        """Raise UsageError if this number of additional bytes exceeds the limit."""
        if self._size + size > self._most:
            limit, got = (f"{count / 2**20:.0f} MiB" for count in (self._most, self._size + size))
            raise UsageError(f"the file must unpack to at most {limit}, got {got} or more. Save a shorter part of it.")

    def write(self, file: str, array: NDArray[Any]) -> int:
        """Append the numbers of an array to a file; return the offset where they begin."""
        self.room(array.nbytes)
        self._size += array.nbytes
        if file not in self._files:
            self._files[file] = open(self._folder / file, "wb")  # noqa: SIM115
        offset = self._files[file].tell()
        self._files[file].write(np.ascontiguousarray(array).data)
        return offset

    def add(self, name: str, value: Any) -> None:
        """Add numbers or a text under a name, and each field of a single struct; ignore anything else."""
        name = name.encode("utf-8", "replace").decode()
        self._size += _ENTRY + len(name)
        kind = type(value).__name__
        if hasattr(value, "toarray"):
            if value.dtype.itemsize * value.shape[0] * value.shape[1] > self._most - self._size:
                self.leave(name, "a sparse matrix that is too large in full")
                return
            value = value.toarray()
        array: NDArray[Any] = np.asarray(value)
        if kind == "MatlabOpaque":
            self.leave(name, "an object")
        elif kind == "MatlabFunction":
            self.leave(name, "a function handle")
        elif array.dtype.names and array.size == 1:
            for field in array.dtype.names:
                self.add(f"{name}.{field}", array.flat[0][field])
        elif array.dtype.kind in "fiubc":
            array = array.astype(array.dtype.newbyteorder("="), copy=False)
            self.names.append(name)
            self.blocks.append(([name], "", array.dtype.str, array.shape, "arrays", self.write("arrays", array)))
            self.write("arrays", np.zeros(-array.nbytes % _ALIGNED, np.uint8))
        elif array.dtype.kind in "US":
            self.texts[name] = "\n".join(map(str, array.ravel().tolist()))
            self.room(4 * len(self.texts[name]))
        elif array.size:
            self.leave(name, "an array of structs" if array.dtype.names else "a cell array")

    def leave(self, name: str, kind: str) -> None:
        """Note a variable as ignored."""
        self.left_out.append(f"{name} ({kind})")

    def close(self) -> None:
        """Close the files."""
        for file in self._files.values():
            file.close()


def _matlab(path: str, store: Handover) -> None:
    with open(path, "rb") as file:
        version = file.read(128)[124:128]
    if version in (b"\0\2IM", b"\2\0MI"):
        _hdf5(path, store, "a MATLAB file of version 7.3")
        return
    from scipy.io import loadmat

    with warnings.catch_warnings():
        warnings.simplefilter("error", np.exceptions.ComplexWarning)
        try:
            variables = loadmat(path, appendmat=False, mat_dtype=True)
        except np.exceptions.ComplexWarning:  # scipy would cut off imaginary parts
            variables = loadmat(path, appendmat=False)
    for name, value in variables.items():
        if name == "None":  # scipy does not return the names of objects
            store.left_out.append("objects, such as strings and tables of MATLAB")
        elif not name.startswith("__"):
            store.add(name, value)


def _npz(path: str, store: Handover) -> None:
    archive: Any = np.load(path, allow_pickle=False)
    for name in archive.files:
        store.room(archive.zip.getinfo(name if name in archive.zip.namelist() else f"{name}.npy").file_size)
        store.add(name, archive[name])


def _hdf5(path: str, store: Handover, feature: str = "an HDF5 file") -> None:
    """Read the arrays of HDF5, each group once, without links. Handles MATLAB's classes and transposed arrays."""
    (h5py,) = imported(feature, "h5py", "matlab", "h5py")
    links: list[tuple[str, Any]] = []
    whole: tuple[str, ...] = ()
    """Prefixes of names in groups that form one variable."""
    with h5py.File(path, "r") as tree:
        tree.visititems_links(lambda name, link: links.append((name, link)))
        for place, link in links:
            name = place.replace("/", ".")
            if place.startswith(("#", *whole)):
                continue
            if not isinstance(link, h5py.HardLink):
                store.leave(name, "a link")
                continue
            item = tree[place]
            kind = item.attrs.get("MATLAB_class", b"")
            kind = kind.decode() if isinstance(kind, bytes) else str(kind)
            if isinstance(item, h5py.Dataset):
                _dataset(name, item, kind, store)
            elif kind not in ("", "struct"):
                whole += (f"{place}/",)
                rows = item.attrs.get("MATLAB_sparse")
                if kind in _MATLAB_NUMBERS and rows is not None:
                    store.add(name, _sparse(item, int(rows)))
                else:
                    store.leave(name, _CLASSES.get(kind, "an object"))


def _sparse(group: Any, rows: int) -> Any:
    from scipy.sparse import csc_matrix

    starts = group["jc"][()]
    stored = (_complex(group["data"][()]), group["ir"][()]) if "data" in group else ([], [])
    return csc_matrix((*stored, starts), shape=(rows, len(starts) - 1))


def _dataset(name: str, item: Any, kind: str, store: Handover) -> None:
    if item.shape is None or item.attrs.get("MATLAB_empty", 0):
        return
    if item.external or item.is_virtual:
        store.leave(name, "numbers in another file")
    elif kind == "char":
        store.room(item.nbytes)
        store.texts[name] = "".join(map(chr, np.ravel(item[()].T).tolist()))
    elif kind and kind not in _MATLAB_NUMBERS:
        store.leave(name, _CLASSES.get(kind, "an object"))
    else:
        store.room(item.nbytes)
        value = _complex(item[()])
        store.add(name, value.T if kind else value)


def _complex(value: NDArray[Any]) -> NDArray[Any]:
    """Return pairs of real and imaginary fields as complex numbers, other values unchanged."""
    return value["real"] + 1j * value["imag"] if value.dtype.names == ("real", "imag") else value


def _parquet(path: str, store: Handover) -> None:
    """Read columns of numbers and times block by block, columns of one type together. Missing numbers are NaN."""
    pa, parquet = _arrow()
    with open(path, "rb") as stream:
        file = parquet.ParquetFile(stream)
        schema = file.schema_arrow
        if twice := repeated(schema.names):
            raise UsageError(f"{', '.join(twice)}: more than one column has this name. Rename the others.")
        metadata = schema.metadata or {}
        store.texts |= {
            key.decode("utf-8", "replace"): text.decode("utf-8", "replace") for key, text in metadata.items()
        }
        stored: dict[str, tuple[str, str]] = {}  # type of a column, and the type in which the parent gets its numbers
        whole: list[str] = []
        for field in schema:
            kind = field.type
            if pa.types.is_timestamp(kind) or pa.types.is_date(kind):
                store.units[field.name], stored[field.name] = "ns", (str(kind), "<i8")
            elif pa.types.is_boolean(kind):
                stored[field.name] = str(kind), "<i4"
            elif pa.types.is_integer(kind) or pa.types.is_floating(kind):
                stored[field.name] = str(kind), np.dtype(kind.to_pandas_dtype()).str
            else:
                store.leave(field.name, str(kind))
            if pa.types.is_boolean(kind) or pa.types.is_integer(kind):
                whole.append(field.name)
            if unit := (field.metadata or {}).get(b"unit"):
                store.units[field.name] = unit.decode("utf-8", "replace")

        def batches(columns: list[str]) -> Iterator[Any]:
            # threads hang if memory is short
            return file.iter_batches(_ROWS, columns=columns, use_threads=False) if columns else iter(())

        gaps = {name for batch in batches(whole) for name in whole if batch[name].null_count}
        stored |= dict.fromkeys(gaps, (str(pa.float64()), "<f8"))
        groups: dict[tuple[str, str, bool], list[str]] = {}
        for name, types in stored.items():  # the first column has the times
            groups.setdefault((*types, name == schema.names[0]), []).append(name)
        store.names, rows = [*stored], 0
        for batch in batches(store.names):
            rows += len(batch)
            for number, ((_, dtype, _), names) in enumerate(groups.items()):
                columns = [_numbers(pa, batch[name], name in gaps) for name in names]
                store.write(f"columns_{number}", np.column_stack(columns).astype(dtype, copy=False))
        for number, ((kind, dtype, _), names) in enumerate(groups.items()):
            store.write(f"columns_{number}", np.empty(0))  # makes the file even if there are no rows
            store.blocks.append((names, kind, dtype, (rows, len(names)), f"columns_{number}", 0))


def _table(path: str, folder: str, columns: Any, store: Handover) -> None:
    """Copy a Parquet file, ``all`` of it or some columns, to Arrow's format."""
    pa, parquet = _arrow()
    with open(path, "rb") as stream:
        file = parquet.ParquetFile(stream, page_checksum_verification=True)
        names = None if columns == "all" else columns
        table = file.schema_arrow.empty_table() if columns == [] else file.read(names, use_threads=False)
    store.room(table.nbytes)
    with open(os.path.join(folder, ARROW), "wb") as sink, pa.ipc.new_file(sink, table.schema) as writer:
        writer.write_table(table)


def _arrow() -> tuple[Any, ...]:
    os.environ["ARROW_DEFAULT_MEMORY_POOL"] = "system"  # other allocators reserve address space
    return imported("Parquet", "pyarrow", "parquet", "pyarrow", "pyarrow.parquet")


def _numbers(pa: Any, column: Any, gaps: bool) -> NDArray[Any]:
    """Return the numbers of a column; times become ns since 1970."""
    if gaps:
        column = column.cast(pa.float64(), safe=False)
    values = column.to_numpy(zero_copy_only=False)
    return values.astype("datetime64[ns]").astype(np.int64) if values.dtype.kind == "M" else values


_READERS = {".mat": _matlab, ".npz": _npz, ".h5": _hdf5, ".hdf5": _hdf5, ".parquet": _parquet}


def _answer(path: str, folder: str, most: int, columns: Any) -> dict[str, Any]:
    """Read a file, or `columns` of a table; return its blocks, texts, units and ignored content, or a fault."""
    limit("AS", _LIBRARIES + _COPIES * most, lasting=False)
    store, fault, said, full = Handover(Path(folder), most), "", False, ""
    try:
        if columns is None:
            _READERS[os.path.splitext(path)[1].lower()](path, store)
        else:
            _table(path, folder, columns, store)
        store.close()  # a full disk may be reported here
    except UsageError as error:
        fault, said = str(error), True
    except MemoryError:
        fault = f"the memory limit of {(_LIBRARIES + _COPIES * most) / 2**20:.0f} MiB is too small. Save a part of it."
    except Exception as error:  # damage raises a dozen kinds of errors
        if isinstance(error, OSError) and error.errno in (errno.ENOSPC, errno.EDQUOT):
            full = error.strerror
        fault = (str(error).splitlines() or [""])[0][:300] or type(error).__name__
    head = {"fault": fault, "said": said, "full": full}
    return head | {key: getattr(store, key) for key in ("names", "blocks", "texts", "units", "left_out")}


def _main() -> None:
    parent = Parent()
    warnings.simplefilter("ignore")
    for request in parent.requests():
        parent.reply(_answer(*pickle.loads(request)))


if __name__ == "__main__":
    _main()
