"""Extras: the folders of ``vdfmu/extras``, which add to the core. The core works without any of them.

An extra puts its additions into modules of agreed names: ``commands`` for the command line, ``targets`` of builds,
``motions``, ``trials`` of FMUs, ``units``, the ``decomposition`` of arms, ``containers`` of systems, ``schemas`` of
files, ``reach`` for first motions, ``picture`` and ``motion_picture`` for figures, the ``robot_page``, the
``comparison``, the ``gallery`` and the tables in ``latex`` of runs, ``result_formats``, ``programs``, ``workers`` and
``sensitivities`` of studies. The core finds them by their files, as it finds plugins of other packages, and imports
none by its name.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from functools import cache
from importlib import import_module
from types import ModuleType
from typing import Any

from vdfmu.base.errors import UsageError
from vdfmu.base.files import PACKAGE


@cache
def extra_modules(part: str) -> list[ModuleType]:
    """Return the modules or packages of this name in all extras, sorted by the extras' names."""
    places = {file.parent.name for file in (PACKAGE / "extras").glob(f"*/{part}.py")}
    places |= {file.parent.parent.name for file in (PACKAGE / "extras").glob(f"*/{part}/__init__.py")}
    return [import_module(f"{PACKAGE.name}.extras.{name}.{part}") for name in sorted(places)]


def module_of_extra(part: str, extra: str, option: str) -> ModuleType:
    """Return an extra's module of this name. UsageError that names the `option` if the extra is missing."""
    modules = extra_modules(part)
    if not modules:
        raise UsageError(f"{option} needs the extra {extra}, and this installation does not have it.")
    return modules[0]


def lazy(package: str, names: Mapping[str, Sequence[str]]) -> Callable[[str], Any]:
    """Return a package's ``__getattr__``, which imports its public names, given by module, when they are first used."""
    places = {name: module for module, members in names.items() for name in members}

    def attribute(name: str) -> Any:
        if name not in places:
            raise AttributeError(f"module {package!r} has no attribute {name!r}")
        return getattr(import_module(f"{package}.{places[name]}"), name)

    return attribute
