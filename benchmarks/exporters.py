"""The same model as an FMU by each exporter from Python that pip installs: what it has, what it takes, what it costs.

A mass on a spring with a damper, ``m x_ddot = F - k x - c tanh(x_dot / v_s)``. Where the exporter has no solver, the
model takes one step of Runge-Kutta's fourth-order method, as its user would write.
"""

from __future__ import annotations

import os
import subprocess
import sys
import tempfile
import zipfile
from collections.abc import Callable
from pathlib import Path
from typing import Any

import casadi as ca
import fmpy
import numpy as np
from fmpy.fmi2 import FMU2Slave
from fmpy.fmi3 import FMU3Slave
from scipy.integrate import solve_ivp

import vdfmu
from benchmarks.report import Report, Table
from benchmarks.timing import Case, measure, processor_time
from vdfmu.compiler.fmu.native import fmi_headers

TITLE = "Exporters from Python"
STEP, STEPS = 1e-3, 1000
NAME = "Oscillator"

_UNIT = '''
import numpy as np
from vdfmu.unit import Derivative, Input, Output, Parameter, State, Unit


class Oscillator(Unit):
    """Mass on a spring."""

    F = Input("N")
    m, k = Parameter("kg", start=2.0), Parameter("N/m", start=800.0)
    c, v_s = Parameter("N", start=3.0), Parameter("m/s", start=0.1)
    x, v = State("m"), State("m/s")
    E = Output("J")
    der_x, der_v = Derivative(x), Derivative(v)

    def outputs(self):
        self.E = 0.5 * self.m * self.v**2 + 0.5 * self.k * self.x**2

    def derivatives(self):
        self.der_x = self.v
        self.der_v = (self.F - self.k * self.x - self.c * np.tanh(self.v / self.v_s)) / self.m
'''
_SLAVE = """
import math
from PACKAGE import FmiCausality, FmiSlave, FmiVariability, Number


class Oscillator(FmiSlave):
    def __init__(self, **kwargs):
        super().__init__(**kwargs)
        self.F, self.m, self.k, self.c, self.v_s, self.x, self.v, self.E = 0.0, 2.0, 800.0, 3.0, 0.1, 0.05, 0.0, 0.0
        for name, causality in (("F", "input"), ("m", "parameter"), ("k", "parameter"), ("c", "parameter"),
                                ("v_s", "parameter"), ("x", "output"), ("v", "output"), ("E", "output")):
            variability = FmiVariability.tunable if causality == "parameter" else FmiVariability.continuous
            self.register_variable(Number(name, causality=getattr(FmiCausality, causality), variability=variability))

    def rates(self, x, v):
        return v, (self.F - self.k * x - self.c * math.tanh(v / self.v_s)) / self.m

    def do_step(self, current_time, h):
        x, v = self.x, self.v
        a = self.rates(x, v)
        b = self.rates(x + h / 2 * a[0], v + h / 2 * a[1])
        c = self.rates(x + h / 2 * b[0], v + h / 2 * b[1])
        d = self.rates(x + h * c[0], v + h * c[1])
        self.x = x + h / 6 * (a[0] + 2 * b[0] + 2 * c[0] + d[0])
        self.v = v + h / 6 * (a[1] + 2 * b[1] + 2 * c[1] + d[1])
        self.E = 0.5 * self.m * self.v**2 + 0.5 * self.k * self.x**2
        return True
"""


def _ours(folder: Path, version: str) -> Path:
    (folder / "oscillator.py").write_text(_UNIT)
    built = vdfmu.build_fmus(None, folder, units=[folder / "oscillator.py"], backend="native", fmi_version=version)
    return next(iter(built.values()))


def _slave(folder: Path, package: str, version: str) -> Path:
    """Build with PythonFMU, or PythonFMU3."""
    text = _SLAVE.replace("PACKAGE", package).replace("Fmi", f"Fmi{version}")
    file = f"oscillator_{version}.py"  # the second FMU of one process takes the module of the first of its name
    (folder / file).write_text(text.replace("Number", "Real" if version == "2" else "Float64"))
    command = [sys.executable, "-m", package, "build", "-f", file]
    subprocess.run(command, cwd=folder, check=True, capture_output=True)
    return folder / f"{NAME}.fmu"


def _casadi(folder: Path) -> Path:
    dae = ca.DaeBuilder(NAME)
    F = dae.add("F", "input")
    m, k, c, v_s = (
        dae.add(name, "parameter", "tunable", {"start": start})
        for name, start in (("m", 2.0), ("k", 800.0), ("c", 3.0), ("v_s", 0.1))
    )
    x, v = dae.add("x", "output", {"start": 0.05}), dae.add("v", "output", {"start": 0.0})
    dae.eq(dae.der(x), v)
    dae.eq(dae.der(v), (F - k * x - c * ca.tanh(v / v_s)) / m)
    E = dae.add("E", "output")
    dae.eq(E, 0.5 * m * v**2 + 0.5 * k * x**2)
    (folder / "headers").mkdir()
    for name, content in fmi_headers("3.0").items():
        (folder / "headers" / name).write_bytes(content)
    here = Path.cwd()
    os.chdir(folder)
    try:
        files = dae.export_fmu({"no_warning": True})
        return Path(dae.pack_fmu(dae.compile_fmu(files, {"include_dirs": [str(folder / "headers")]}), {})).resolve()
    finally:
        os.chdir(here)


