"""Units of what is there already: a linear system, a CasADi function, a table of data."""

from __future__ import annotations

import csv
import re
import runpy
import sys
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import casadi as ca
import numpy as np

from vdfmu.base.errors import UnitError, UsageError
from vdfmu.base.temporary import temporary_folder
from vdfmu.compiler.unit.load import load_units
from vdfmu.compiler.unit.new import class_and_file, write_new
from vdfmu.compiler.unit.wrap_text import DataTable, Matrices, function_text, linear_text, table_text

_KINDS = "model.mat or model.npz with A, B, C, D, function.casadi, table.csv, or design.py:NAME for an object"


def unit_from(source: str, name: str | None = None, out: Path | None = None) -> list[Path]:
    """Write the file of a unit of what `source` holds, and what that loads from its folder.

    Parameters
    ----------
    source : str
        A ``.mat`` or ``.npz`` file with the matrices A, B, C and D, and ``dt`` or ``Ts`` [s] of a discrete system; a
        ``.casadi`` file, written by ``Function.save``; a ``.csv`` file with names in its first line; or an object of a
        Python file, ``design.py:NAME``: a system of python-control or scipy.signal, or a CasADi function.
    name : str, optional
        Of the unit, as of :func:`~vdfmu.compiler.unit.new.new_unit`; default that of the file or the object.
    out : path, optional
        File to write; default after the name.

    Returns
    -------
    list of Path
        The unit's file first.

    Raises
    ------
    UsageError
        For a source that cannot be read, or what it holds; for files that exist.
    UnitError
        For a Python file that fails, or a unit of measurement that does not exist.
    StorageError
        If a file cannot be written.
    """
    path, found = _read(source)
    camel, target = class_and_file(name or _stem(source), out)
    beside: dict[Path, bytes] = {}
    if isinstance(found, Matrices):
        text = linear_text(camel, found)
    elif isinstance(found, DataTable):
        beside[target.with_name(path.name)] = path.read_bytes()
        text = table_text(camel, found, path.name)
    else:
        saved = target.with_suffix(".casadi")
        beside[saved] = _saved(found)
        text = function_text(camel, found, saved.name)
    head = f'"""The unit of {source}. To build its FMU: vdfmu build {target.name}"""\n\n'
    files = {target: (head + text).encode()}
    files |= {place: content for place, content in beside.items() if place.resolve() != path.resolve()}
    write_new(files)
    try:
        load_units(target)
    except UnitError:
        for place in files:
            place.unlink(missing_ok=True)
        raise
    return list(files)


def _saved(function: ca.Function) -> bytes:
    """Return the content of the file that ``Function.save`` writes."""
    with temporary_folder("vdfmu_") as folder:
        file = Path(folder) / "function.casadi"
        function.save(str(file))
        return file.read_bytes()


def _stem(source: str) -> str:
    """Return the name of a unit after the object, or the file."""
    stem = source.rpartition(":")[2] if _in_python(source) else Path(source).stem
    return re.sub("[^a-z0-9]+", "_", stem.lower()).strip("_")


def _in_python(source: str) -> bool:
    return re.search(r"\.py:\w+$", source) is not None


def _read(source: str) -> tuple[Path, Matrices | DataTable | ca.Function]:
    """Return the file of a source, and what it holds."""
    file, name = source.rsplit(":", 1) if _in_python(source) else (source, "")
    path = Path(file)
    if not path.is_file():
        raise UsageError(f"{path}: there is no such file.")
    try:
        if name:
            return path, _object(path, name)
        if path.suffix == ".csv":
            return path, _table(path)
        if path.suffix == ".casadi":
            return path, _expandable(ca.Function.load(str(path)))
        if path.suffix == ".npz":
            with np.load(path) as archive:
                return path, _linear(dict(archive))
        if path.suffix == ".mat":
            from scipy.io import loadmat

            return path, _linear(loadmat(path))
    except UsageError as error:
        raise UsageError(f"{source}: {error}") from None
    except (OSError, ValueError, NotImplementedError, RuntimeError) as error:
        raise UsageError(f"{source}: cannot be read: {str(error).splitlines()[0].rstrip('.')}.") from None
    raise UsageError(f"{source}: expected {_KINDS}.")


