"""The units of the package, one file each, written as users write theirs.

The units of the shipped systems are here. `laws` contains the paper's control with adapted parameters, and extras add
units.
"""

from __future__ import annotations

import os
import re
from functools import lru_cache
from importlib import import_module
from pathlib import Path
from pkgutil import walk_packages

from vdfmu.base.errors import UsageError
from vdfmu.base.extras import extra_modules
from vdfmu.base.plugins import Plugins
from vdfmu.compiler.unit import Unit
from vdfmu.compiler.unit.load import load_units

PLUGINS = Plugins(
    "units", "unit", "a class of a unit", lambda plugin: isinstance(plugin, type) and issubclass(plugin, Unit)
)


def shipped_units() -> dict[str, type[Unit]]:
    """Return the units of the shipped systems that need a robot, by name."""
    units = package_units().items()
    return {name: unit for name, unit in units if unit.needs_robot() and unit.__module__ == f"{__name__}.{name}"}


@lru_cache
def _modules() -> dict[str, str]:
    """Return the modules of the units by file name."""
    places = [(__path__, __name__), *((module.__path__, module.__name__) for module in extra_modules("units"))]
    paths = sorted(
        module.name for path, name in places for module in walk_packages(path, f"{name}.") if not module.ispkg
    )
    named = {path.rpartition(".")[2]: path for path in paths}
    return {name: path for name, path in named.items() if not name.startswith("_")}


@lru_cache
def _unit_in(path: str) -> type[Unit]:
    members = vars(import_module(path)).values()
    units = (each for each in members if isinstance(each, type) and issubclass(each, Unit))
    return next(unit for unit in units if unit.__module__ == path)


def package_units() -> dict[str, type[Unit]]:
    """Return the units by file name."""
    return {name: _unit_in(path) for name, path in _modules().items()}


def known_units() -> dict[str, type[Unit]]:
    """Return the units of the package and of plugins, by name."""
    shipped = package_units()
    return shipped | PLUGINS.all(shipped)


def find_unit(name: object) -> type[Unit]:
    """Return a unit by its class, a shipped name (``plant``, ``Plant``), ``my_unit.py``, or ``my_units.py:Name``.

    UsageError for an unknown name or another type; UnitError, with file and line, if the file fails or declares a unit
    wrongly.
    """
    if isinstance(name, type) and issubclass(name, Unit):
        return name
    if not isinstance(name, str | os.PathLike):
        raise UsageError(f"units: expected the name of a unit, a file or a class of Unit, got {name!r}.")
    text = str(os.fspath(name))
    if text in _modules():  # without importing the others
        return _unit_in(_modules()[text])
    shipped = {unit.__name__: unit for unit in package_units().values()}
    if text in shipped:
        return shipped[text]
    of_file = re.fullmatch(r"(.*\.py)(?::(.*))?", text)
    if not of_file:
        added = PLUGINS.get(text)
        if added is not None:
            return added
        names = ", ".join(known_units())
        raise UsageError(f"There is no unit {text!r}. There are: {names}, and files: my_unit.py, or my_units.py:Name.")
    file, wanted = of_file.groups()
    units = load_units(Path(file))
    classes = {unit.__name__: unit for unit in units.values()}
    if wanted:
        if wanted not in classes:
            raise UsageError(f"{file} has no unit {wanted!r}. There are: {', '.join(classes)}.")
        return classes[wanted]
    if len(classes) != 1:
        raise UsageError(f"{file} has several units: {', '.join(classes)}. Name one, {file}:{next(iter(classes))}.")
    return next(iter(classes.values()))
