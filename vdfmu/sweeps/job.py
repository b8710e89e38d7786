"""What a worker of a parameter study does: runs of systems that it has loaded, one a point."""

from __future__ import annotations

from collections import OrderedDict
from collections.abc import Mapping, Sequence
from contextlib import ExitStack
from dataclasses import dataclass
from pathlib import Path
from time import perf_counter
from typing import Any

from vdfmu.engine.cosim import Simulator
from vdfmu.engine.cosim.inputs import Table
from vdfmu.errors import CosimError, VdfmuError
from vdfmu.sweeps.measures import Measure, measured
from vdfmu.text import error_text, matching

Row = dict[str, Any]
"""``point``, ``failed`` (why, or None), ``failed_at`` [s], ``wall_s``, measures and signals, by column."""
_ALIVE = 8
"""Systems that a worker keeps loaded."""


@dataclass(frozen=True)
class Binding:
    """What the value of an axis sets in a system."""

    names: tuple[str, ...]
    """Variables, ``component.variable``."""
    nominal: tuple[float, ...] = ()
    """Their values, where the axis has factors; else empty."""
    words: Mapping[Any, Any] | None = None
    """Value of the axis to value of the variables, for what is no number."""

    def values(self, value: Any) -> dict[str, Any]:
        """Values by ``component.variable``."""
        if self.words is not None:
            return dict.fromkeys(self.names, self.words[value])
        if self.nominal:
            return {name: value * own for name, own in zip(self.names, self.nominal, strict=True)}
        return dict.fromkeys(self.names, value)


@dataclass(frozen=True)
class WiredSystem:
    """A package, how it runs, and what the axes are in it."""

    content: bytes
    options: Mapping[str, Any]
    run: Mapping[str, Any]
    inputs: Sequence[Table]
    input_hold: bool
    bindings: Mapping[str, Binding]


@dataclass(frozen=True)
class Job:
    """All that a worker needs to know; it is sent to each once."""

    systems: tuple[WiredSystem, ...]
    measures: tuple[Measure, ...]
    record: tuple[str, ...]
    """Patterns of the signals that a run records."""
    keep: tuple[str, ...]
    """Of those, the patterns of signals that are kept."""


Task = tuple[int, int, dict[str, Any]]
"""Number of a point, that of its system, and the values of its axes by target."""


class Bench:
    """The systems of a job, loaded when they are first needed and kept for the next point.

    Parameters
    ----------
    job : Job
    folder : Path
        Place for the packages.
    """

    def __init__(self, job: Job, folder: Path) -> None:
        self._job, self._folder = job, folder
        self._alive: OrderedDict[int, tuple[Simulator, ExitStack]] = OrderedDict()

    def run(self, task: Task) -> Row:
        """Run a point; what fails is said in its row."""
        point, number, values = task
        row: Row = {"point": point, "failed": None, "failed_at": None}
        begin = perf_counter()
        try:
            system = self._job.systems[number]
            parameters: dict[str, Any] = {}
            for target, value in values.items():
                parameters |= system.bindings[target].values(value)
            results = self._simulator(number).run(
                parameters=parameters, record=self._job.record, **system.run
            )
            row |= measured(self._job.measures, results)
            if self._job.keep:
                row["time"] = results.time
                row |= {name: results[name] for name in matching(results.names, self._job.keep)}
        except CosimError as error:
            row |= {"failed": error_text(error), "failed_at": error.time}
        except (VdfmuError, ArithmeticError, ValueError, TypeError, LookupError) as error:
            words = error_text(error)
            row["failed"] = words if isinstance(error, VdfmuError) else f"{type(error).__name__}: {words}"
        row["wall_s"] = perf_counter() - begin
        return row

    def _simulator(self, number: int) -> Simulator:
        if number not in self._alive:
            if len(self._alive) == _ALIVE:
                self._alive.popitem(last=False)[1][1].close()
            system = self._job.systems[number]
            path = self._folder / f"{number}.ssp"
            if not path.exists():
                path.write_bytes(system.content)
            with ExitStack() as stack:
                # a worker is a process of its own: its components need none
                simulator = stack.enter_context(
                    Simulator(
                        path, inputs=list(system.inputs), input_hold=system.input_hold, isolate=False,
                        log=lambda message: None, **system.options,
                    )
                )  # fmt: skip
                self._alive[number] = simulator, stack.pop_all()
        self._alive.move_to_end(number)
        return self._alive[number][0]

    def close(self) -> None:
        """Free all systems."""
        while self._alive:
            self._alive.popitem()[1][1].close()
