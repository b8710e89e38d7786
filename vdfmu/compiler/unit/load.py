"""Loads units from users' files."""

from __future__ import annotations

import ast
import os
import sys
import traceback
from collections.abc import Iterator
from hashlib import sha256
from importlib.util import module_from_spec, spec_from_file_location
from pathlib import Path
from types import ModuleType

from vdfmu.base.cache import cached_per_command
from vdfmu.base.errors import UnitError, UsageError
from vdfmu.base.files import read_regular
from vdfmu.base.text import kind_text
from vdfmu.base.trust import before_code, is_reading_only
from vdfmu.compiler.unit.base import unit_name
from vdfmu.compiler.unit.place import declarations
from vdfmu.compiler.unit.unit import Unit

LARGEST_SOURCE = 2**24
"""Largest file of code that is read [byte]."""


@cached_per_command
def load_units(file: Path) -> dict[str, type[Unit]]:
    """Run a Python file and return the units that it declares, by name, without classes such as ``_Common``.

    UsageError if the file does not exist. UnitError if it fails, declares no unit, or uses a name twice.
    CodeNotRunError within `vdfmu.base.trust.reading_only`, if its text is correct.
    """
    if not file.is_file():
        raise UsageError(f"{file}: there is no such file.")
    path = file.resolve()
    if is_reading_only():
        try:
            compile(read_regular(path, LARGEST_SOURCE), str(file), "exec", ast.PyCF_ONLY_AST)
        except SyntaxError as error:
            raise UnitError(f"{file}, line {error.lineno}: {error.msg}.") from None
        except (OSError, ValueError, RecursionError, MemoryError) as error:
            reason = getattr(error, "strerror", None) or error or type(error).__name__
            raise UnitError(f"{file}: cannot be read as Python: {reason}.") from None
    before_code(file)
    name = f"_vdfmu_unit_{sha256(str(path).encode()).hexdigest()[:12]}_{path.stem}"
    module = _run(file, path, name)
    classes = {
        unit: None
        for unit in vars(module).values()
        if isinstance(unit, type) and issubclass(unit, Unit) and unit.__module__ == name and unit.__name__[0] != "_"
    }
    units = {unit_name(unit): unit for unit in classes}
    if not units:
        raise UnitError(f"{file} declares no unit. Derive a class from vdfmu.unit.Unit.")
    if double := [unit.__name__ for unit in classes if units[unit_name(unit)] is not unit]:
        raise UnitError(f'{file}: {double[0]} must be the name of one unit, got two. Name them, name="MyUnit".')
    if twice := [problem for unit in units.values() for problem in _twice(path, unit)]:
        raise UnitError("\n".join(twice))
    return units


def _run(file: Path, path: Path, name: str) -> ModuleType:
    """Run a file as a module of this name; `file` is its path in messages."""
    spec = spec_from_file_location(name, path)
    assert spec is not None and spec.loader is not None
    module = module_from_spec(spec)
    folder = str(path.parent)
    before, ran = set(sys.modules), False
    sys.modules[name] = module
    sys.path.insert(0, folder)
    # Python would use bytecode of a source of the same second and size
    writes_none, sys.dont_write_bytecode = sys.dont_write_bytecode, True
    try:
        spec.loader.exec_module(module)
        ran = True
    except SyntaxError as error:
        raise UnitError(f"{error.filename or file}, line {error.lineno}: {error.msg}.") from None
    except (Exception, SystemExit) as error:
        lines = [f.lineno for f in traceback.extract_tb(error.__traceback__) if f.filename == str(path)]
        where = f"{file}, line {lines[-1]}" if lines else str(file)
        reason = str(error) if isinstance(error, UnitError) else kind_text(error)
        raise UnitError(f"{where}: {reason.rstrip('.: ')}.") from None
    finally:
        sys.dont_write_bytecode = writes_none
        if folder in sys.path:
            sys.path.remove(folder)
        # forget modules in the file's folder: another unit may have modules of the same names, or these may be edited
        for other in set(sys.modules) - before - ({name} if ran else set[str]()):
            if str(getattr(sys.modules[other], "__file__", None) or "").startswith(folder + os.sep):
                del sys.modules[other]
    return module


def _twice(path: Path, unit: type[Unit]) -> Iterator[str]:
    """Yield an error for each class or member declared twice, because the second would silently replace the first."""
    places: dict[str, list[int]] = {}
    for line, name in declarations(path.read_text(encoding="utf-8"), unit.__name__):
        places.setdefault(name, []).append(line)
    if len(of_class := places.get("", [])) > 1:
        places = {"": of_class}  # then members of both classes are duplicates as well
    for name, lines in places.items():
        if len(lines) > 1 and (not name or name in unit.declared or callable(getattr(unit, name, None))):
            head = f"{unit.__name__}: {name}" if name else f"class {unit.__name__}"
            yield f"{path}, line {lines[1]}: {head} is declared twice, first in line {lines[0]}. Rename one of them."
