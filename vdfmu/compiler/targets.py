"""What a unit is built for in addition to its FMU. A new target is a folder of the compiler and a row of `TARGETS`."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from vdfmu.compiler.efmi.block import reason_against
from vdfmu.compiler.efmi.build import make_efmu
from vdfmu.compiler.fmu.content import Content
from vdfmu.compiler.unit.base import BaseUnit


@dataclass(frozen=True)
class BuildTarget:
    """A target."""

    reason_against: Callable[[type[BaseUnit]], str | None]
    """Returns why a unit cannot be built for it; None if it can."""
    finish: Callable[[Path, Content, str, float], None]
    """Makes of an FMU what the target is: file, content, precision of numbers, time between steps [s]."""


FMI = "fmi"
"""The target of all units: an FMU alone."""
TARGETS = {FMI: None, "efmi": BuildTarget(reason_against, make_efmu)}
"""Name to target."""
