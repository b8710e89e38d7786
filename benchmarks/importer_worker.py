"""Runs one system or unit in one other importer, in a separate process: ``python -m benchmarks.importer_worker``.

The argument is a request in JSON, see :func:`benchmarks.importers.ask`. Prints one line of JSON behind a mark. A run
with ``signals`` also writes their rows, one for each communication point, as a NumPy array to the file ``out``.
"""

from __future__ import annotations

import ctypes
import itertools
import json
import sys
import time
from collections.abc import Callable, Mapping, Sequence
from importlib.metadata import files
from pathlib import Path
from typing import Any

import numpy as np

MARK = "@result "
Request = Mapping[str, Any]


def _load_tbb() -> None:
    """Load the library of the package tbb, to which ecos is linked and which is on no search path."""
    if sys.platform == "linux":
        (library,) = (file for file in files("tbb") or () if file.name == "libtbb.so.12")
        ctypes.CDLL(str(library.locate()), mode=ctypes.RTLD_GLOBAL)


class Ecos:
    """A package in ecos."""

    def __init__(self, path: str, step: float, parameter_set: str | None, observed: bool) -> None:
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
    """A package in libcosim."""

    def __init__(self, path: str, step: float, parameter_set: str | None, observed: bool) -> None:
        from libcosimpy._internal import get_last_error_message
        from libcosimpy.CosimExecution import CosimExecution
        from libcosimpy.CosimLogging import CosimLogLevel, log_output_level
        from libcosimpy.CosimObserver import CosimObserver

        if parameter_set is not None:
            raise ValueError("libcosimpy applies the first parameter set of each component and no other")
        log_output_level(CosimLogLevel.ERROR)
        self._step = round(step * 1e9)
        try:
            self._execution = CosimExecution.from_ssp_file(ssp_path=path, step_size=self._step)
        except AssertionError as error:  # it does not tell the reason, which only the library has
            raise RuntimeError(get_last_error_message() or str(error)) from None
        self._places: dict[str, tuple[int, dict[str, int]]] = {}
        if observed:
            self._observer = CosimObserver.create_last_value()
            self._execution.add_observer(self._observer)

    def advance(self, first: int, last: int) -> None:
        """Go from one communication point to another."""
        if not self._execution.simulate_until(last * self._step):
            raise RuntimeError(f"simulate_until failed: {self._execution.status()}")

    def read(self, signals: Sequence[str]) -> list[float]:
        """Values at the communication point; there are none before the first step, in which it initializes."""
        if self._execution.status().current_time == 0:
            return [np.nan] * len(signals)
        values: list[float] = []
        for unit, names in itertools.groupby(signals, lambda name: name.partition(".")[0]):
            index, references = self._place(unit)
            wanted = [references[name.partition(".")[2]] for name in names]
            values += self._observer.last_real_values(index, wanted)
        return values

    def _place(self, unit: str) -> tuple[int, dict[str, int]]:
        if unit not in self._places:
            index = self._execution.slave_index_from_instance_name(unit)
            if index is None:
                raise ValueError(f"libcosim has no unit {unit!r}")
            variables = self._execution.slave_variables(index)
            self._places[unit] = index, {v.name.decode(): v.reference for v in variables}
        return self._places[unit]

    def close(self) -> None:
        """Nothing to do."""


IMPORTERS: dict[str, type[Ecos] | type[Libcosim]] = {"ecos": Ecos, "libcosim": Libcosim}


def run_timed(request: Request) -> dict[str, Any]:
    """Time the steps in a hundred blocks; no signal is read or observed."""
    n = request["steps"]
    importer = _open(request, observed=False)
    times = _timed(n, importer.advance)
    importer.close()
    return times


def run_rows(request: Request) -> dict[str, Any]:
    """Read the signals at every communication point."""
    importer = _open(request, observed=True)
    signals, n = request["signals"], request["steps"]
    rows = np.empty((n + 1, len(signals)))
    rows[0] = importer.read(signals)
    for k in range(n):
        importer.advance(k, k + 1)
        rows[k + 1] = importer.read(signals)
    importer.close()
    np.save(request["out"], rows)
    return {"rows": n + 1}


def _open(request: Request, observed: bool) -> Ecos | Libcosim:
    kind = IMPORTERS[request["importer"]]
    return kind(request["path"], request["step"], request.get("parameter_set"), observed)


def run_single(request: Request) -> dict[str, Any]:
    """Let one FMU of FMI 3.0 go free in ecos or libcosim and read it at the end."""
    if request["importer"] == "ecos":
        _load_tbb()
        from ecospy import EcosSimulation, EcosSimulationStructure

        with EcosSimulationStructure() as structure:
            structure.add_model("unit", request["path"])
            with EcosSimulation(structure=structure, step_size=request["step"]) as simulation:
                simulation.init()
                simulation.step(request["steps"])
                return {name: simulation.get_real(f"unit::{name}") for name in request["signals"]}
    from libcosimpy.CosimExecution import CosimExecution
    from libcosimpy.CosimSlave import CosimLocalSlave

    execution = CosimExecution.from_step_size(round(request["step"] * 1e9))
    execution.add_local_slave(CosimLocalSlave(fmu_path=request["path"], instance_name="unit"))
    execution.step(request["steps"])
    return {}


