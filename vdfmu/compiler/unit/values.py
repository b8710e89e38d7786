"""The values that the methods of a unit read and set."""

from __future__ import annotations

from typing import Any

from vdfmu.base.errors import UnitError
from vdfmu.compiler.unit.declaration import Declared


class Values:
    """The values of an instance; subclasses take others, and record what a method reads and sets.

    Attributes
    ----------
    unit : Unit
    sets : dict of str to value
        Values by variable.
    now : float [s]
        Time.
    """

    def __init__(self, unit: Any) -> None:
        self.unit, self.now = unit, 0.0
        self.sets: dict[str, Any] = {}

    def read(self, declared: Declared) -> Any:
        """Return the value of a variable."""
        if declared.name not in self.sets:
            raise UnitError(f"{type(self.unit).__name__}.{declared.name} is read before it is set.")
        return self.sets[declared.name]

    def write(self, declared: Declared, value: Any) -> None:
        """Set a variable."""
        self.sets[declared.name] = self.unit.fitting(declared, value)

    def keep(self, name: str) -> None:
        """Raise UnitError if an attribute that is not a variable may not be set."""

    def time(self) -> Any:
        """Return the time [s]."""
        return self.now

    def robot(self, fields: tuple[str, ...]) -> Any:
        """Return the robot, for the fields that a unit declares."""
        return self.unit.of_robot
