"""The same models as FMUs by each exporter from Python that pip installs: what each has, takes and costs.

A mass on a spring with a damper, ``m x_ddot = F - k x - c tanh(x_dot / v_s)``, and a PID controller whose derivative is
filtered, with a constant error. Where the exporter has no solver, the model takes one step of Runge-Kutta's
fourth-order method, as its user would write.
"""

from __future__ import annotations

import subprocess
import sys
import tempfile
import zipfile
from collections.abc import Callable
from contextlib import chdir
from itertools import product
from pathlib import Path
from typing import Any, NamedTuple

import casadi as ca
import fmpy
import numpy as np
from scipy.integrate import solve_ivp

from benchmarks.report import Report, Table
from benchmarks.timing import Case, measure
from vdfmu.arm.fmus import build_fmus
from vdfmu.compiler.fmu.native import fmi_headers

TITLE = "Exporters from Python"
STEP, STEPS = 1e-3, 1000


class Subject(NamedTuple):
    """A model, as the sources for two exporters, and as expressions of its names: rates of the states, and outputs."""

    name: str
    unit: str
    slave: str
    inputs: dict[str, float]
    parameters: dict[str, float]
    states: dict[str, float]
    rates: dict[str, str]
    outputs: dict[str, str]
    watched: str
    """Signal whose error at the end is in the table."""

    def exact(self) -> float:
        """Return the watched signal at the end, solved to 1e-12."""
        constants = {**self.inputs, **self.parameters, "tanh": np.tanh}

        def signals(state: Any) -> dict[str, Any]:
            return {**constants, **dict(zip(self.states, state, strict=True))}

        def rates(_: float, state: Any) -> list[float]:
            return [eval(self.rates[name], signals(state)) for name in self.states]

        start = list(self.states.values())
        solved = solve_ivp(rates, (0.0, STEP * STEPS), start, "DOP853", rtol=1e-12, atol=1e-14)
        return eval(self.outputs.get(self.watched, self.watched), signals(solved.y[:, -1]))


