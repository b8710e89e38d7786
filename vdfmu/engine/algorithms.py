"""The master algorithms, one row each. A new algorithm needs a file with its stepper and a row here."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from importlib import import_module
from typing import Any

from vdfmu.base.errors import UsageError
from vdfmu.base.plugins import Plugins, PluginTable


@dataclass(frozen=True)
class Algorithm:
    """How signals pass between components from one communication point to the next.

    A row with neither `continuous` nor `substeps` does not declare when inputs change. Its runs are not judged for
    stability.
    """

    stepper: str
    """``module:function`` that makes a `vdfmu.engine.masters.sampled.Stepper` from a `Coupling`."""
    continuous: bool = False
    """Whether coupled signals are continuous between the communication points."""
    ordered: bool = False
    """Whether an output with feedthrough reaches its readers within the step."""
    repeats: bool = False
    """Whether steps are repeated from saved states if components depend on each other."""
    substeps: int = 0
    """Number of equal steps in a communication step if inputs are held over each of them, else 0."""
    declared_order: int = 0
    """Order of the coupling error in the step, for an algorithm that neither holds inputs nor is continuous; 0 if
    unknown."""

    def __post_init__(self) -> None:
        if self.substeps < 0 or (self.continuous and self.substeps):
            raise UsageError(
                f"{self.stepper}: substeps must be 0 or more, and 0 if it is continuous, got {self.substeps}."
            )

    @property
    def reference(self) -> str:
        """The reference in `vdfmu.system.reference` with the same schedule, which a run must match, in `substeps`."""
        return ("sampled" if self.ordered else "sampled-delayed") if self.substeps else ""

    @property
    def order(self) -> int:
        """Order of the coupling error in the step: declared, else 1 if inputs hold, 2 if continuous, 0 if unknown."""
        return self.declared_order or (1 if self.substeps else 2 if self.continuous else 0)

    def load(self) -> Callable[..., Any]:
        """Return the function that makes the stepper."""
        module, _, name = self.stepper.partition(":")
        return getattr(import_module(module), name)


_STEPPERS = "vdfmu.engine.masters.components"
_SHIPPED = {
    "gauss-seidel": Algorithm(f"{_STEPPERS}:held", ordered=True, substeps=1),
    "jacobi": Algorithm(f"{_STEPPERS}:held", substeps=1),
    "extrapolated": Algorithm(f"{_STEPPERS}:extrapolated", continuous=True),
    "iterative": Algorithm(f"{_STEPPERS}:iterative", continuous=True, repeats=True),
}
DEFAULT, DELAYED, *_ = _SHIPPED
"""The default algorithm, and one that suits any system because no component waits for another."""
PLUGINS = Plugins("algorithms", "master algorithm", "an Algorithm", lambda plugin: isinstance(plugin, Algorithm))
ALGORITHMS = PluginTable(PLUGINS, _SHIPPED)


def named(**facts: Any) -> list[str]:
    """Return the names of all algorithms whose rows have these `facts`."""
    return [name for name, row in ALGORITHMS.items() if all(getattr(row, key) == value for key, value in facts.items())]


def choice(**facts: Any) -> str:
    """Return the names of all algorithms whose rows have these `facts`, as text."""
    *names, last = named(**facts)
    return f"{', '.join(names)} or {last}" if names else last
