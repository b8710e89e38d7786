"""Runs of one system or unit in one other importer, for a separate process: see :func:`benchmarks.importers.ask`.

Rows have a line for each communication point, the start included, and a column for each signal.
"""

from __future__ import annotations

import ctypes
import itertools
import pickle
import sys
from collections.abc import Mapping, Sequence
from importlib.metadata import files
from pathlib import Path
from typing import Any

import fmpy
import numpy as np

from benchmarks.timing import Clock
from vdfmu.base.process import Parent
from vdfmu.engine.fmu.variables import element_names


def _load_tbb() -> None:
    """Load the library of the package tbb, to which ecos is linked and which is on no search path."""
    if sys.platform == "linux":
        (library,) = (file for file in files("tbb") or () if file.name == "libtbb.so.12")
        ctypes.CDLL(str(library.locate()), mode=ctypes.RTLD_GLOBAL)


class Ecos:
    """A package in ecos."""

    def __init__(self, path: str, step: float, parameter_set: str | None) -> None:
        _load_tbb()
        from ecospy import EcosLib, EcosSimulation

        self._simulation = EcosSimulation(ssp_path=path, step_size=step)
        init = self._simulation.init
        if not (init() if parameter_set is None else init(parameter_set=parameter_set)):
            raise RuntimeError(EcosLib.get_last_error())

    def advance(self, first: int, last: int) -> None:
        """Go from one communication point to another."""
        self._simulation.step(last - first)

    def read(self, signals: Sequence[str]) -> list[float]:
        """Values at the communication point."""
        return [self._simulation.get_real(name.replace(".", "::", 1)) for name in signals]

    def close(self) -> None:
        """End the simulation."""
        self._simulation.terminate()
        self._simulation.free()


class Libcosim:
    """A package in libcosim, which applies the first parameter set of each component and no other."""

    def __init__(self, path: str, step: float, parameter_set: str | None) -> None:
        from libcosimpy._internal import get_last_error_message
        from libcosimpy.CosimExecution import CosimExecution
        from libcosimpy.CosimLogging import CosimLogLevel, log_output_level
        from libcosimpy.CosimObserver import CosimObserver

        log_output_level(CosimLogLevel.ERROR)
        self._step = round(step * 1e9)
        try:
            self._execution = CosimExecution.from_ssp_file(ssp_path=path, step_size=self._step)
        except AssertionError as error:  # it does not tell the reason, which only the library has
            raise RuntimeError(get_last_error_message() or str(error)) from None
        self._observer = CosimObserver.create_last_value()
        self._places: dict[str, tuple[int, dict[str, int]]] = {}

    def advance(self, first: int, last: int) -> None:
        """Go from one communication point to another."""
        if not self._execution.simulate_until(last * self._step):
            raise RuntimeError(f"simulate_until failed: {self._execution.status()}")

    def read(self, signals: Sequence[str]) -> list[float]:
        """Values at the communication point; there are none before the first step, in which it initializes."""
        if self._execution.status().current_time == 0:
            self._execution.add_observer(self._observer)
            return [np.nan] * len(signals)
        values: list[float] = []
        for unit, names in itertools.groupby(signals, lambda name: name.partition(".")[0]):
            index, references = self._place(unit)
            values += self._observer.last_real_values(index, [references[name.partition(".")[2]] for name in names])
        return values

    def _place(self, unit: str) -> tuple[int, dict[str, int]]:
        if unit not in self._places:
            index: Any = self._execution.slave_index_from_instance_name(unit)
            variables = self._execution.slave_variables(index)
            self._places[unit] = index, {v.name.decode(): v.reference for v in variables}
        return self._places[unit]

    def close(self) -> None:
        """Nothing to do."""


IMPORTERS: dict[str, type[Ecos] | type[Libcosim]] = {"ecos": Ecos, "libcosim": Libcosim}


