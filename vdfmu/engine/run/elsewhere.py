"""Components that run in other processes: what `Simulator` asks of them, and of a federation."""

from __future__ import annotations

import math
import os
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any, Protocol, Self

from vdfmu.base.errors import CosimError, UsageError
from vdfmu.engine.fmu.messages import MessageBox
from vdfmu.engine.masters.exchange import Exchange
from vdfmu.engine.masters.sampled import Stepper
from vdfmu.engine.plan.checked import Checked


class Limits:
    """Limits of components: `time` [s] for a step, and for loading and so on each, and `memory` [MB].

    Default: 300 s, and half of the machine's memory.
    """

    def __init__(self, time: float | None = None, memory: float | None = None) -> None:
        self.time = 300.0 if time is None else time
        self.memory = _half_of_memory() if memory is None else memory
        for name, value, unit in (("wait_limit", self.time, "s"), ("memory_limit", self.memory, "MB")):
            if not value > 0.0:
                raise UsageError(f"{name} must be positive, got {value:g} {unit}")


def _half_of_memory() -> float:
    """Return half of the machine's memory [MB]; infinite where it is unknown."""
    try:
        return os.sysconf("SC_PHYS_PAGES") * os.sysconf("SC_PAGE_SIZE") / 2**21
    except (AttributeError, ValueError, OSError):
        return math.inf


class Elsewhere(Stepper):
    """Components of a run and their stepper in one; `exchange` reads the values that they have there."""

    exchange: Exchange

    def load(self) -> None:
        """Load the libraries and create the instances."""
        raise NotImplementedError

    def initialize(self, *arguments: Any) -> None:
        """See `vdfmu.engine.masters.components.Components.initialize`."""
        raise NotImplementedError

    def couple(self, *arguments: Any) -> Self:
        """Prepare the steps, see `Components.couple`."""
        raise NotImplementedError

    def close(self) -> CosimError | None:
        """Terminate and free all; return the first failure."""
        raise NotImplementedError


Making = Callable[[Checked, Mapping[str, Path], MessageBox, Path, Limits], Elsewhere]
"""Makes them from a checked system, the folders of its FMUs, the box for messages, a temporary folder and limits."""


class Division(Protocol):
    """Chooses the algorithm, given the wanted one, the components that run here, and what makes them.

    It is what `simulate`, `run_system` and `Simulator` take as `federation`: all that they know of running elsewhere.
    """

    def algorithm(self, wanted: str | None) -> str: ...  # noqa: D102
    def apart(self, checked: Checked) -> tuple[Checked, Making]: ...  # noqa: D102
