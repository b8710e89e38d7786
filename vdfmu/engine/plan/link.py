"""A connection between two variables of FMUs."""

from __future__ import annotations

from dataclasses import dataclass

from vdfmu.engine.fmu.variables import FmuVariable
from vdfmu.engine.plan.conversion import Conversion

Port = tuple[str, str]
"""Component and variable."""
SOURCE = "(inputs)"
"""Takes the place of a component for signals from outside."""


@dataclass(frozen=True)
class Link:
    """A checked connection between two variables. `stepped` is False for links from parameters."""

    start: Port
    end: Port
    source: FmuVariable
    sink: FmuVariable
    conversion: Conversion
    stepped: bool

    @property
    def discrete(self) -> bool:
        """Whether the value changes at communication points only."""
        return self.sink.type != "Real" or "discrete" in (self.source.variability, self.sink.variability)

    def __str__(self) -> str:
        return f"{'.'.join(self.start)} -> {'.'.join(self.end)}"