EXPORTERS: dict[str, Callable[[Path], Path]] = {
    "vdfmu, FMI 2.0": lambda folder: _ours(folder, "2.0"),
    "vdfmu, FMI 3.0": lambda folder: _ours(folder, "3.0"),
    "PythonFMU": lambda folder: _slave(folder, "pythonfmu", "2"),
    "PythonFMU3": lambda folder: _slave(folder, "pythonfmu3", "3"),
    "CasADi": _casadi,
}


def run(report: Report, quick: bool) -> None:
    """Build with each exporter, look into the FMU, and step it."""
    table = Table("exporters", "One oscillator, built and stepped over 1 ms", [
        ("exporter", ""), ("FMI", ""), ("kinds", ""), ("needs", ""), ("derivatives", ""), ("platforms", ""),
        ("build [s]", ".2f"), ("size [kB]", ".0f"), ("step [us]", ".2f"), ("error after 1 s [m]", ".1e"),
    ])  # fmt: skip
    end = solve_ivp(
        lambda t, s: [s[1], (-800.0 * s[0] - 3.0 * np.tanh(s[1] / 0.1)) / 2.0], (0.0, STEP * STEPS), [0.05, 0.0],
        "DOP853", rtol=1e-12, atol=1e-14,
    ).y[0, -1]  # fmt: skip
    with tempfile.TemporaryDirectory(prefix="vdfmu-bench-") as top:
        os.environ["XDG_CACHE_HOME"] = str(Path(top) / "cache")  # what is built once is built again here
        for name, build in EXPORTERS.items():
            folder = Path(top) / f"{len(list(Path(top).iterdir()))}"
            folder.mkdir()
            began = processor_time()
            try:
                fmu = build(folder)
            except (subprocess.CalledProcessError, RuntimeError, ImportError) as error:
                said = getattr(error, "stderr", b"") or str(error).encode()
                table.notes.append(f"{name}: {said.decode().strip().splitlines()[-1]}")
                continue
            seconds = processor_time() - began
            table.add(name, *_facts(fmu), seconds, fmu.stat().st_size / 1e3, *_stepped(fmu, end, 3 if quick else 15))
    table.notes += [
        "Build: processor time. Step: with fmpy's call of it; PythonFMU takes one step of Runge-Kutta's method, "
        "vdfmu's solver as many as its tolerance of 1e-7 asks for. CS: co-simulation, ME: model exchange.",
        "PythonFMU's binaries come with its package, so a build compiles nothing; those of vdfmu for other platforms "
        "come with --platform.",
        "Rumoca's package on PyPI has no FMI (its targets say that they require a feature); Archimedes has C, no FMU.",
    ]
    report.show(table)


def _facts(fmu: Path) -> list[Any]:
    """Return version, kinds, need, derivatives and platforms."""
    description = fmpy.read_model_description(str(fmu), validate=False)
    kinds = {"CS": description.coSimulation, "ME": description.modelExchange}
    with zipfile.ZipFile(fmu) as archive:
        names = archive.namelist()
    platforms = sorted({name.split("/")[1] for name in names if name.startswith("binaries/") and name.count("/") > 1})
    needs = "Python" if any(name.startswith("resources/") and name.endswith(".py") for name in names) else "nothing"
    parts = [part for part in kinds.values() if part is not None]
    derivatives = any(
        getattr(part, f"provides{kind}", False)
        for part in parts for kind in ("DirectionalDerivative", "DirectionalDerivatives", "AdjointDerivatives")
    )  # fmt: skip
    return [
        description.fmiVersion, ", ".join(key for key, part in kinds.items() if part is not None), needs,
        "yes" if derivatives else "no", ", ".join(platforms),
    ]  # fmt: skip


def _stepped(fmu: Path, end: float, rounds: int) -> list[float | None]:
    """Return processor time of a step and the error at the end, of co-simulation."""
    description = fmpy.read_model_description(str(fmu), validate=False)
    if description.coSimulation is None:
        return [None, None]
    folder = fmpy.extract(str(fmu))
    slave = FMU3Slave if str(description.fmiVersion).startswith("3") else FMU2Slave
    one: Any = slave(
        guid=description.guid, unzipDirectory=folder, modelIdentifier=description.coSimulation.modelIdentifier,
        instanceName="one",
    )  # fmt: skip
    places = {variable.name: variable.valueReference for variable in description.modelVariables}
    one.instantiate()
    three = slave is FMU3Slave
    if "x_0" in places:
        (one.setFloat64 if three else one.setReal)([places["x_0"]], [0.05])
    if three:
        one.enterInitializationMode(startTime=0.0)
    else:
        one.setupExperiment(startTime=0.0)
        one.enterInitializationMode()
    one.exitInitializationMode()
    for k in range(STEPS):
        one.doStep(k * STEP, STEP)
    error = abs((one.getFloat64 if three else one.getReal)([places["x"]])[0] - end)
    count = iter(range(STEPS, 10**9))
    case = Case("step", lambda: one.doStep(next(count) * STEP, STEP))
    measure([case], rounds)
    one.terminate()
    one.freeInstance()
    return [1e6 * case.best, error]
