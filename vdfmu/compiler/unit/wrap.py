"""Units of what is there already: a linear system, a CasADi function, a table of data."""

from __future__ import annotations

import csv
import keyword
import re
import runpy
import sys
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import casadi as ca
import numpy as np

from vdfmu.base.errors import UnitError, UsageError
from vdfmu.base.files import temporary_folder
from vdfmu.base.mat import mat_variables
from vdfmu.base.measure import measure
from vdfmu.base.text import kind_text
from vdfmu.base.unpack import UnpackBudget
from vdfmu.compiler.unit.load import load_units
from vdfmu.compiler.unit.new import class_and_file, write_new
from vdfmu.compiler.unit.unit import Unit
from vdfmu.compiler.unit.wrap_text import DataTable, Matrices, function_text, linear_text, table_text

_KINDS = "model.mat or model.npz with A, B, C, D, function.casadi, table.csv, or design.py:NAME for an object"


def unit_from(source: str, name: str | None = None, out: Path | None = None, *, trust: bool = False) -> list[Path]:
    """Write the file of a unit of what `source` holds, and what that loads from its folder.

    Parameters
    ----------
    source : str
        A ``.mat`` or ``.npz`` file with the matrices A, B, C and D, and ``dt`` or ``Ts`` [s] of a discrete system; a
        ``.casadi`` file, written by ``Function.save``; a ``.csv`` file with names in its first line; or an object of a
        Python file, ``design.py:NAME``: a system of python-control or scipy.signal, or a CasADi function.
    name : str, optional
        Name of the unit, see :func:`~vdfmu.compiler.unit.new.new_unit`; default the name of the file or the object.
    out : path, optional
        File to write; default after the name.
    trust : bool
        Load a ``.casadi`` file, although it can hold code that runs then.

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
    path, found = _read(source, trust)
    camel, target = class_and_file(name or _stem(source), out)
    files: dict[Path, bytes] = {}
    if isinstance(found, Matrices):
        text = linear_text(camel, found)
    elif isinstance(found, DataTable):
        beside = target.with_name(f"{target.stem}_data.csv")
        rows = [",".join(found.names), *(",".join(map(repr, row)) for row in found.rows.tolist())]
        text, files[beside] = table_text(camel, found, beside.name), ("\n".join(rows) + "\n").encode()
    else:
        beside = target.with_suffix(".casadi")
        text = function_text(camel, found, beside.name)
        if beside.resolve() != path.resolve():
            files[beside] = _saved(found)
    head = f'"""Written by vdfmu unit from. To build its FMU: vdfmu build {target.name}"""\n\n'
    files = {target: (head + text).encode()} | files
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


def _read(source: str, trust: bool) -> tuple[Path, Matrices | DataTable | ca.Function]:
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
        if path.suffix == ".casadi" and not trust:
            raise UsageError("a CasADi file can hold code that runs. If you trust who made it, give --trust.")
        if path.suffix == ".casadi":
            return path, _expandable(ca.Function.load(str(path)))
        if path.suffix == ".npz":
            with np.load(path) as archive:
                UnpackBudget(path).spend(sum(info.file_size for info in archive.zip.infolist()))
                return path, _linear(dict(archive))
        if path.suffix == ".mat":
            return path, _linear(mat_variables(path))
    except UsageError as error:
        raise UsageError(f"{source}: {str(error).removeprefix(f'{path}: ')}") from None
    except UnitError:
        raise
    except Exception as error:  # readers of broken files raise of many kinds
        said = (str(error).splitlines() or [""])[0].rstrip(".")
        raise UsageError(f"{source}: cannot be read: {type(error).__name__}{said and f': {said}'}.") from None
    raise UsageError(f"{source}: expected {_KINDS}.")


def _object(path: Path, name: str) -> Matrices | ca.Function:
    """Return what an object of a Python file is, which is run."""
    sys.path.insert(0, str(path.parent.resolve()))
    try:
        found: Any = runpy.run_path(str(path)).get(name)
    except (Exception, SystemExit) as error:
        raise UnitError(f"{path}: {kind_text(error).rstrip('.')}.") from None
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
    given = {function.name_in(k): function.sparsity_in(k) for k in range(function.n_in())}
    found = {function.name_out(k): function.sparsity_out(k) for k in range(function.n_out())}
    for name, sparsity in (given | found).items():
        _check_name(name, f"{function.name()}: {name}", time=name in given)
        if not sparsity.numel() or (name in given and not sparsity.is_dense()):
            kind = "sparse" if sparsity.numel() else "empty"
            raise UsageError(f"{function.name()}: {name} is {kind}. Leave it out, or make it dense.")
    if "alg" in found:
        raise UsageError(f"{function.name()}: alg has to be 0, which is no unit: solve for z, or give ode alone.")
    if "x" in given and "ode" in found and given["x"].shape != found["ode"].shape:
        raise UsageError(
            f"{function.name()}: expected ode of the shape of x, {given['x'].shape}, got {found['ode'].shape}."
        )
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
    dt = 0.0 if step is None or not np.size(step) else -1.0 if step is True else float(np.ravel(step)[0])
    if not 0.0 <= dt < np.inf:
        raise UsageError(
            f"dt: expected the time between samples in s, dt=0.001, got {'True' if step is True else f'{dt:g}'}."
        )
    return Matrices(A.astype(float), B.astype(float), C.astype(float), D.astype(float), dt or None, labels or {})


def _table(path: Path) -> DataTable:
    """Return the columns of a CSV file. Units are in brackets behind the names, or in a line of their own.

    Columns are apart by commas, or by semicolons, and then numbers may have decimal commas.
    """
    text = path.read_text(encoding="utf-8-sig")
    separator = ";" if ";" in text.partition("\n")[0] else ","
    lines = [line for line in csv.reader(text.splitlines(), delimiter=separator) if any(line)]
    if separator == ";":
        lines[1:] = [[cell.replace(",", ".") for cell in line] for line in lines[1:]]
    if len(lines) < 3 or len(lines[0]) < 2:
        raise UsageError("expected names in the first line, two columns or more with commas between, and two rows.")
    heads = [re.fullmatch(r"\s*(.*?)\s*(?:\[(.*)\])?\s*", head) for head in lines[0]]
    names = [re.sub(r"\W+", "_", head[1]).strip("_") for head in heads if head]
    units = [head[2] or "1" for head in heads if head]
    if not any(map(_is_number, lines[1])):
        units = [unit.strip() or "1" for unit in lines.pop(1)]
    for k, (name, unit) in enumerate(zip(names, units, strict=False)):
        _check_name(name, f"column {lines[0][k]!r}", time=not k)
        if name in names[:k]:
            raise UsageError(f"column {lines[0][k]!r}: expected another name for each column.")
        try:
            measure(unit)
        except UsageError as error:
            raise UsageError(f"column {lines[0][k]!r}: {error}") from None
    rows: list[list[float]] = []
    for k, line in enumerate(lines[1:], 1):
        if len(line) != len(names) or not all(map(_is_number, line)):
            raise UsageError(f"row {k}: expected {len(names)} finite numbers, got {separator.join(line)!r}.")
        rows.append([float(cell) for cell in line])
    table = np.array(rows)
    if (np.diff(table[:, 0]) <= 0.0).any():
        raise UsageError(f"column {names[0]}: expected numbers that increase from row to row.")
    return DataTable(names, units, table)


def _check_name(name: str, what: str, *, time: bool) -> None:
    """Raise for a name that no variable of a unit can have; `time` may be t."""
    if not name.isidentifier() or keyword.iskeyword(name):
        raise UsageError(f"{what}: expected a name of letters, digits and _, none of Python's own, got {name!r}.")
    if hasattr(Unit, name) or (name in ("t", "n") and not (time and name == "t")) or name.startswith("_"):
        raise UsageError(f"{what}: {name} is a name that units have for something else. Rename it.")


def _is_number(cell: str) -> bool:
    try:
        return bool(np.isfinite(float(cell)))
    except ValueError:
        return False
