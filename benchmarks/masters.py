"""The tracking system in masters of Python that have an environment of their own.

``python -m benchmarks.masters TOOL PYTHON``, with TOOL of :data:`benchmarks.masters_worker.RUNNERS`, PYTHON the
interpreter of the environment that it is installed in. Prints what docs/interop.md says of the tool.
"""

from __future__ import annotations

import json
import subprocess
import sys
import tempfile
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import fmpy
import numpy as np
from fmpy.fmi2 import FMU2Slave
from numpy.typing import NDArray

from benchmarks import masters_worker
from benchmarks.interop import Tracking
from vdfmu.arm.units import shipped_units
from vdfmu.engine.package.read import load_ssp
from vdfmu.engine.run.once import simulate

ORDER = ("feedforward", "controller", "plant", "trajectory")
"""The order of this project's gauss-seidel."""
GROUPS: Mapping[str, Sequence[Sequence[str]]] = {
    "pathsim": [[unit] for unit in ORDER],
    "cofmupy": [["trajectory"], ["feedforward", "controller", "plant"]],
    "gemseo": [["trajectory"], ["feedforward", "controller", "plant"]],
}
"""Which units step at once in a tool; a unit reads what groups before its own have written in the same step."""
ALIKE = {"pathsim": "gauss-seidel"}
"""This project's algorithm with the same order."""


def specification(tracking: Tracking, fmi: str) -> dict[str, Any]:
    """Return what a tool is told; inputs start with the values of our own run."""
    connections = [(c.start, c.end) for c in load_ssp(tracking.package("native")).connections]
    with np.load(tracking.recorded("native", tracking.step)) as file:
        start = {u: {q: float(file[f"{u}.{q}"][0]) for _, (b, q) in connections if b == u} for u in ORDER}
    fmus = {unit: str(tracking.fmus("native", fmi) / f"{shipped_units()[unit].__name__}.fmu") for unit in ORDER}
    return tracking.request(connections=connections, fmus=fmus, start=start)


def plain_loop(spec: Mapping[str, Any], groups: Sequence[Sequence[str]]) -> NDArray[np.float64]:
    """Return the rows of a loop of FMPy's calls, group after group."""
    sources = {tuple(end): tuple(start) for start, end in spec["connections"]}
    values: dict[tuple[str, str], float] = {}
    units: dict[str, tuple[FMU2Slave, dict[str, int], list[str], list[str]]] = {}
    for unit, path in spec["fmus"].items():
        model = fmpy.read_model_description(path)
        assert model.coSimulation
        fmu = FMU2Slave(
            guid=model.guid, unzipDirectory=fmpy.extract(path), instanceName=unit,
            modelIdentifier=model.coSimulation.modelIdentifier,
        )  # fmt: skip
        fmu.instantiate()
        fmu.setupExperiment(startTime=0.0)
        fmu.enterInitializationMode()
        fmu.exitInitializationMode()
        references = {v.name: v.valueReference for v in model.modelVariables}
        outputs = [v.name for v in model.modelVariables if v.causality == "output"]
        units[unit] = fmu, references, outputs, [q for b, q in sources if b == unit]
        read = fmu.getReal([references[name] for name in outputs])
        values |= {(unit, name): value for name, value in zip(outputs, read, strict=True)}
    signals = [tuple(name.split(".", 1)) for name in spec["signals"]]
    rows = [[values[signal] for signal in signals]]
    values |= {sources[unit, q]: value for unit, starts in spec["start"].items() for q, value in starts.items()}
    for k in range(spec["steps"]):
        for group in groups:
            new: dict[tuple[str, str], float] = {}
            for unit in group:
                fmu, references, outputs, inputs = units[unit]
                if inputs:
                    fmu.setReal([references[q] for q in inputs], [values[sources[unit, q]] for q in inputs])
                fmu.doStep(k * spec["step"], spec["step"])
                read = fmu.getReal([references[name] for name in outputs])
                new |= {(unit, name): value for name, value in zip(outputs, read, strict=True)}
            values |= new
        rows.append([values[signal] for signal in signals])
    return np.array(rows)


def main(tool: str, python: str) -> None:
    """Run the system of either version of FMI in a tool, and print how far it is from other runs."""
    with tempfile.TemporaryDirectory(prefix="vdfmu-bench-") as folder:
        tracking = Tracking(Path(folder)).prepare()
        expected = {"a plain loop of the same order": plain_loop(specification(tracking, "2.0"), GROUPS[tool])}
        expected["our jacobi"] = tracking.jacobi("native")
        if algorithm := ALIKE.get(tool):
            package = tracking.package("native")
            run = simulate(package, step=tracking.step, stop=tracking.stop, algorithm=algorithm)
            expected[f"our {algorithm}"] = np.stack([run[name] for name in tracking.signals], axis=1)
        for fmi in ("2.0", "3.0"):
            asked, answer = Path(folder) / f"{fmi}.json", Path(folder) / f"{fmi}.npy"
            asked.write_text(json.dumps(specification(tracking, fmi)), encoding="utf-8")
            command = [python, masters_worker.__file__, tool, str(asked), str(answer)]
            done = subprocess.run(command, capture_output=True, text=True, check=False, timeout=600, cwd=folder)
            if done.returncode:
                print(f"FMI {fmi}: {done.stderr.strip().splitlines()[-1]}")
                continue
            print(f"FMI {fmi}, {done.stdout.strip().splitlines()[-1]}:")
            for name, rows in expected.items():
                print(f"  {np.nanmax(np.abs(np.load(answer) - rows)):.1e} rad to {name}")


if __name__ == "__main__":
    main(*sys.argv[1:])
