"""Build targets beside the plain FMU: a folder of the compiler and a row of `TARGETS` for each."""

from __future__ import annotations

from dataclasses import dataclass
from importlib import import_module
from typing import Any


@dataclass(frozen=True)
class BuildTarget:
    """A target, imported only when it is built."""

    module: str
    """Module with ``reason_against(unit)``, the reason why the target excludes a unit or None, and
    ``finish(path, content, precision, step)`` to turn an FMU into the target."""
    precisions: tuple[str, ...]
    """Floating-point types of the code, the default first."""

    def load(self) -> Any:
        """Return the module."""
        return import_module(self.module)


FMI = "fmi"
"""Target of all units: an FMU alone."""
TARGETS = {FMI: None, "efmi": BuildTarget("vdfmu.compiler.efmi.build", ("double", "float32"))}
