"""New files of units: a first unit with its test, the examples, and units of models, functions and tables."""

from __future__ import annotations

import keyword
import re
import runpy
import sys
from collections.abc import Mapping
from contextlib import ExitStack
from pathlib import Path
from pprint import pformat
from typing import Any

import casadi as ca
import numpy as np

from vdfmu.base.errors import StorageError, UnitError, UsageError
from vdfmu.base.files import data_path, replacing, source_bytes, temporary_folder
from vdfmu.base.foreign import TITLES, read_foreign
from vdfmu.base.interrupt import InterruptGuard
from vdfmu.base.text import kind_text
from vdfmu.base.trust import before_code
from vdfmu.compiler import unit
from vdfmu.compiler.unit.base import snake_case
from vdfmu.compiler.unit.factories import casadi_unit, linear_unit, table_unit

_FORMS = re.compile(r"[A-Z][A-Za-z0-9]*|[a-z][a-z0-9]*(_[a-z0-9]+)*")
_KINDS = "model.mat or model.npz with A, B, C, D, function.casadi, table.csv, or design.py:NAME for an object"


def new_unit(name: str, out: Path | None = None) -> tuple[Path, Path]:
    """Write the file of a new unit that builds, and its test that passes; return both.

    Parameters
    ----------
    name : str
        ``MyFilter`` or ``my_filter``.
    out : path, optional
        File to write; default ``my_filter.py``. The test is ``test_my_filter.py`` in its folder.

    UsageError for a name that a class or a file cannot have, and for files that exist. StorageError if a file cannot be
    written.
    """
    camel, path = _class_and_file(name, out)
    test = path.with_name(f"test_{path.stem}.py")
    folder = data_path("examples") / "new_unit"
    texts = {path: source_bytes(folder / "unit.py"), test: source_bytes(folder / "test_unit.py")}
    names = ((b"NAME", camel.encode()), (b"FILE", path.stem.encode()))
    _write_new({file: text.replace(*names[0]).replace(*names[1]) for file, text in texts.items()})
    return path, test


def copy_examples(folder: Path) -> list[Path]:
    """Copy the example units, with their system and scenario, to a folder, and return the files.

    UsageError for files that exist. StorageError if a file cannot be written.
    """
    shipped = sorted(file for file in (data_path("examples") / "units").iterdir() if file.is_file())
    files = {folder / file.name: file.read_bytes() for file in shipped}
    _write_new(files)
    return list(files)


def unit_from(source: str, name: str | None = None, out: Path | None = None, *, trust: bool = False) -> list[Path]:
    """Write the file of a unit of `source` and the data that it loads; return the files, the unit's first.

    `source` is a ``.mat`` or ``.npz`` file with A, B, C, D, and ``dt`` or ``Ts`` [s] of a discrete system; a ``.csv``
    file; a ``.casadi`` file, with `trust`; or an object of a Python file, ``design.py:NAME``. The file and the class
    get their names from `name` and `out`, else from the source.

    UsageError for a source that cannot be read or become a unit, and for files that exist. UnitError for a Python file
    that fails, or a name or unit of measurement that a unit cannot have. StorageError if a file cannot be written.
    """
    file, attribute = source.rsplit(":", 1) if re.search(r"\.py:\w+$", source) else (source, "")
    path = Path(file)
    if not path.is_file():
        raise UsageError(f"{path}: there is no such file.")
    stem = re.sub("[^a-z0-9]+", "_", (attribute or path.stem).lower()).strip("_")
    camel, target = _class_and_file(name or stem, out)
    try:
        factory, arguments, beside = _call(path, _object(path, attribute) if attribute else None, target, camel, trust)
    except (UsageError, UnitError) as error:
        raise type(error)(f"{source}: {str(error).removeprefix(f'{path}: ')}") from None
    except Exception as error:  # readers of broken files raise of many kinds
        reason = (str(error).splitlines() or [""])[0].rstrip(".")
        raise UsageError(f"{source}: cannot be read: {type(error).__name__}{reason and f': {reason}'}.") from None
    head = f'"""Written by vdfmu unit from. To build its FMU: vdfmu build {target.name}"""'
    lines = [*([] if beside is None else ["from pathlib import Path"]), f"from vdfmu.unit import {factory}"]
    arguments.append(f'name="{camel}"')
    inside = ", ".join(arguments) if beside is not None else "\n    " + ",\n    ".join(arguments) + ",\n"
    text = "\n\n".join([head, *lines, f"{camel} = {factory}({inside})\n"])
    files = {target: text.encode()} | (beside or {})
    _write_new(files)
    return list(files)


