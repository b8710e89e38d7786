"""Units from files of users."""

from __future__ import annotations

import ast
import os
import sys
import traceback
from collections.abc import Generator, Iterator
from contextlib import contextmanager
from contextvars import ContextVar
from hashlib import sha256
from importlib.util import module_from_spec, spec_from_file_location
from pathlib import Path

from vdfmu.base.cache import cached_per_command
from vdfmu.base.errors import UnitError, UsageError
from vdfmu.base.text import kind_text
from vdfmu.compiler.unit.base import unit_name
from vdfmu.compiler.unit.place import declarations
from vdfmu.compiler.unit.unit import Unit

_runs: ContextVar[bool] = ContextVar("_runs", default=True)


class CodeNotRunError(Exception):
    """A file of units was to be run within `reading_only`."""

    def __init__(self, file: Path) -> None:
        self.file = file
        super().__init__(file)


@contextmanager
def reading_only() -> Generator[None]:
    """Run no file of units: `load_units` raises CodeNotRunError after it has read one."""
    token = _runs.set(False)
    try:
        yield
    finally:
        _runs.reset(token)


def check_may_run(file: Path) -> None:
    """Raise CodeNotRunError within `reading_only`."""
    if not _runs.get():
        raise CodeNotRunError(file)


@cached_per_command
def load_units(file: Path) -> dict[str, type[Unit]]:
    """Return the units that a Python file declares, by name, without classes such as ``_Common``. The file is run.

    Raises
    ------
    UsageError
        If there is no such file.
    UnitError
        If it fails, declares none, or has a name twice.
    CodeNotRunError
        If it can be read, but nothing may be run.
    """
    if not file.is_file():
        raise UsageError(f"{file}: there is no such file.")
    path = file.resolve()
    if not _runs.get():
        try:
            compile(path.read_bytes(), str(file), "exec", ast.PyCF_ONLY_AST)
        except SyntaxError as error:
            raise UnitError(f"{file}, line {error.lineno}: {error.msg}.") from None
        except (ValueError, RecursionError, MemoryError) as error:
            raise UnitError(f"{file}: cannot be read as Python: {error or type(error).__name__}.") from None
        check_may_run(file)
    name = f"_vdfmu_unit_{sha256(str(path).encode()).hexdigest()[:12]}_{path.stem}"
    spec = spec_from_file_location(name, path)
    assert spec is not None and spec.loader is not None
    module = module_from_spec(spec)
    folder = str(path.parent)
    before, ran = set(sys.modules), False
    sys.modules[name] = module
    sys.path.insert(0, folder)
    # Python takes bytecode for that of a source of the same second and size
    writes_none, sys.dont_write_bytecode = sys.dont_write_bytecode, True
    try:
        spec.loader.exec_module(module)
        ran = True
    except SyntaxError as error:
        raise UnitError(f"{error.filename or file}, line {error.lineno}: {error.msg}.") from None
    except (Exception, SystemExit) as error:  # whatever code of others raises
        lines = [f.lineno for f in traceback.extract_tb(error.__traceback__) if f.filename == str(path)]
        where = f"{file}, line {lines[-1]}" if lines else str(file)
        reason = str(error) if isinstance(error, UnitError) else kind_text(error)
        raise UnitError(f"{where}: {reason.rstrip('.: ')}.") from None
    finally:
        sys.dont_write_bytecode = writes_none
        if folder in sys.path:
            sys.path.remove(folder)
        # modules beside the file are its own: another unit may have others of the same names, or these be edited
        for other in set(sys.modules) - before - ({name} if ran else set[str]()):
            if str(getattr(sys.modules[other], "__file__", None) or "").startswith(folder + os.sep):
                del sys.modules[other]
    units = {
        unit: None
        for unit in vars(module).values()
        if isinstance(unit, type) and issubclass(unit, Unit) and unit.__module__ == name and unit.__name__[0] != "_"
    }
    found = {unit_name(unit): unit for unit in units}
    if not found:
        raise UnitError(f"{file} declares no unit: a class that is derived from vdfmu.unit.Unit.")
    double = [unit.__name__ for unit in units if found[unit_name(unit)] is not unit]
    if double:
        raise UnitError(f'{file}: {double[0]} must be the name of one unit, got two. Name them, name="MyUnit".')
    twice = [problem for unit in found.values() for problem in _twice(path, unit)]
    if twice:
        raise UnitError("\n".join(twice))
    return found


def _twice(path: Path, unit: type[Unit]) -> Iterator[str]:
    """Yield what is twice in a file, where the second would silently replace the first."""
    lines: dict[str, list[int]] = {}
    for line, name in declarations(path.read_text(encoding="utf-8"), unit.__name__):
        lines.setdefault(name, []).append(line)
    if len(of_class := lines.get("", [])) > 1:
        lines = {"": of_class}  # what both classes declare is there twice as well
    for name, found in lines.items():
        if len(found) > 1 and (not name or name in unit.declared or callable(getattr(unit, name, None))):
            what = f"{unit.__name__}: {name}" if name else f"class {unit.__name__}"
            yield f"{path}, line {found[1]}: {what} is there twice, first in line {found[0]}. Rename one of them."
