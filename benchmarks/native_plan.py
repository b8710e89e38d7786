"""The steps of a master as a plan for a loop of compiled code, which shows what the units take by themselves."""

from __future__ import annotations

import ctypes
import tempfile
from collections.abc import Generator
from contextlib import contextmanager
from dataclasses import dataclass, field
from functools import lru_cache
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.system import quiet
from benchmarks.timing import Case, measure
from vdfmu.base.compile import compile_library
from vdfmu.base.files import pack_zip
from vdfmu.base.platforms import PLATFORMS, this_platform
from vdfmu.engine.fmu.instance import Instance
from vdfmu.engine.masters.exchange import Call, Exchange
from vdfmu.engine.masters.sampled import SampledStepper
from vdfmu.engine.package.read import load_ssp
from vdfmu.engine.package.system import Component, FlatSystem
from vdfmu.engine.plan.check import check_system
from vdfmu.engine.run.isolated import Limits
from vdfmu.engine.run.session import Session

_COPY, _TRANSFER, _DO_STEP = range(3)


class _Action(ctypes.Structure):
    _fields_ = [
        ("kind", ctypes.c_int), ("function", ctypes.c_void_p), ("component", ctypes.c_void_p),
        ("index", ctypes.c_void_p), ("n", ctypes.c_size_t), ("value", ctypes.c_void_p), ("source", ctypes.c_void_p),
    ]  # fmt: skip


@lru_cache
def loop_library() -> Any:
    """Compiled loops of ``native_loop.c``.

    Raises
    ------
    FmuError
        If the compiler is not installed.
    """
    source = Path(__file__).with_name("native_loop.c").read_bytes()
    platform = this_platform()
    content = compile_library({"native_loop.c": source}, platform, name="native_loop", flags=("-fvisibility=default",))
    with tempfile.TemporaryDirectory(prefix="vdfmu-bench-", ignore_cleanup_errors=True) as folder:
        path = Path(folder) / f"native_loop{PLATFORMS[platform].suffix}"
        path.write_bytes(content)
        library = ctypes.CDLL(str(path))
    for name in ("run_plan", "clock_cost"):
        getattr(library, name).restype = ctypes.c_double
    return library


@contextmanager
def ready(path: Path, algorithm: str, stop: float) -> Generator[Exchange]:
    """Units of a package or of one FMU, initialized, and the memory that they share."""
    with tempfile.TemporaryDirectory(prefix="vdfmu-bench-") as folder:
        system = load_ssp(path) if path.suffix == ".ssp" else _alone(path, Path(folder))
        with Session(check_system(system, algorithm=algorithm), quiet, isolate=False, limits=Limits()) as session:
            session.components.initialize(0.0, stop, None)
            yield session.exchange


def _alone(fmu: Path, folder: Path) -> FlatSystem:
    """Return a system of one FMU."""
    member = f"resources/{fmu.name}"
    package = folder / f"{fmu.stem}.ssp"
    pack_zip(package, {member: fmu.read_bytes()})
    return FlatSystem(package, fmu.stem, (Component(fmu.stem, member, "CoSimulation", {}),), (), {})