def run_fmpy_fmu(request: Request) -> dict[str, Any]:
    """Run one FMU by ``fmpy.simulate_fmu``, driven by recorded inputs if there is a file of them.

    That file holds the time and, named ``variable`` or ``variable[i]``, the value of every input of the step that ends
    at each communication point.
    """
    import fmpy

    path, step, n = request["path"], request["step"], request["steps"]
    variables = fmpy.read_model_description(path).modelVariables or ()
    driven: dict[str, Any] = {}
    if request.get("inputs"):
        with np.load(request["inputs"]) as file:
            recorded = {name: file[name][: n + 1] for name in file.files}
        inputs = {v.name: _members(v) for v in variables if v.causality == "input"}
        inputs = {name: members for name, members in inputs.items() if members[0] in recorded}
        values = {name: np.stack([recorded[m] for m in members], 1) for name, members in inputs.items()}
        values = {v.name: values[v.name].reshape(-1, *(v.shape or ())) for v in variables if v.name in values}
        if inputs:
            types = [("time", float), *[(name, float, value.shape[1:]) for name, value in values.items()]]
            signal = np.zeros(n, dtype=types)
            signal["time"] = recorded["time"][:-1]
            driven = {"input": signal, "start_values": {name: value[0] for name, value in values.items()}}
            for name, value in values.items():
                signal[name] = value[1:]  # of the step that starts here
    # fmucontainer makes locals of outputs that are connected inside
    members = {v.name: _members(v) for v in variables if v.causality in ("output", "local")}
    places = {member: (name, k) for name, group in members.items() for k, member in enumerate(group)}
    wanted = request["signals"]
    if absent := [name for name in wanted if name not in places]:
        raise ValueError(f"{Path(path).name} has no output {absent[0]}")
    # the time of the default experiment is not taken: fmpy would choose an interval of its own
    result = fmpy.simulate_fmu(
        path, start_time=0.0, stop_time=n * step, output_interval=step, output=list({
            places[name][0]: None for name in wanted}), **driven,
    )  # fmt: skip
    columns = [result[places[name][0]].reshape(len(result), -1)[:, places[name][1]] for name in wanted]
    np.save(request["out"], np.stack(columns, axis=1))
    return {"rows": len(result)}


def run_fmpy_timed(request: Request) -> dict[str, Any]:
    """Time the steps of one FMU in ``fmpy.simulate_fmu`` in a hundred blocks, with one recorded output."""
    import fmpy

    path, step, n = request["path"], request["step"], request["steps"]
    output = next(v.name for v in fmpy.read_model_description(path).modelVariables if v.causality == "output")
    edges, marks, done = {n * k // 100 for k in range(101)}, list[tuple[float, float]](), itertools.count(1)

    def finished(at: float, recorder: Any) -> bool:
        if next(done) in edges:
            marks.append((time.perf_counter(), time.process_time()))
        return True

    fmpy.simulate_fmu(
        path, start_time=0.0, stop_time=n * step, output_interval=step, output=[output], step_finished=finished
    )
    # of a hundred blocks the first has no begin, and takes the time of the second
    wall, processor = ([b - a for a, b in itertools.pairwise(values)] for values in zip(*marks, strict=True))
    return {"wall": [wall[0], *wall], "processor": [processor[0], *processor]}


def run_fmpy_fmus(request: Request) -> dict[str, Any]:
    """Run several FMUs, one after the other."""
    return {str(k): run_fmpy_fmu(request | single) for k, single in enumerate(request["fmus"])}


def _members(variable: Any) -> list[str]:
    """Names of the elements of an array, row by row, or of the variable itself."""
    if not variable.shape:
        return [variable.name]
    indices = itertools.product(*(range(1, size + 1) for size in variable.shape))
    return [f"{variable.name}[{','.join(map(str, index))}]" for index in indices]


def run_fmpy_ssp(request: Request) -> dict[str, Any]:
    """Run a package by ``fmpy.ssp``."""
    from fmpy.ssp.simulation import simulate_ssp

    step, n = request["step"], request["steps"]
    result = simulate_ssp(request["path"], stop_time=n * step, step_size=step)
    np.save(request["out"], np.stack([result[name] for name in request["signals"]], axis=1))
    return {"rows": len(result)}


def run_pyssp(request: Request) -> dict[str, Any]:
    """Read a package with pyssp_standard and check its files against the schemas that it brings."""
    from pyssp_standard.ssp import SSP

    with SSP(request["path"], mode="r") as package:
        with package.system_structure as structure:
            structure.__check_compliance__()
            connections = len(structure.connections())
        sets = package.ssv
        for parameter_set in sets:
            with parameter_set as parameters:
                parameters.__check_compliance__()
    return {"connections": connections, "sets": len(sets)}


def _timed(n: int, run: Callable[[int, int], Any]) -> dict[str, Any]:
    edges = [n * k // 100 for k in range(101)]
    marks = [(time.perf_counter(), time.process_time())]
    for first, last in itertools.pairwise(edges):
        run(first, last)
        marks.append((time.perf_counter(), time.process_time()))
    wall, processor = ([b - a for a, b in itertools.pairwise(values)] for values in zip(*marks, strict=True))
    return {"wall": wall, "processor": processor}


RUNNERS: dict[str, Callable[[Request], dict[str, Any]]] = {
    "timed": run_timed,
    "rows": run_rows,
    "single": run_single,
    "fmpy-fmu": run_fmpy_fmu,
    "fmpy-fmus": run_fmpy_fmus,
    "fmpy-timed": run_fmpy_timed,
    "fmpy-ssp": run_fmpy_ssp,
    "pyssp": run_pyssp,
}


def main() -> None:
    """Run what the command line asks for."""
    request = json.loads(sys.argv[1])
    try:
        answer = RUNNERS[request["run"]](request)
    except Exception as error:  # the importer's own words, whatever it raises
        answer = {"error": str(error) or type(error).__name__}
    print(f"\n{MARK}{json.dumps(answer)}", flush=True)


if __name__ == "__main__":
    main()
