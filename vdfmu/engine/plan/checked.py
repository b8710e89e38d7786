"""A system that can be run."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

from vdfmu.engine.fmu.description import Description
from vdfmu.engine.fmu.variables import FmuVariable
from vdfmu.engine.package.system import System, Value
from vdfmu.engine.plan.conversion import SOURCE, Link, Port
from vdfmu.engine.plan.feed import Feed
from vdfmu.engine.plan.schedule import Schedule


@dataclass(frozen=True)
class Checked:
    """A system that can be run."""

    system: System
    descriptions: Mapping[str, Description]
    """Each component by its name, in the order of the SSD."""
    links: tuple[Link, ...]
    """Including links from the signals of `feed`."""
    algorithm: str
    """The master algorithm that `schedule` is for."""
    schedule: Schedule
    starts: Mapping[str, Sequence[tuple[FmuVariable, Value]]]
    """Values to set in each component before initialization, in the units of the FMU."""
    notes: tuple[str, ...]
    """Notes, not errors: inputs that nothing feeds, for example."""
    feed: Feed | None = None
    """Signals from outside."""
    clock_links: tuple[tuple[Port, Port], ...] = ()
    """Connections of clocks."""
    multiples: Mapping[str, int] = field(default_factory=dict)
    """Communication steps that a component's own step takes; empty where all step together."""

    @property
    def sources(self) -> Mapping[str, Description]:
        """Everything that has outputs: the components, and after them the signals from outside."""
        return {**self.descriptions, **({SOURCE: self.feed.description} if self.feed else {})}