_UNIT = """
from numpy import tanh

from vdfmu.unit import Derivative, Input, Output, Parameter, State, Unit

"""
_SLAVE = """
from math import tanh

from pythonfmu import Fmi2Causality, Fmi2Slave, Fmi2Variability, Real

def declare(slave, causality, variability, **starts):
    for name, start in starts.items():
        setattr(slave, name, start)
        slave.register_variable(Real(name, causality=causality, variability=variability))
"""
_OSCILLATOR = """
class Oscillator(Unit):
    F = Input("1", start=0.0)
    m, k = Parameter("1", start=2.0), Parameter("1", start=800.0)
    c, v_s = Parameter("1", start=3.0), Parameter("1", start=0.1)
    x, v = State("1", start=0.05), State("1", start=0.0)
    der_x, der_v = Derivative(x), Derivative(v)
    E = Output("1")

    def outputs(self):
        self.E = 0.5 * self.m * self.v**2 + 0.5 * self.k * self.x**2

    def derivatives(self):
        self.der_x = self.v
        self.der_v = (self.F - self.k * self.x - self.c * tanh(self.v / self.v_s)) / self.m
"""
_OSCILLATOR_SLAVE = """
class Oscillator(Fmi2Slave):
    def __init__(self, **kwargs):
        super().__init__(**kwargs)
        declare(self, Fmi2Causality.input, Fmi2Variability.continuous, F=0.0)
        declare(self, Fmi2Causality.parameter, Fmi2Variability.tunable, m=2.0, k=800.0, c=3.0, v_s=0.1)
        declare(self, Fmi2Causality.output, Fmi2Variability.continuous, x=0.05, v=0.0, E=0.0)

    def rates(self, x, v):
        return v, (self.F - self.k * x - self.c * tanh(v / self.v_s)) / self.m

    def do_step(self, current_time, h):
        p, q = self.x, self.v
        a = self.rates(p, q)
        b = self.rates(p + h / 2 * a[0], q + h / 2 * a[1])
        c = self.rates(p + h / 2 * b[0], q + h / 2 * b[1])
        d = self.rates(p + h * c[0], q + h * c[1])
        self.x = p + h / 6 * (a[0] + 2 * b[0] + 2 * c[0] + d[0])
        self.v = q + h / 6 * (a[1] + 2 * b[1] + 2 * c[1] + d[1])
        self.E = 0.5 * self.m * self.v**2 + 0.5 * self.k * self.x**2
        return True
"""
_PID = """
class PID(Unit):
    e = Input("1", start=0.05)
    K, T_i = Parameter("1", start=2.0), Parameter("1", start=0.5)
    T_d, T_f = Parameter("1", start=0.02), Parameter("1", start=0.2)
    i, z = State("1", start=0.0), State("1", start=0.0)
    der_i, der_z = Derivative(i), Derivative(z)
    u = Output("1")

    def outputs(self):
        self.u = self.K * (self.e + self.i / self.T_i + self.T_d * (self.e - self.z) / self.T_f)

    def derivatives(self):
        self.der_i = self.e
        self.der_z = (self.e - self.z) / self.T_f
"""
_PID_SLAVE = """
class PID(Fmi2Slave):
    def __init__(self, **kwargs):
        super().__init__(**kwargs)
        declare(self, Fmi2Causality.input, Fmi2Variability.continuous, e=0.05)
        declare(self, Fmi2Causality.parameter, Fmi2Variability.tunable, K=2.0, T_i=0.5, T_d=0.02, T_f=0.2)
        declare(self, Fmi2Causality.output, Fmi2Variability.continuous, i=0.0, z=0.0, u=0.0)

    def rates(self, i, z):
        return self.e, (self.e - z) / self.T_f

    def do_step(self, current_time, h):
        p, q = self.i, self.z
        a = self.rates(p, q)
        b = self.rates(p + h / 2 * a[0], q + h / 2 * a[1])
        c = self.rates(p + h / 2 * b[0], q + h / 2 * b[1])
        d = self.rates(p + h * c[0], q + h * c[1])
        self.i = p + h / 6 * (a[0] + 2 * b[0] + 2 * c[0] + d[0])
        self.z = q + h / 6 * (a[1] + 2 * b[1] + 2 * c[1] + d[1])
        self.u = self.K * (self.e + self.i / self.T_i + self.T_d * (self.e - self.z) / self.T_f)
        return True
"""
SUBJECTS = (
    Subject(
        "Oscillator", _UNIT + _OSCILLATOR, _SLAVE + _OSCILLATOR_SLAVE, {"F": 0.0},
        {"m": 2.0, "k": 800.0, "c": 3.0, "v_s": 0.1}, {"x": 0.05, "v": 0.0},
        {"x": "v", "v": "(F - k * x - c * tanh(v / v_s)) / m"}, {"E": "0.5 * m * v**2 + 0.5 * k * x**2"}, "x",
    ),
    Subject(
        "PID", _UNIT + _PID, _SLAVE + _PID_SLAVE, {"e": 0.05}, {"K": 2.0, "T_i": 0.5, "T_d": 0.02, "T_f": 0.2},
        {"i": 0.0, "z": 0.0}, {"i": "e", "z": "(e - z) / T_f"}, {"u": "K * (e + i / T_i + T_d * (e - z) / T_f)"}, "u",
    ),
)  # fmt: skip


def _ours(folder: Path, subject: Subject, version: str) -> Path:
    (folder / "model.py").write_text(subject.unit)
    built = build_fmus(None, folder, units=[folder / "model.py"], backend="native", fmi_version=version)
    return next(iter(built.values()))


def _slave(folder: Path, subject: Subject) -> Path:
    file = f"{subject.name.lower()}.py"
    (folder / file).write_text(subject.slave)
    command = [sys.executable, "-m", "pythonfmu", "build", "-f", file]
    subprocess.run(command, cwd=folder, check=True, capture_output=True)
    return folder / f"{subject.name}.fmu"


