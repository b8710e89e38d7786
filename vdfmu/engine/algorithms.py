"""The master algorithms, one row each: a new one is a file with what steps the components, and its row here."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from importlib import import_module
from typing import Any

from vdfmu.base.errors import UsageError
from vdfmu.base.plugins import Plugins, PluginTable


@dataclass(frozen=True)
class Algorithm:
    """How signals pass between components from one communication point to the next."""

    stepper: str
    """``module:function``, which makes the stepper of a `vdfmu.engine.masters.steppers.Coupling`."""
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


_MOST = 10**9
"""Communication steps of a run: 11 days at 1 kHz."""
_CLOSE = 1e-9
"""Relative error of a stop that is a multiple of the step; the rounded division has 1e-16."""


def count_steps(step: float, stop: float, start: float = 0.0) -> int:
    """Return the number of communication steps of a run; UsageError if its times [s] do not fit together."""
    for name, value in (("step", step), ("stop - start" if start else "stop", stop - start)):
        if not 0.0 < value < math.inf:
            raise UsageError(f"{name}: expected a positive finite time, got {value:g} s.")
    ratio, after = (stop - start) / step, f" after start = {start:g} s" if start else ""
    if ratio > _MOST:
        raise UsageError(
            f"stop: expected at most {_MOST:g} steps of {step:g} s, got {stop:g} s. Give an earlier end or a longer "
            "step."
        )
    n = max(1, round(ratio))
    if abs(ratio - n) > _CLOSE * n:
        raise UsageError(
            f"stop: expected a multiple of step = {step:.12g} s{after}, got {stop:.12g} s. The nearest is "
            f"{start + n * step:.12g} s."
        )
    return n