def _class_and_file(name: str, out: Path | None) -> tuple[str, Path]:
    """Return the name of a unit's class and its file; UsageError if they cannot have it."""
    if not _FORMS.fullmatch(name):
        raise UsageError(
            f"name: expected CamelCase or snake_case of letters and digits, MyFilter or my_filter, got {name!r}."
        )
    camel = name if name[0].isupper() else "".join(part[:1].upper() + part[1:] for part in name.split("_"))
    path = out if out is not None else Path(f"{snake_case(name)}.py")
    stem = path.stem
    if path.suffix != ".py" or not stem.isidentifier():
        raise UsageError(f"{path}: expected a Python file that can be imported, such as my_filter.py.")
    if camel in unit.__all__:
        raise UsageError(f"name: {camel} is a name that units need of vdfmu.unit. Choose another.")
    if keyword.iskeyword(stem) or keyword.iskeyword(camel) or stem in {*sys.stdlib_module_names, "vdfmu"}:
        raise UsageError(f"{path}: {stem} is a name of Python's own, or of vdfmu. Choose another.")
    return camel, path


def _write_new(files: Mapping[Path, bytes]) -> None:
    """Write new files into a folder; make it if necessary."""
    if there := [str(file) for file in files if file.exists()]:
        verb = "is" if len(there) == 1 else "are"
        raise UsageError(f"{' and '.join(there)} {verb} there already, and not replaced. Choose another name.")
    first = next(iter(files))
    try:
        first.parent.mkdir(parents=True, exist_ok=True)
        with InterruptGuard(), ExitStack() as stack:
            for file, content in files.items():
                stack.enter_context(replacing(file)).write(content)
    except OSError as error:
        for file in files:
            file.unlink(missing_ok=True)
        raise StorageError(f"{first}: cannot be written: {error.strerror}. Choose another folder.") from error


def _call(
    path: Path, source: Any, target: Path, camel: str, trust: bool
) -> tuple[str, list[str], dict[Path, bytes] | None]:
    """Make a unit; return its factory with arguments, and the new files that these load, None without a file."""
    if isinstance(source, ca.Function):
        casadi_unit(source, name=camel)
        with temporary_folder("vdfmu_") as folder:
            path = Path(folder) / f"{target.stem}.casadi"
            source.save(str(path))
            content = path.read_bytes()
    elif source is None and path.suffix in (".csv", ".casadi"):
        _ = table_unit(path, name=camel) if path.suffix == ".csv" else casadi_unit(path, trust=trust, name=camel)
        content = path.read_bytes()
    else:
        system = _system(path, source)
        linear_unit(**system, name=camel)
        return "linear_unit", [f"{key}={pformat(value, width=110)}" for key, value in system.items() if value], None
    beside = target.with_name(path.name)
    files = {} if beside.resolve() == path.resolve() else {beside: content}
    place = f"Path(__file__).with_name({beside.name!r})"
    return ("table_unit", [place], files) if path.suffix == ".csv" else ("casadi_unit", [place, "trust=True"], files)


def _object(path: Path, name: str) -> Any:
    """Return an object of a Python file. The file is run."""
    before_code(path)
    sys.path.insert(0, str(path.parent.resolve()))
    try:
        source: Any = runpy.run_path(str(path)).get(name)
    except (Exception, SystemExit) as error:
        raise UnitError(f"{path}: {kind_text(error).rstrip('.')}.") from None
    finally:
        sys.path.pop(0)
    if not hasattr(source, "A") and hasattr(source, "to_ss"):  # of scipy
        source = source.to_ss()
    if isinstance(source, ca.Function) or all(hasattr(source, key) for key in "ABCD"):
        return source
    raise UsageError(
        f"An object must be a CasADi function, or a system with A, B, C and D, got {type(source).__name__}. A transfer "
        "function of python-control becomes one by control.ss."
    )


def _system(path: Path, source: Any) -> dict[str, Any]:
    """Return the arguments of `linear_unit` of an object, or of a file."""
    labels: dict[str, Any] = {}
    there = ""
    if source is not None:
        variables = {key: getattr(source, key) for key in ("A", "B", "C", "D", "dt") if hasattr(source, key)}
        # of python-control
        labels = {f"{key}s": list(getattr(source, f"{key}_labels", ())) for key in ("input", "output", "state")}
    elif path.suffix in TITLES:
        content = read_foreign(path)
        variables, there = content.arrays, f"; {content.listed()}"
    else:
        raise UsageError(f"A source must be {_KINDS}.")
    if missing := [key for key in "ABCD" if key not in variables]:
        raise UsageError(f"A linear system must have A, B, C and D, got no {missing[0]}{there}.")
    step = variables.get("dt", variables.get("Ts"))
    step = step if step is None or step is True or not np.size(step) else float(np.ravel(step)[0])
    return {key: np.asarray(variables[key]).tolist() for key in "ABCD"} | {"dt": step} | labels
