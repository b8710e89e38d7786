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
from numpy.typing import NDArray

from benchmarks import masters_worker
from benchmarks.interop import Tracking
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
    recorded = tracking.recorded("native")
    start = {u: {q: float(recorded[f"{u}.{q}"][0]) for _, (b, q) in connections if b == u} for u in ORDER}
    fmus = {unit: tracking.fmu(unit, "native", fmi) for unit in ORDER}
    whole = {"step": tracking.step, "steps": tracking.steps, "signals": tracking.signals}
    return whole | {"connections": connections, "fmus": fmus, "start": start}


def plain_loop(spec: Mapping[str, Any], groups: Sequence[Sequence[str]]) -> NDArray[np.float64]:
    """Return the rows of a loop of FMPy's calls, group after group."""
    sources = {tuple(end): tuple(start) for start, end in spec["connections"]}
    values: dict[tuple[str, str], float] = {}
    fmus: dict[str, Any] = {}
    references: dict[tuple[str, str], int] = {}
    outputs: dict[str, list[tuple[str, str]]] = {}

    def read(unit: str) -> dict[tuple[str, str], float]:
        read = fmus[unit].getReal([references[signal] for signal in outputs[unit]])
        return dict(zip(outputs[unit], read, strict=True))

    for unit, path in spec["fmus"].items():
        model = fmpy.read_model_description(path)
        fmus[unit] = fmpy.instantiate_fmu(fmpy.extract(path), model, "CoSimulation")
        fmus[unit].setupExperiment(startTime=0.0)
        fmus[unit].enterInitializationMode()
        fmus[unit].exitInitializationMode()
        references |= {(unit, v.name): v.valueReference for v in model.modelVariables}
        outputs[unit] = [(unit, v.name) for v in model.modelVariables if v.causality == "output"]
        values |= read(unit)
    signals = [tuple(name.split(".", 1)) for name in spec["signals"]]
    rows = [[values[signal] for signal in signals]]
    values |= {sources[unit, q]: value for unit, starts in spec["start"].items() for q, value in starts.items()}
    for k in range(spec["steps"]):
        for group in groups:
            new: dict[tuple[str, str], float] = {}
            for unit in group:
                fed = [end for end in sources if end[0] == unit]
                fmus[unit].setReal([references[end] for end in fed], [values[sources[end]] for end in fed])
                fmus[unit].doStep(k * spec["step"], spec["step"])
                new |= read(unit)
            values |= new
        rows.append([values[signal] for signal in signals])
    return np.array(rows)


def main(tool: str, python: str) -> None:
    """Run the system of either version of FMI in a tool, and print how far it is from other runs."""
    with tempfile.TemporaryDirectory(prefix="vdfmu-bench-") as folder:
        tracking = Tracking(Path(folder)).prepare()
        expected = {"a plain loop of the same order": plain_loop(specification(tracking, "2.0"), GROUPS[tool])}
        expected["our jacobi"] = tracking.positions("native")
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