def _object(path: Path, name: str) -> Matrices | ca.Function:
    """Return what an object of a Python file is, which is run."""
    sys.path.insert(0, str(path.parent.resolve()))
    try:
        found: Any = runpy.run_path(str(path)).get(name)
    except Exception as error:
        raise UnitError(f"{path}: {type(error).__name__}: {str(error).rstrip('.')}.") from None
    finally:
        sys.path.pop(0)
    if isinstance(found, ca.Function):
        return _expandable(found)
    if not hasattr(found, "A") and hasattr(found, "to_ss"):  # of scipy
        found = found.to_ss()
    matrices = {key: getattr(found, key) for key in "ABCD" if hasattr(found, key)}
    if len(matrices) < 4:
        raise UsageError(
            f"expected a CasADi function, or a system with A, B, C and D, got {type(found).__name__}. A transfer "
            "function of python-control becomes one by control.ss."
        )
    labels = {"u": "input_labels", "y": "output_labels", "x": "state_labels"}  # of python-control
    return _linear(
        matrices | {"dt": getattr(found, "dt", None)}, {key: getattr(found, name, ()) for key, name in labels.items()}
    )


def _expandable(function: ca.Function) -> ca.Function:
    """Return a function of scalar operations."""
    sizes = {function.name_in(k): function.numel_in(k) for k in range(function.n_in())}
    sizes |= {function.name_out(k): function.numel_out(k) for k in range(function.n_out())}
    if empty := [name for name, size in sizes.items() if not size]:
        raise UsageError(f"{function.name()}: {empty[0]} is empty. Leave it out.")
    try:
        scalar = function.expand()
    except RuntimeError:
        scalar = None
    if scalar is None or ca.OP_CALL in map(scalar.instruction_id, range(scalar.n_instructions())):
        raise UsageError(
            f"{function.name()} has more than scalar operations, a solver or an interpolant: no C is made of that here."
        )
    return scalar


def _linear(found: Mapping[str, Any], labels: Mapping[str, Sequence[str]] | None = None) -> Matrices:
    """Return the system with such matrices."""
    missing = [name for name in "ABCD" if name not in found]
    if missing:
        raise UsageError(f"expected A, B, C and D, got no {missing[0]}.")
    A, B, C, D = (np.atleast_2d(np.asarray(found[name])) for name in "ABCD")
    n, (p, m) = A.shape[0] if A.size else 0, D.shape
    if not n:
        A, B, C = np.zeros((0, 0)), np.zeros((0, m)), np.zeros((p, 0))
    for name, matrix, shape in (("A", A, (n, n)), ("B", B, (n, m)), ("C", C, (p, n))):
        if matrix.shape != shape:
            raise UsageError(
                f"{name}: expected shape {shape}, for A and D of {A.shape} and {(p, m)}, got {matrix.shape}."
            )
    for name, matrix in zip("ABCD", (A, B, C, D), strict=True):
        if matrix.dtype.kind not in "iuf" or not np.isfinite(matrix).all():
            raise UsageError(f"{name}: expected finite real numbers.")
    if not D.size:
        raise UsageError("expected at least one input and one output.")
    step = found.get("dt", found.get("Ts"))
    if step is True:
        raise UsageError("dt: expected the time between samples in s, got True, of a system without one.")
    dt = float(np.ravel(step)[0]) if step is not None and np.size(step) else 0.0
    if not 0.0 <= dt < np.inf:
        raise UsageError(f"dt: expected a time between samples of at least 0 s, got {dt:g}.")
    return Matrices(A.astype(float), B.astype(float), C.astype(float), D.astype(float), dt or None, labels or {})


def _table(path: Path) -> DataTable:
    """Return the columns of a CSV file. Units are in brackets behind the names, or in a line of their own."""
    with path.open(encoding="utf-8-sig", newline="") as file:
        lines = [line for line in csv.reader(file) if line]
    if len(lines) < 3 or len(lines[0]) < 2:
        raise UsageError("expected names in the first line, two columns or more with commas between, and two rows.")
    heads = [re.fullmatch(r"\s*(.*?)\s*(?:\[(.*)\])?\s*", head) for head in lines[0]]
    names = [re.sub(r"\W+", "_", head[1]).strip("_") for head in heads if head]
    units = [head[2] or "1" for head in heads if head]
    skipped = 1
    if not any(map(_is_number, lines[1])):
        units, skipped = [unit.strip() or "1" for unit in lines[1]], 2
    rows = []
    for k, line in enumerate(lines[skipped:], skipped + 1):
        if len(line) != len(names) or not all(map(_is_number, line)):
            raise UsageError(f"line {k}: expected {len(names)} finite numbers, got {','.join(line)!r}.")
        rows.append([float(cell) for cell in line])
    wrong = [lines[0][k] for k, name in enumerate(names) if not name.isidentifier() or name in names[:k]]
    if wrong:
        raise UsageError(f"column {wrong[0]!r}: expected a name of letters, digits and _, another for each column.")
    table = np.array(rows)
    if (np.diff(table[:, 0]) <= 0.0).any():
        raise UsageError(f"column {names[0]}: expected numbers that increase from row to row.")
    return DataTable(names, units, table, skipped)


def _is_number(cell: str) -> bool:
    try:
        return bool(np.isfinite(float(cell)))
    except ValueError:
        return False
