"""The master algorithms, one row each: a new one is a file with what steps the components, and its row here."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from importlib import import_module
from typing import Any

from vdfmu.base.plugins import Plugins, PluginTable


@dataclass(frozen=True)
class Algorithm:
    """How signals pass between components from one communication point to the next."""

    stepper: str
    """``module:function``, which makes a `vdfmu.engine.masters.sampled.Stepper` from a `Coupling` beside it."""
    continuous: bool = False
    """Whether coupled signals are continuous, between the communication points too; else inputs hold over a step."""
    ordered: bool = False
    """Whether an output that depends on inputs directly reaches its readers within the step."""
    repeats: bool = False
    """Whether steps are repeated, from saved states, where components depend on each other."""
    reference: str = ""
    """The reference of `vdfmu.system.reference` with the same schedule. A run must match it."""

    def load(self) -> Callable[..., Any]:
        """Return the function that makes the stepper."""
        module, _, name = self.stepper.partition(":")
        return getattr(import_module(module), name)


_STEPPERS = "vdfmu.engine.masters.steppers"
_SHIPPED = {
    "gauss-seidel": Algorithm(f"{_STEPPERS}:held", ordered=True, reference="sampled"),
    "jacobi": Algorithm(f"{_STEPPERS}:held", reference="sampled-delayed"),
    "extrapolated": Algorithm(f"{_STEPPERS}:extrapolated", continuous=True),
    "iterative": Algorithm(f"{_STEPPERS}:iterative", continuous=True, repeats=True),
}
PLUGINS = Plugins("algorithms", "master algorithm", "an Algorithm", lambda found: isinstance(found, Algorithm))
ALGORITHMS = PluginTable(PLUGINS, _SHIPPED)


def is_continuous(name: str | None) -> bool:
    """Whether an algorithm is known and takes coupled signals as continuous."""
    return name is not None and name in ALGORITHMS and ALGORITHMS[name].continuous


def choice(*, continuous: bool | None = None) -> str:
    """Return the names of all algorithms, or of the algorithms that are `continuous` or not, in words."""
    *names, last = (n for n, a in ALGORITHMS.items() if continuous is None or a.continuous == continuous)
    return f"{', '.join(names)} or {last}" if names else last
