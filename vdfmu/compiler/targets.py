"""Build targets beside the plain FMU. A new target is a folder of the compiler and a row of `TARGETS`."""

from __future__ import annotations

from dataclasses import dataclass
from importlib import import_module
from typing import Any


@dataclass(frozen=True)
class BuildTarget:
    """A target, imported only when it is built."""

    module: str
    """Module with ``reason_against(unit)``, the reason why a unit cannot be built for it or None, and
    ``finish(path, content, precision, step)``, which turns an FMU into the target."""
    precisions: tuple[str, ...]
    """Floating-point types of its code, the default first."""

    def load(self) -> Any:
        """Return the module."""
        return import_module(self.module)


FMI = "fmi"
"""The target of all units: an FMU alone."""
TARGETS = {FMI: None, "efmi": BuildTarget("vdfmu.compiler.efmi.build", ("double", "float32"))}
"""Name to target."""
