"""Units from files of users."""

from __future__ import annotations

import sys
import traceback
from hashlib import sha256
from importlib.util import module_from_spec, spec_from_file_location
from pathlib import Path

from vdfmu.errors import UnitError, UsageError
from vdfmu.unit.declaration import Derivative, Sampled, State, Unit, unit_name

__all__ = ["load_units"]


def load_units(file: Path) -> dict[str, type[Unit]]:
    """Return the units that a Python file declares, by name. The file is run.

    Raises
    ------
    UsageError
        If there is no such file.
    UnitError
        If it fails, or declares none, or one wrongly.
    """
    if not file.is_file():
        raise UsageError(f"{file}: there is no such file.")
    path = file.resolve()
    name = f"_vdfmu_unit_{sha256(str(path).encode()).hexdigest()[:12]}_{path.stem}"
    spec = spec_from_file_location(name, path)
    assert spec is not None and spec.loader is not None
    module = module_from_spec(spec)
    sys.modules[name] = module
    folder = str(path.parent)
    sys.path.insert(0, folder)
    try:
        spec.loader.exec_module(module)
    except SyntaxError as error:
        raise UnitError(f"{error.filename or file}, line {error.lineno}: {error.msg}.") from None
    except Exception as error:
        lines = [f.lineno for f in traceback.extract_tb(error.__traceback__) if f.filename == str(path)]
        where = f"{file}, line {lines[-1]}" if lines else str(file)
        reason = str(error) if isinstance(error, UnitError) else f"{type(error).__name__}: {error}"
        raise UnitError(f"{where}: {reason.rstrip('.')}.") from None
    finally:
        if folder in sys.path:
            sys.path.remove(folder)
    found = {
        unit_name(unit): unit
        for unit in vars(module).values()
        if isinstance(unit, type) and issubclass(unit, Unit) and unit.__module__ == name
    }
    if not found:
        raise UnitError(f"{file} declares no unit: a class that is derived from vdfmu.unit.Unit.")
    for unit in found.values():
        _check(unit, file)
    return found


def _check(unit: type[Unit], file: Path) -> None:
    """Raise for a declaration that lacks something; with all that is wrong."""
    problems: list[str] = []
    states = {d for d in unit.declared.values() if type(d) is State}
    derived = [d.state for d in unit.declared.values() if isinstance(d, Derivative)]
    for state in states:
        if derived.count(state) != 1:
            problems.append(
                f"{state.name} is a continuous state and needs one derivative: "
                f"{state.name}_dot = Derivative({state.name})"
            )
    problems += [
        f"{state.name} is not a continuous state of the unit and has no derivative"
        for state in derived
        if state not in states
    ]
    if any(isinstance(d, Sampled) for d in unit.declared.values()) and "period" not in unit.declared:
        problems.append('sampled states need a period: period = Parameter("s", start=1e-3, minimum=1e-6)')
    if problems:
        raise UnitError("\n".join(f"{file}: {unit.__name__}: {problem}." for problem in problems))
