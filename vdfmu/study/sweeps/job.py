"""The job of a parameter study's worker: runs of loaded systems, one per point."""

from __future__ import annotations

import pickle
from collections import OrderedDict
from collections.abc import Callable, Mapping, Sequence
from contextlib import ExitStack
from dataclasses import dataclass
from pathlib import Path
from time import perf_counter
from typing import Any

import numpy as np

from vdfmu.base.errors import CosimError, StorageError, UsageError, VdfmuError, disk_error
from vdfmu.base.files import storing
from vdfmu.base.text import error_text, matching
from vdfmu.engine.linear.growth import Poses
from vdfmu.engine.package.archive import package_limit
from vdfmu.engine.package.read import DEFAULT, load_ssp
from vdfmu.engine.package.system import FlatSystem
from vdfmu.engine.plan.inputs import InputTable
from vdfmu.engine.results.results import Results
from vdfmu.engine.rules import run_anyway
from vdfmu.engine.run import Simulator
from vdfmu.study.analysis.loops import TIED
from vdfmu.study.sweeps.measures import Measure, measured

Row = dict[str, Any]
"""``point``, ``failed`` (why, or None), ``failed_at`` [s], ``failed_in`` (the component), ``kind`` of the failure, see
:class:`vdfmu.base.errors.FailureKind`, ``wall_s``, measures and signals, by column; for some points of the batch engine
``to_fmu[rad]`` and so on, the largest difference between a signal of that unit and the FMUs' run.
"""
_ALIVE = 8
"""Number of systems that a worker keeps loaded."""


@dataclass(frozen=True)
class AxisBinding:
    """Variables that an axis' value sets in a system."""

    names: tuple[str, ...]
    """Variables, ``component.variable``."""
    nominal: tuple[float, ...] = ()
    """Their values if the axis has factors, else empty."""
    words: Mapping[Any, Any] | None = None
    """Value of the axis to value of the variables, for non-numeric values."""

    def values(self, value: Any) -> dict[str, Any]:
        """Values by ``component.variable``."""
        if self.words is not None:
            return dict.fromkeys(self.names, self.words[value])
        if self.nominal:
            return {name: value * nominal for name, nominal in zip(self.names, self.nominal, strict=True)}
        return dict.fromkeys(self.names, value)


@dataclass(frozen=True)
class WiredSystem:
    """A package, how it runs, its axes, and the program, if there is one, that runs it in lanes."""

    content: bytes
    options: Mapping[str, Any]
    run: Mapping[str, Any]
    inputs: Sequence[InputTable]
    input_hold: bool
    bindings: Mapping[str, AxisBinding]
    program: Any = None
    """A :class:`vdfmu.extras.batch.engine.BatchProgram`, or None."""
    name: str = "system.ssp"
    """File name of the package, for messages."""
    variant: str = DEFAULT
    """Its SSD."""
    scenario: str = ""
    """Digest of the scenario, including what is not in the package, such as its limits."""

    def read(self, folder: Path) -> FlatSystem:
        """Return the system of the package, which is first written to a separate folder if missing."""
        path = folder / self.name
        if not path.exists():
            with storing(path):
                folder.mkdir(exist_ok=True)
                path.write_bytes(self.content)
        return load_ssp(path, self.variant)

    def parameters(self, values: Mapping[str, Any]) -> dict[str, Any]:
        """Values by ``component.variable`` of the axes' variables."""
        return {
            name: number
            for target, value in values.items()
            for name, number in self.bindings.get(target, AxisBinding((target,))).values(value).items()
        }


@dataclass(frozen=True)
class Job:
    """Everything that a worker needs, sent once to each."""

    systems: tuple[WiredSystem, ...]
    measures: tuple[Measure, ...]
    record: tuple[str, ...]
    """Patterns of the signals that a run records."""
    keep: tuple[str, ...]
    """Patterns of recorded signals that are kept."""
    compared: tuple[int, ...] = ()
    """Points that are also run with the FMUs if a program runs them in lanes."""
    limit: int | None = None
    """See `package_limit`."""
    anyway: bool = False
    """See `run_anyway`."""

    @property
    def together(self) -> list[int]:
        """Number of points of each system that run side by side."""
        return [1 if system.program is None else system.program.lanes for system in self.systems]

    def packed(self) -> bytes:
        """Return the job's pickle, in which functions of a script have their code; UsageError if that is impossible."""
        if all(measure.function is None for measure in self.measures):
            return pickle.dumps(self)
        try:
            import cloudpickle

            return cloudpickle.dumps(self)
        except ImportError:
            raise UsageError(
                "a function needs the package cloudpickle: pip install 'vdfmu[sweep]', or write it as an expression."
            ) from None
        except (TypeError, pickle.PicklingError) as error:
            raise UsageError(f"a function cannot be sent to another process: {error}.") from None


