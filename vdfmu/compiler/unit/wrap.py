"""The file of a unit of what is there already: three lines that call a factory."""

from __future__ import annotations

import re
import runpy
import sys
from pathlib import Path
from pprint import pformat
from typing import Any

import casadi as ca
import numpy as np

from vdfmu.base.errors import UnitError, UsageError
from vdfmu.base.files import temporary_folder
from vdfmu.base.text import kind_text
from vdfmu.base.unpack import UnpackBudget, mat_variables
from vdfmu.compiler.unit.factories import casadi_unit, linear_unit, table_unit
from vdfmu.compiler.unit.new import class_and_file, write_new

_KINDS = "model.mat or model.npz with A, B, C, D, function.casadi, table.csv, or design.py:NAME for an object"


def unit_from(source: str, name: str | None = None, out: Path | None = None, *, trust: bool = False) -> list[Path]:
    """Write the file of a unit of `source` and the data that it loads; return the files, the unit's first.

    `source` is a ``.mat`` or ``.npz`` file with A, B, C, D, and ``dt`` or ``Ts`` [s] of a discrete system; a ``.csv``
    file; a ``.casadi`` file, with `trust`; or an object of a Python file, ``design.py:NAME``. The file and the class
    get their names from `name` and `out`, else from the source.

    Raises
    ------
    UsageError
        For a source that cannot be read or become a unit, and for files that exist.
    UnitError
        For a Python file that fails, or a name or unit of measurement that a unit cannot have.
    StorageError
        If a file cannot be written.
    """
    file, attribute = source.rsplit(":", 1) if re.search(r"\.py:\w+$", source) else (source, "")
    path = Path(file)
    if not path.is_file():
        raise UsageError(f"{path}: there is no such file.")
    camel, target = class_and_file(name or re.sub("[^a-z0-9]+", "_", (attribute or path.stem).lower()).strip("_"), out)
    try:
        factory, arguments, beside = _call(path, _object(path, attribute) if attribute else None, target, camel, trust)
    except (UsageError, UnitError) as error:
        raise type(error)(f"{source}: {str(error).removeprefix(f'{path}: ')}") from None
    except Exception as error:  # readers of broken files raise of many kinds
        said = (str(error).splitlines() or [""])[0].rstrip(".")
        raise UsageError(f"{source}: cannot be read: {type(error).__name__}{said and f': {said}'}.") from None
    head = f'"""Written by vdfmu unit from. To build its FMU: vdfmu build {target.name}"""'
    lines = [*([] if beside is None else ["from pathlib import Path"]), f"from vdfmu.unit import {factory}"]
    arguments.append(f'name="{camel}"')
    inside = ", ".join(arguments) if beside is not None else "\n    " + ",\n    ".join(arguments) + ",\n"
    text = "\n\n".join([head, *lines, f"{camel} = {factory}({inside})\n"])
    files = {target: text.encode()} | (beside or {})
    write_new(files)
    return list(files)


def _call(
    path: Path, found: Any, target: Path, camel: str, trust: bool
) -> tuple[str, list[str], dict[Path, bytes] | None]:
    """Make a unit; return its factory with arguments, and the new files that these load, None without a file."""
    if isinstance(found, ca.Function):
        casadi_unit(found, name=camel)
        with temporary_folder("vdfmu_") as folder:
            path = Path(folder) / f"{target.stem}.casadi"
            found.save(str(path))
            content = path.read_bytes()
    elif found is None and path.suffix in (".csv", ".casadi"):
        _ = table_unit(path, name=camel) if path.suffix == ".csv" else casadi_unit(path, trust=trust, name=camel)
        content = path.read_bytes()
    else:
        system = _system(path, found)
        linear_unit(**system, name=camel)
        return "linear_unit", [f"{key}={pformat(value, width=110)}" for key, value in system.items() if value], None
    beside = target.with_name(path.name)
    files = {} if beside.resolve() == path.resolve() else {beside: content}
    place = f"Path(__file__).with_name({beside.name!r})"
    return ("table_unit", [place], files) if path.suffix == ".csv" else ("casadi_unit", [place, "trust=True"], files)


def _object(path: Path, name: str) -> Any:
    """Return an object of a Python file. The file is run."""
    sys.path.insert(0, str(path.parent.resolve()))
    try:
        found: Any = runpy.run_path(str(path)).get(name)
    except (Exception, SystemExit) as error:
        raise UnitError(f"{path}: {kind_text(error).rstrip('.')}.") from None
    finally:
        sys.path.pop(0)
    if not hasattr(found, "A") and hasattr(found, "to_ss"):  # of scipy
        found = found.to_ss()
    if isinstance(found, ca.Function) or all(hasattr(found, key) for key in "ABCD"):
        return found
    raise UsageError(
        f"An object must be a CasADi function, or a system with A, B, C and D, got {type(found).__name__}. A transfer "
        "function of python-control becomes one by control.ss."
    )


def _system(path: Path, found: Any) -> dict[str, Any]:
    """Return the arguments of `linear_unit` of an object, or of a file."""
    labels: dict[str, Any] = {}
    if found is not None:
        variables = {key: getattr(found, key) for key in ("A", "B", "C", "D", "dt") if hasattr(found, key)}
        # of python-control
        labels = {f"{key}s": list(getattr(found, f"{key}_labels", ())) for key in ("input", "output", "state")}
    elif path.suffix == ".npz":
        with np.load(path) as archive:
            UnpackBudget(path).spend(sum(info.file_size for info in archive.zip.infolist()))
            variables = dict(archive)
    elif path.suffix == ".mat":
        variables = mat_variables(path)
    else:
        raise UsageError(f"A source must be {_KINDS}.")
    if missing := [key for key in "ABCD" if key not in variables]:
        raise UsageError(f"A linear system must have A, B, C and D, got no {missing[0]}.")
    step = variables.get("dt", variables.get("Ts"))
    step = step if step is None or step is True or not np.size(step) else float(np.ravel(step)[0])
    return {key: np.asarray(variables[key]).tolist() for key in "ABCD"} | {"dt": step} | labels
