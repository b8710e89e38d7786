"""The master algorithm gauss-seidel with nothing but fmpy and numpy: the bits of ``vdfmu run``.

    vdfmu build planar_tracking --out fmus
    python fmpy_master.py fmus --stop 1

A controller passes its torque on within the step; what a trajectory or a plant shows is read as it was at the start of
the step. So the controllers step first, and each unit reads the newest value. An output goes to the inputs of its name.
"""

import argparse
import shutil
from pathlib import Path

import fmpy
import numpy as np
from fmpy.fmi2 import FMU2Slave

ORDER = ("Feedforward", "PDController", "Trajectory", "Plant")  # of the steps
START = ("Trajectory", "Plant", "Feedforward", "PDController")  # each before those that need its outputs


class Unit:
    """An FMU, instantiated and in initialization mode."""

    def __init__(self, file: Path, stop: float) -> None:
        description = fmpy.read_model_description(file)
        ports = {kind: {v.name: v.valueReference for v in description.modelVariables if v.causality == kind}
                 for kind in ("input", "output")}  # fmt: skip
        self.inputs, self.outputs = ports["input"], ports["output"]
        self.folder = fmpy.extract(file)
        model = description.coSimulation.modelIdentifier
        self.fmu = FMU2Slave(guid=description.guid, unzipDirectory=self.folder, modelIdentifier=model)
        self.fmu.instantiate()
        self.fmu.setupExperiment(startTime=0.0, stopTime=stop)
        self.fmu.enterInitializationMode()

    def write(self, values: dict[str, float]) -> None:
        """Set the inputs that have a value."""
        names = [name for name in self.inputs if name in values]
        self.fmu.setReal([self.inputs[name] for name in names], [values[name] for name in names])

    def read(self) -> dict[str, float]:
        """Get the outputs."""
        return dict(zip(self.outputs, self.fmu.getReal([*self.outputs.values()]), strict=True))


def simulate(folder: Path, stop: float, step: float) -> dict[str, np.ndarray]:
    """Run the four FMUs of a folder; return ``Plant.q[1]`` and all other outputs, (m,) each, a value a step."""
    units = {model: Unit(folder / f"{model}.fmu", stop) for model in ORDER}
    newest: dict[str, float] = {}
    for model in (*START, "Plant"):  # again, now that there is a torque
        units[model].write(newest)
        newest |= units[model].read()
    for unit in units.values():
        unit.fmu.exitInitializationMode()
    rows = [{f"{model}.{name}": value for model in ORDER for name, value in units[model].read().items()}]
    for k in range(round(stop / step)):
        rows.append({})
        for model, unit in units.items():
            unit.write(newest)
            unit.fmu.doStep(currentCommunicationPoint=k * step, communicationStepSize=step)
            shown = unit.read()
            newest |= shown
            rows[-1] |= {f"{model}.{name}": value for name, value in shown.items()}
    for unit in units.values():
        unit.fmu.terminate()
        unit.fmu.freeInstance()
        shutil.rmtree(unit.folder)
    return {name: np.array([row[name] for row in rows]) for name in rows[0]}


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("folder", type=Path)
    parser.add_argument("--stop", type=float, default=1.0)
    parser.add_argument("--step", type=float, default=1e-3)
    options = parser.parse_args()
    signals = simulate(options.folder, options.stop, options.step)
    error = signals["Trajectory.q_d[1]"] - signals["Plant.q[1]"]
    print(f"largest position error of joint 1: {np.abs(error).max():.3g} rad")