Task = tuple[int, int, dict[str, Any]]
"""Number of a point, number of its system, and the axes' values by target."""


class Bench:
    """The systems of a job, loaded from packages in `folder` when they are first needed, kept for the next point."""

    def __init__(self, job: Job, folder: Path) -> None:
        self._job, self._folder = job, folder
        self._alive: OrderedDict[int, tuple[Simulator, ExitStack]] = OrderedDict()
        self._engines: dict[int, Any] = {}

    def run(self, tasks: Sequence[Task], apart: bool = False) -> list[Row]:
        """Run points of one system, if `apart` one by one with the FMUs. Rows have failures, except StorageError."""
        with package_limit(self._job.limit), run_anyway(self._job.anyway):
            return self._rows(tasks, apart)

    def _rows(self, tasks: Sequence[Task], apart: bool) -> list[Row]:
        system = self._job.systems[tasks[0][1]]
        if apart or system.program is None:
            return [self._row(task, self._by_fmus) for task in tasks]
        begin = perf_counter()
        outcomes = self._engine(tasks[0][1]).run([system.parameters(values) for _, _, values in tasks])
        share = (perf_counter() - begin) / len(tasks)
        rows: list[Row] = []
        for task, results in zip(tasks, outcomes, strict=True):
            # if there is no result, an FMU gives the reason
            row = self._row(task, self._by_fmus if results is None else lambda _, results=results: results)
            row["wall_s"] += share
            if results is not None and task[0] in self._job.compared:
                try:
                    row |= _differences(results, self._by_fmus(task))
                except VdfmuError as error:
                    row["failed"] = f"the FMUs fail, but the batch engine does not: {_words(error)}"
            rows.append(row)
        return rows

    def _row(self, task: Task, run: Callable[[Task], Results]) -> Row:
        row: Row = {"point": task[0], **dict.fromkeys(("failed", "failed_at", "failed_in", "kind"))}
        begin = perf_counter()
        try:
            results = run(task)
            row |= measured(self._job.measures, results)
            if self._job.keep:
                row["time"] = results.time
                row |= {name: results[name] for name in matching(results.names, self._job.keep)}
        except CosimError as error:
            row |= {"failed": _words(error), "failed_at": error.time, "failed_in": error.unit, "kind": str(error.kind)}
        except (VdfmuError, ArithmeticError, ValueError, TypeError, LookupError, OSError) as error:
            words = _words(error)
            row["failed"] = words if isinstance(error, VdfmuError) else f"{type(error).__name__}: {words}"
        row["wall_s"] = perf_counter() - begin
        return row

    def _by_fmus(self, task: Task) -> Results:
        _, number, values = task
        system, loops = self._job.systems[number], None
        if any(getattr(measure.function, "loops", False) for measure in self._job.measures):
            loops = Poses("tau", TIED)
        try:
            results = self._simulator(number).run(
                parameters=system.parameters(values),
                record=self._job.record,
                taps=[loops] if loops else [],
                **system.run,
            )
        except CosimError as error:
            if loops is not None:
                from vdfmu.study.verdict import explain  # takes long to import

                explain(error, loops)
            raise
        if loops is not None:
            results.summary["loops"] = loops
        return results

    def _engine(self, number: int) -> Any:
        if number not in self._engines:
            self._engines[number] = self._job.systems[number].program.engine(self._job.record)
        return self._engines[number]

    def _simulator(self, number: int) -> Simulator:
        if number not in self._alive:
            if len(self._alive) == _ALIVE:
                self._alive.popitem(last=False)[1][1].close()
            system = self._job.systems[number]
            read = system.read(self._folder / str(number))
            with ExitStack() as stack:
                simulator = stack.enter_context(
                    Simulator(
                        read,
                        inputs=list(system.inputs),
                        input_hold=system.input_hold,
                        log=lambda message: None,
                        **system.options,
                    )
                )
                self._alive[number] = simulator, stack.pop_all()
        self._alive.move_to_end(number)
        return self._alive[number][0]

    def close(self) -> None:
        """Free all systems."""
        while self._alive:
            self._alive.popitem()[1][1].close()


def _words(error: Exception) -> str:
    """Return the text of a point's error; StorageError if the disk caused it."""
    if reason := disk_error(error):
        raise StorageError(str(reason)) from error
    return error_text(error)


def _differences(results: Results, other: Results) -> dict[str, float]:
    """Return the largest difference of signals by unit of measurement."""
    differences: dict[str, float] = {}
    for name, unit in results.units.items():
        largest = float(np.max(np.abs(results[name] - other[name])))
        differences[f"to_fmu[{unit}]"] = max(largest, differences.get(f"to_fmu[{unit}]", 0.0))
    return differences
