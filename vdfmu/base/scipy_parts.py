"""Modules of scipy without the others of their packages, which take 0.1 to 0.3 s to import."""

from __future__ import annotations

import sys
from contextlib import suppress
from importlib import import_module
from pathlib import Path
from types import ModuleType
from typing import Any

import scipy


def scipy_part(name: str) -> Any:
    """Return a module of scipy by its full name; its package, whole, for a scipy that has no such module."""
    package = name.rpartition(".")[0]
    stand_in = ModuleType(package)
    stand_in.__path__ = [str(Path(path, *package.split(".")[1:])) for path in scipy.__path__]
    sys.modules.setdefault(package, stand_in)
    try:
        with suppress(ImportError):
            return import_module(name)
    finally:
        if sys.modules[package] is stand_in:
            del sys.modules[package]
    return import_module(package)