def timed(importer: str, path: str, step: float, steps: int, parameter_set: str | None = None) -> Any:
    """Return the processor times of the steps in a hundred blocks; no signal is read or observed."""
    running, clock = IMPORTERS[importer](path, step, parameter_set), Clock()
    clock.progress(0, steps)
    for first, last in itertools.pairwise(steps * k // 100 for k in range(101)):
        running.advance(first, last)
        clock.progress(last, steps)
    running.close()
    return clock.blocks


def rows(
    importer: str, path: str, step: float, steps: int, signals: Sequence[str], parameter_set: str | None = None
) -> Any:
    """Read the signals of a package at every communication point."""
    running = IMPORTERS[importer](path, step, parameter_set)
    read = [running.read(signals)]
    for k in range(steps):
        running.advance(k, k + 1)
        read.append(running.read(signals))
    running.close()
    return read


def single(importer: str, path: str, step: float, steps: int, signals: Sequence[str]) -> list[float]:
    """Let one FMU of FMI 3.0 go free in ecos or libcosim and read it at the end."""
    if importer == "ecos":
        _load_tbb()
        from ecospy import EcosSimulation, EcosSimulationStructure

        with EcosSimulationStructure() as structure:
            structure.add_model("unit", path)
            with EcosSimulation(structure=structure, step_size=step) as simulation:
                simulation.init()
                simulation.step(steps)
                return [simulation.get_real(f"unit::{name}") for name in signals]
    from libcosimpy.CosimExecution import CosimExecution
    from libcosimpy.CosimSlave import CosimLocalSlave

    execution = CosimExecution.from_step_size(round(step * 1e9))
    execution.add_local_slave(CosimLocalSlave(fmu_path=path, instance_name="unit"))
    execution.step(steps)
    return []


def fmpy_fmu(
    path: str, step: float, steps: int, signals: Sequence[str], recorded: Mapping[str, Any] | None = None
) -> Any:
    """Run one FMU by ``fmpy.simulate_fmu``, driven by what was recorded, if anything.

    That has the time and, named ``variable`` or ``variable[i]``, the value of every input of the step that ends at
    each communication point.
    """
    variables = fmpy.read_model_description(path).modelVariables or ()
    members = {v.name: element_names(v.name, v.shape) for v in variables}
    places = {member: (name, k) for name, group in members.items() for k, member in enumerate(group)}
    driven: dict[str, Any] = {}
    if recorded:
        inputs = {
            v.name: np.stack([recorded[m] for m in members[v.name]], 1).reshape(-1, *(v.shape or ()))
            for v in variables
            if v.causality == "input" and members[v.name][0] in recorded
        }
        types = [("time", float), *((name, float, value.shape[1:]) for name, value in inputs.items())]
        signal = np.zeros(steps, dtype=types)
        signal["time"] = recorded["time"][:steps]
        for name, value in inputs.items():
            signal[name] = value[1 : steps + 1]  # of the step that starts here
        driven = {"input": signal, "start_values": {name: value[0] for name, value in inputs.items()}}
    # the time of the default experiment is not taken: fmpy would choose an interval of its own
    result = fmpy.simulate_fmu(
        path, start_time=0.0, stop_time=steps * step, output_interval=step,
        output=[*dict.fromkeys(places[name][0] for name in signals)], **driven,
    )  # fmt: skip
    columns = [result[places[name][0]].reshape(len(result), -1)[:, places[name][1]] for name in signals]
    return np.stack(columns, axis=1)


def fmpy_timed(path: str, step: float, steps: int) -> Any:
    """Time the steps of one FMU in ``fmpy.simulate_fmu`` as `timed` does, with one recorded output."""
    output = next(v.name for v in fmpy.read_model_description(path).modelVariables or () if v.causality == "output")
    clock, done = Clock(), itertools.count(1)

    def finished(at: float, recorder: Any) -> bool:
        if (k := next(done)) % (steps // 100) == 0:
            clock.progress(k, steps)
        return True

    fmpy.simulate_fmu(
        path, start_time=0.0, stop_time=steps * step, output_interval=step, output=[output], step_finished=finished
    )
    # of a hundred blocks the first has no begin, and takes the time of the second
    return [clock.blocks[0], *clock.blocks]


def fmpy_ssp(path: str, step: float, steps: int, signals: Sequence[str]) -> Any:
    """Run a package by ``fmpy.ssp``."""
    from fmpy.ssp.simulation import simulate_ssp

    result = simulate_ssp(path, stop_time=steps * step, step_size=step)
    return np.stack([result[name] for name in signals], axis=1)


def pyssp(path: str) -> tuple[int, int]:
    """Check the files of a package against the schemas of pyssp_standard; count connections and parameter sets."""
    from pyssp_standard.ssp import SSP

    with SSP(Path(path), mode="r") as package:
        with package.system_structure as structure:
            structure.__check_compliance__()
            connections = len(structure.connections())
        sets = package.ssv
        for parameter_set in sets:
            with parameter_set as parameters:
                parameters.__check_compliance__()
    return connections, len(sets)


def main() -> None:
    """Run what is asked for, and reply with the result or with the importer's own words."""
    parent = Parent()
    for request in parent.requests():
        run, arguments = pickle.loads(request)
        try:
            parent.reply({"result": run(**arguments)})
        except Exception as error:  # whatever an importer raises
            parent.reply({"error": str(error) or type(error).__name__})


if __name__ == "__main__":
    main()
