"""The tracking system in another master of Python: ``PYTHON masters_worker.py TOOL SPEC.json ROWS.npy``.

It runs in the environment of the tool, in which vdfmu is not. The specification, see :mod:`benchmarks.masters`, names
the FMUs by unit, their connections, the values of inputs at the start, the step [s] and number of steps, and the
signals that make the rows, from the start on; nan where a tool has no row at the start. Prints the tool's version.
"""

# pyright: reportMissingImports=false
from __future__ import annotations

import json
import sys
from collections.abc import Callable, Mapping, Sequence
from importlib.metadata import version
from typing import Any

import numpy as np
from numpy.typing import NDArray

Rows = Sequence[Sequence[float]] | NDArray[np.float64]


def run_pathsim(spec: Mapping[str, Any]) -> Rows:
    """Blocks of co-simulation in a simulation whose step is that of the FMUs."""
    from pathsim import Connection, Simulation
    from pathsim_fmi import CoSimulationFMU

    blocks = {unit: CoSimulationFMU(path, unit, dt=spec["step"]) for unit, path in spec["fmus"].items()}
    connections = [Connection(blocks[a][p], blocks[b][q]) for (a, p), (b, q) in spec["connections"]]
    simulation = Simulation([*blocks.values()], connections, dt=spec["step"], log=False)
    signals = [(blocks[name.partition(".")[0]], name.partition(".")[2]) for name in spec["signals"]]
    rows: list[list[float]] = []
    for _ in range(spec["steps"] + 1):
        rows.append([block.outputs[name] for block, name in signals])
        simulation.timestep(spec["step"], adaptive=False)
    return rows


def run_cofmupy(spec: Mapping[str, Any]) -> Rows:
    """Its ``jacobi``."""
    from cofmupy import Coordinator

    coordinator = Coordinator()
    coordinator.start({
        "fmus": [
            {"id": unit, "name": unit, "path": path, "initialization": spec["start"][unit]}
            for unit, path in spec["fmus"].items()
        ],
        "connections": [
            {"source": {"id": a, "variable": p}, "target": {"id": b, "variable": q}}
            for (a, p), (b, q) in spec["connections"]
        ],
        "cosim_method": "jacobi", "iterative": False, "edge_sep": " -> ", "root": ".",
    })  # fmt: skip
    for _ in range(spec["steps"]):
        coordinator.do_step(spec["step"])
    results = coordinator.get_results()
    columns = [results[tuple(name.split(".", 1))] for name in spec["signals"]]
    return np.vstack([np.full(len(columns), np.nan), np.transpose(columns)])


def run_gemseo(spec: Mapping[str, Any]) -> Rows:
    """Its time-stepping system of disciplines that step, by its Jacobi."""
    from gemseo_fmu.disciplines.do_step_fmu_discipline import DoStepFMUDiscipline
    from gemseo_fmu.disciplines.time_stepping_system import TimeSteppingSystem

    sources = {tuple(end): ".".join(start) for start, end in spec["connections"]}
    stop = spec["step"] * spec["steps"]
    disciplines: list[Any] = []
    for unit, path in spec["fmus"].items():
        read = [p for (a, p), _ in spec["connections"] if a == unit]
        read += [n.partition(".")[2] for n in spec["signals"] if n.startswith(f"{unit}.")]
        fed = {q: source for (b, q), source in sources.items() if b == unit}
        names = {name: f"{unit}.{name}" for name in read} | fed
        disciplines.append(DoStepFMUDiscipline(
            path, input_names=[*fed] or None, output_names=[*dict.fromkeys(read)], time_step=spec["step"],
            final_time=stop, variable_names=names, name=unit, initial_time=0.0,
        ))  # fmt: skip
        start = {fed[name]: np.array([value]) for name, value in spec["start"][unit].items()}
        disciplines[-1].default_input_data = {**disciplines[-1].default_input_data, **start}
    results = TimeSteppingSystem(disciplines, stop, spec["step"], mda_name="MDAJacobi").execute()
    columns = [np.ravel(results[name])[: spec["steps"]] for name in spec["signals"]]  # its sum of steps may end later
    return np.vstack([np.full(len(columns), np.nan), np.transpose(columns)])


RUNNERS: dict[str, tuple[str, Callable[[Mapping[str, Any]], Rows]]] = {
    "pathsim": ("pathsim-fmi", run_pathsim),
    "cofmupy": ("cofmupy", run_cofmupy),
    "gemseo": ("gemseo-fmu", run_gemseo),
}
"""Tool to the package that installs it and what runs the system."""

if __name__ == "__main__":
    package, runner = RUNNERS[sys.argv[1]]
    with open(sys.argv[2], encoding="utf-8") as file:
        np.save(sys.argv[3], np.asarray(runner(json.load(file)), dtype=float))
    print(package, version(package))
