"""Runs of units: their inputs, and what the FMU makes of them."""

import csv
import tempfile
from collections.abc import Mapping
from pathlib import Path

import fmpy
import numpy as np
from fmpy.fmi2 import FMU2Slave

from tests.extras.efmi.efmu import Efmu, Rows
from vdfmu.compiler.unit.trace import argument_name
from vdfmu.engine.run import simulate
from vdfmu.system.package.write import build_parts, write_ssp
from vdfmu.system.scenario import load_scenario
from vdfmu.system.scenario.values import system_values

STEP = 1e-3


def experiment(efmu: Efmu, steps: int) -> Rows:
    """Return the inputs of the unit's reference results, linear between their points."""
    member = f"extra/org.fmi-standard.fmi-ls-ref/{efmu.name}_in.csv"
    if member not in efmu.files:
        return {}
    head, *rows = csv.reader(efmu.files[member].decode().splitlines())
    table = np.array(rows, dtype=float)
    columns = {name: np.interp(STEP * np.arange(steps), table[:, 0], table[:, i]) for i, name in enumerate(head)}
    return grouped(columns, efmu.names("input"))


def grouped(columns: Mapping[str, np.ndarray], names: list[str]) -> Rows:
    elements: dict[str, list[np.ndarray]] = {}
    for name, values in columns.items():
        elements.setdefault(name.split("[")[0], []).append(values)
    return {name: np.stack(elements[name], axis=1) for name in names if name in elements}


def of_fmu(path: Path, inputs: Rows, steps: int) -> Rows:
    """Return the outputs of an FMU for the inputs of each step."""
    # They are those that the order of docs/cosimulation.md passes to others in the step: of a unit with inputs what
    # its doStep from t_k makes of those at t_k, of one without, what it gave for t_k before that doStep.
    with tempfile.TemporaryDirectory() as folder:
        fmpy.extract(str(path), folder)
        description = fmpy.read_model_description(folder)
        unit = FMU2Slave(
            guid=description.guid, unzipDirectory=folder, modelIdentifier=description.modelName, instanceName="unit"
        )
        places: dict[str, list[int]] = {}
        for v in description.modelVariables:
            places.setdefault(v.name.split("[")[0], []).append(v.valueReference)
        outputs = list(
            dict.fromkeys(v.name.split("[")[0] for v in description.modelVariables if v.causality == "output")
        )
        series: dict[str, list[list[float]]] = {name: [] for name in outputs}
        has_inputs = any(v.causality == "input" for v in description.modelVariables)
        unit.instantiate()
        unit.setupExperiment(startTime=0.0)
        unit.enterInitializationMode()
        for k in range(steps):
            for name, values in inputs.items():
                unit.setReal(places[name], values[k].tolist())
            if k == 0:
                unit.exitInitializationMode()
            if has_inputs:
                unit.doStep(k * STEP, STEP)
            for name in outputs:
                series[name].append(unit.getReal(places[name]))
            if not has_inputs:
                unit.doStep(k * STEP, (k + 1) * STEP - k * STEP)  # exact, and so is its end (k + 1) STEP: Sterbenz
        unit.freeInstance()
    return {argument_name(name): np.array(values) for name, values in series.items()}


class ScenarioRun:
    """A run of a scenario by the package's master, with what each unit was given and gave in each step."""

    def __init__(self, name: str, folder: Path) -> None:
        self._scenario = load_scenario(name)
        self._values = system_values(self._scenario)
        fmus = build_parts(self._scenario, folder, self._values, backend="native")
        package = write_ssp(self._scenario, fmus, folder / "system.ssp", self._values)
        self._results = simulate(package, progress=False, record=["*"])

    def efmus(self, folder: Path, precision: str) -> dict[str, Path]:
        """Return component to its eFMU, with the scenario's values."""
        return build_parts(self._scenario, folder, self._values, target="efmi", precision=precision)

    def _signals(self, component: str, names: list[str]) -> Rows:
        columns = {
            signal.partition(".")[2]: np.asarray(self._results[signal])[1:]  # row k is of the step that ends there
            for signal in self._results
            if signal.partition(".")[0] == component
        }
        return grouped(columns, names)

    def inputs(self, component: str, efmu: Efmu) -> Rows:
        """Return the inputs of each step."""
        return self._signals(component, efmu.names("input"))

    def outputs(self, component: str, efmu: Efmu) -> Rows:
        """Return the outputs of each step."""
        return self._signals(component, efmu.names("output"))
