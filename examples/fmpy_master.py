"""The master in forty lines of fmpy: the FMUs of an SSP, stepped in a loop, bit-identical to ``vdfmu run``.

    vdfmu run planar_tracking --stop 1 --out run
    python fmpy_master.py run

It needs only fmpy and numpy. It reads the connections and values of the SSP, and prints how far its results are from
those of vdfmu and from scipy's solution of the same equations.
"""

import csv
import json
import sys
from pathlib import Path
from tempfile import TemporaryDirectory

import fmpy
import numpy as np
from fmpy.fmi2 import FMU2Slave
from fmpy.ssp.ssd import read_ssd

# A controller passes its torque on within the step. The outputs of trajectory and plant are read as they were at the
# start of the step, because they step last. For the start values each unit follows those whose outputs it needs.
ORDER = ("feedforward", "controller", "trajectory", "plant")
START = ("trajectory", "plant", "feedforward", "controller", "plant")


class Unit:
    """A component of an SSP with its FMU, which is in initialization mode."""

    def __init__(self, component, connections, folder: Path, stop: float) -> None:
        description = fmpy.read_model_description(folder / component.source)
        variables = {v.name: v for v in description.modelVariables}
        links = [each for each in connections if each.endElement == component.name]
        self.inputs = {variables[k.endConnector].valueReference: f"{k.startElement}.{k.startConnector}" for k in links}
        outputs = [v for v in variables.values() if v.causality == "output"]
        self.outputs = {f"{component.name}.{v.name}": v.valueReference for v in outputs}
        self.fmu = FMU2Slave(
            guid=description.guid, modelIdentifier=description.coSimulation.modelIdentifier,
            unzipDirectory=fmpy.extract(folder / component.source, folder / component.name),
        )  # fmt: skip
        self.fmu.instantiate()
        for binding in component.parameterBindings:
            names = {entry.source: entry.target for m in binding.parameterMapping for entry in m.mappingEntries}
            for value in (value for values in binding.parameterValues for value in values.parameters):
                variable = variables.get(names.get(value.name, value.name))
                if variable is not None:
                    write, kind = (self.fmu.setReal, float) if value.type == "Real" else (self.fmu.setInteger, int)
                    write([variable.valueReference], [kind(value.value)])
        self.fmu.setupExperiment(startTime=0.0, stopTime=stop)
        self.fmu.enterInitializationMode()

    def pass_on(self, values: dict[str, float], *step: float) -> dict[str, float]:
        """Set the inputs, do a step of (begin, length) if there is one, and return all values with the new outputs."""
        fed = {reference: values[source] for reference, source in self.inputs.items() if source in values}
        self.fmu.setReal([*fed], [*fed.values()])
        if step:
            self.fmu.doStep(*step)
        return values | dict(zip(self.outputs, self.fmu.getReal([*self.outputs.values()]), strict=True))


def simulate(package: Path, stop: float, step: float) -> dict[str, np.ndarray]:
    """Run the SSP of an arm; return all outputs, such as ``plant.q[1]``, with a value for each communication point."""
    with TemporaryDirectory() as folder:
        system = read_ssd(package).system
        fmpy.extract(package, folder)
        units = {each.name: Unit(each, system.connections, Path(folder), stop) for each in system.elements}
        values: dict[str, float] = {}
        for name in START:
            values = units[name].pass_on(values)
        for unit in units.values():
            unit.fmu.exitInitializationMode()
        rows = [values]
        for k in range(round(stop / step)):
            for name in ORDER:
                values = units[name].pass_on(values, k * step, step)
            rows.append(values)
        for unit in units.values():
            unit.fmu.terminate()
            unit.fmu.freeInstance()
    return {name: np.array([row[name] for row in rows]) for name in values}


if __name__ == "__main__":
    run = Path(sys.argv[1])
    summary = json.loads((run / "summary.json").read_text(encoding="utf-8"))
    signals = simulate(run / "system.ssp", summary["stop"], summary["step"])
    with open(run / "results.csv", encoding="utf-8", newline="") as file:
        columns = zip(next(csv.reader(file)), np.loadtxt(file, delimiter=",", skiprows=1, unpack=True), strict=True)
        equal = [name for name, column in columns if name in signals and np.array_equal(column, signals[name])]
    print(f"{len(equal)} of {len(signals)} outputs are bit-identical to those of vdfmu run.")
    difference = summary["reference"]["sampled"]["max_position_difference_rad"]
    print(f"Largest difference of a joint angle from scipy's solution of the same equations: {difference:.1g} rad.")