def _casadi(folder: Path, subject: Subject) -> Path:
    dae = ca.DaeBuilder(subject.name)
    names: dict[str, Any] = {"tanh": ca.tanh}
    names |= {name: dae.add(name, "input", {"start": start}) for name, start in subject.inputs.items()}
    parameters = subject.parameters.items()
    names |= {name: dae.add(name, "parameter", "tunable", {"start": start}) for name, start in parameters}
    names |= {name: dae.add(name, "output", {"start": start}) for name, start in subject.states.items()}
    for name, text in subject.rates.items():
        dae.eq(dae.der(names[name]), eval(text, dict(names)))
    for name, text in subject.outputs.items():
        dae.eq(dae.add(name, "output"), eval(text, dict(names)))
    (folder / "headers").mkdir()
    for name, content in fmi_headers("3.0").items():
        (folder / "headers" / name).write_bytes(content)
    with chdir(folder):
        files = dae.export_fmu({"no_warning": True})
        return Path(dae.pack_fmu(dae.compile_fmu(files, {"include_dirs": [str(folder / "headers")]}), {})).resolve()


EXPORTERS: dict[str, Callable[[Path, Subject], Path]] = {
    "vdfmu, FMI 2.0": lambda folder, subject: _ours(folder, subject, "2.0"),
    "vdfmu, FMI 3.0": lambda folder, subject: _ours(folder, subject, "3.0"),
    "PythonFMU": _slave,
    "CasADi": _casadi,
}


def run(report: Report, quick: bool) -> None:
    """Build with each exporter, look into the FMUs, and step them."""
    table = Table("exporters", "An oscillator and a PID controller, built and stepped over 1 ms", [
        ("model", ""), ("exporter", ""), ("FMI", ""), ("kinds", ""), ("needs", ""), ("derivatives", ""),
        ("platforms", ""), ("size [kB]", ".0f"), ("step [us]", ".2f"),
        ("error after 1 s", ".1e"),
    ])  # fmt: skip
    with tempfile.TemporaryDirectory(prefix="vdfmu-bench-") as top:
        for subject, (name, build) in product(SUBJECTS, EXPORTERS.items()):
            folder = Path(top) / f"{len(list(Path(top).iterdir()))}"
            folder.mkdir()
            try:
                fmu = build(folder, subject)
            except (subprocess.CalledProcessError, RuntimeError, ImportError) as error:
                said = getattr(error, "stderr", b"") or str(error).encode()
                table.notes.append(f"{subject.name}, {name}: {said.decode().strip().splitlines()[-1]}")
                continue
            stepped = _stepped(fmu, subject, 3 if quick else 15)
            table.add(subject.name, name, *_facts(fmu), fmu.stat().st_size / 1e3, *stepped)
    table.notes += [
        "Step: processor time with fmpy's call of it; PythonFMU takes one step of Runge-Kutta's method, "
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


def _stepped(fmu: Path, subject: Subject, rounds: int) -> list[float | None]:
    """Return processor time of a step and the error at the end, of co-simulation."""
    description = fmpy.read_model_description(str(fmu), validate=False)
    if description.coSimulation is None:
        return [None, None]
    unit: Any = fmpy.instantiate_fmu(fmpy.extract(str(fmu)), description, "CoSimulation")
    places = {variable.name: variable.valueReference for variable in description.modelVariables}
    three = str(description.fmiVersion).startswith("3")
    if three:
        unit.enterInitializationMode(startTime=0.0)
    else:
        unit.setupExperiment(startTime=0.0)
        unit.enterInitializationMode()
    unit.exitInitializationMode()
    for k in range(STEPS):
        unit.doStep(k * STEP, STEP)
    error = abs((unit.getFloat64 if three else unit.getReal)([places[subject.watched]])[0] - subject.exact())
    count = iter(range(STEPS, 10**9))
    case = Case("step", lambda: unit.doStep(next(count) * STEP, STEP))
    measure([case], rounds)
    unit.terminate()
    unit.freeInstance()
    return [1e6 * case.best, error]
