"""Clocks of FMI 3.0."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any


@dataclass(frozen=True)
class Clock:
    """A clock of FMI 3.0: how its interval varies, the interval, NaN if it is asked for, and the first tick [s]."""

    variability: str
    interval: float
    shift: float

    @property
    def triggered(self) -> bool:
        """Whether another component ticks it, or it ticks others."""
        return self.variability == "triggered"

    @property
    def asked(self) -> bool:
        """Whether the component states the interval."""
        return self.variability in ("calculated", "tunable", "changing", "countdown")


def read_clock(element: Any) -> Clock:
    """Return the clock that an element of a model description declares."""

    def seconds(decimal: str, counter: str, default: float) -> float:
        if element.get(counter) is not None and element.get("resolution") is not None:
            return int(element.get(counter)) / int(element.get("resolution"))
        return float(element.get(decimal, default))

    return Clock(
        element.get("intervalVariability"),
        seconds("intervalDecimal", "intervalCounter", math.nan),
        seconds("shiftDecimal", "shiftCounter", 0.0),
    )