@dataclass
class Plan:
    """What a master does in a step: copies of values and FMI calls.

    Attributes
    ----------
    names : list of (unit, "gather" | "set" | "do_step" | "get")
        Of each action. The copies before all others belong to the unit "all".
    signals : list of str
        Of the columns of :meth:`run`.
    """

    exchange: Exchange
    step: float
    names: list[tuple[str, str]] = field(default_factory=list)
    signals: list[str] = field(default_factory=list)
    _actions: list[_Action] = field(default_factory=list)
    _kept: list[Any] = field(default_factory=list)

    def __post_init__(self) -> None:
        (bank,) = (bank for bank in self.exchange.banks if bank.memory.size)  # units of vdfmu have real signals only
        self._bank = bank
        self.signals = [f"{unit}.{variable.name}" for unit, variable in bank.variables]
        self._copy("all", slice(0, bank.inputs.size))
        stepper = SampledStepper(self.exchange)
        self._kept.append(stepper)
        for instance, _, calls in stepper.stages:
            self._stage(instance, calls)

    def _copy(self, unit: str, window: slice) -> None:
        links = self._bank.links[window]
        if not links:
            return
        positions = np.array([self._bank.position[link.start] for link in links], np.intp)
        self._kept.append(positions)
        target = self._bank.inputs[window].ctypes.data
        source = self._bank.outputs.ctypes.data
        self._add(unit, "gather", _Action(_COPY, None, None, positions.ctypes.data, len(links), target, source))

    def _stage(self, instance: Instance, calls: list[Call]) -> None:
        unit = instance.name
        start = self._bank.input_windows[unit].start
        self._copy(unit, slice(start, start + self._bank.fresh_counts[unit]))
        for function, arguments, name in calls:
            address = ctypes.cast(function, ctypes.c_void_p).value
            component = instance.fmu.component
            if name == "doStep":
                self._add(unit, "do_step", _Action(_DO_STEP, address, component, None, 0, None, None))
                continue
            index, value = arguments[1]._obj, arguments[3]._obj  # of byref
            places = ctypes.addressof(index), len(index), ctypes.addressof(value)
            self._add(unit, name[:3], _Action(_TRANSFER, address, component, *places, None))

    def _add(self, unit: str, what: str, action: _Action) -> None:
        self.names.append((unit, what))
        self._actions.append(action)

    def run(
        self, steps: int, *, clocks: bool = False
    ) -> tuple[np.ndarray, dict[tuple[str, str], np.ndarray], np.ndarray]:
        """Do the steps in compiled code.

        Parameters
        ----------
        clocks : bool, optional
            Take the time of each action.

        Returns
        -------
        times : (100,) array
            Time of each block over the number of steps [s]; see :class:`benchmarks.system.Clock`. With clocks it is
            longer.
        parts : dict of (unit, action) to (100,) array
            The same of each action, without the cost of the clocks.
        rows : (steps + 1, m) array
            Outputs and inputs at each communication point.
        """
        library, memory, n = loop_library(), self._bank.memory, len(self._actions)
        rows = np.zeros((steps + 1, memory.size))
        rows[0] = memory
        edges = [steps * k // 100 for k in range(101)]
        spent = np.zeros(100)
        seconds = np.zeros((100, n))
        plan, cost = (_Action * n)(*self._actions), library.clock_cost()
        for k, (first, last) in enumerate(pairwise(edges)):
            spent[k] = library.run_plan(
                plan, ctypes.c_size_t(n), ctypes.c_long(first), ctypes.c_long(last), ctypes.c_double(self.step),
                ctypes.c_void_p(memory.ctypes.data), ctypes.c_size_t(memory.size),
                ctypes.c_void_p(rows.ctypes.data), ctypes.c_void_p(seconds[k].ctypes.data if clocks else None),
            )  # fmt: skip
            if spent[k] < 0.0:
                raise RuntimeError("a unit failed in the compiled loop")
        seconds -= cost * np.diff(edges)[:, None]
        parts = dict(zip(self.names, seconds.T / steps, strict=True)) if clocks else {}
        return spent / steps, parts, rows


def interpreter_parts(path: Path, algorithm: str, step: float, rounds: int) -> dict[str, float]:
    """Time of the parts of the master's step [s], with empty units.

    Returns
    -------
    dict
        ``calls``: all FMI calls of a step, which do nothing; ``gather``: copies of values; ``record``: a row.
    """
    with ready(path, algorithm, 1.0) as exchange:
        stepper, exchange.size.value = SampledStepper(exchange), step
        _, _, store = exchange.recorders(2, None)
        plan = [call for _, _, calls in stepper.stages for call in calls]
        gathers = [*stepper.opening, *(gather for _, each, _ in stepper.stages for gather in each)]

        def call_all() -> None:
            for function, arguments, _ in plan:
                if function(*arguments):
                    raise RuntimeError("an empty unit failed")

        def gather_all() -> None:
            for gather in gathers:
                gather()

        cases = [Case("calls", call_all), Case("gather", gather_all), Case("record", lambda: store(1))]
        measure(cases, rounds)
        return {case.name: case.best for case in cases} | {"number of calls": float(len(plan))}
