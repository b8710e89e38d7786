"""The same models as FMUs by each exporter from Python that pip installs: what each has, takes and costs.

A mass on a spring with a damper, ``m x_ddot = F - k x - c tanh(x_dot / v_s)``, and a PID controller whose derivative is
filtered, with a constant error. Where the exporter has no solver, the model takes one step of Runge-Kutta's
fourth-order method, as its user would write.
"""

from __future__ import annotations

import os
import re
import subprocess
import sys
import tempfile
import zipfile
from collections.abc import Callable, Iterable
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
    """A model, as expressions of its names: rates of the states, and outputs."""

    name: str
    text: str
    inputs: dict[str, float]
    parameters: dict[str, float]
    states: dict[str, float]
    rates: dict[str, str]
    outputs: dict[str, str]
    watched: str
    """Signal whose error at the end is in the table."""

    def of_self(self, expression: str, names: Iterable[str]) -> str:
        """Return an expression with names as attributes."""
        return re.sub(rf"\b({'|'.join(names)})\b", r"self.\1", expression)

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


SUBJECTS = (
    Subject(
        "Oscillator", "Mass on a spring.", {"F": 0.0}, {"m": 2.0, "k": 800.0, "c": 3.0, "v_s": 0.1},
        {"x": 0.05, "v": 0.0}, {"x": "v", "v": "(F - k * x - c * tanh(v / v_s)) / m"},
        {"E": "0.5 * m * v**2 + 0.5 * k * x**2"}, "x",
    ),
    Subject(
        "PID", "Controller.", {"e": 0.05}, {"K": 2.0, "T_i": 0.5, "T_d": 0.02, "T_f": 0.2},
        {"i": 0.0, "z": 0.0}, {"i": "e", "z": "(e - z) / T_f"}, {"u": "K * (e + i / T_i + T_d * (e - z) / T_f)"}, "u",
    ),
)  # fmt: skip
_SLAVE = """
from math import tanh

from pythonfmu import Fmi2Causality, Fmi2Slave, Fmi2Variability, Real


class MODEL(Fmi2Slave):
    def __init__(self, **kwargs):
        super().__init__(**kwargs)
        for name, causality, start in VARIABLES:
            setattr(self, name, start)
            variability = Fmi2Variability.tunable if causality == "parameter" else Fmi2Variability.continuous
            self.register_variable(Real(name, causality=getattr(Fmi2Causality, causality), variability=variability))

    def rates(self, STATES):
        return RATES

    def do_step(self, current_time, h):
        p, q = SELF_STATES
        a = self.rates(p, q)
        b = self.rates(p + h / 2 * a[0], q + h / 2 * a[1])
        c = self.rates(p + h / 2 * b[0], q + h / 2 * b[1])
        d = self.rates(p + h * c[0], q + h * c[1])
        SELF_STATES = p + h / 6 * (a[0] + 2 * b[0] + 2 * c[0] + d[0]), q + h / 6 * (a[1] + 2 * b[1] + 2 * c[1] + d[1])
        OUTPUTS
        return True
"""


def _ours(folder: Path, subject: Subject, version: str) -> Path:
    """Write the class and build it."""
    names = [*subject.inputs, *subject.parameters, *subject.states]
    declared = [
        *(f'{name} = Input("1", start={start})' for name, start in subject.inputs.items()),
        *(f'{name} = Parameter("1", start={start})' for name, start in subject.parameters.items()),
        *(f'{name} = State("1", start={start})' for name, start in subject.states.items()),
        *(f"der_{name} = Derivative({name})" for name in subject.states),
        *(f'{name} = Output("1")' for name in subject.outputs),
    ]
    methods = {
        "outputs": [f"self.{name} = {subject.of_self(text, names)}" for name, text in subject.outputs.items()],
        "derivatives": [f"self.der_{name} = {subject.of_self(text, names)}" for name, text in subject.rates.items()],
    }
    lines = [
        "from numpy import tanh", "from vdfmu.unit import Derivative, Input, Output, Parameter, State, Unit",
        f"class {subject.name}(Unit):", f'    """{subject.text}"""', *(f"    {line}" for line in declared),
    ]  # fmt: skip
    for name, body in methods.items():
        lines += [f"    def {name}(self):", *(f"        {line}" for line in body)]
    (folder / "model.py").write_text("\n".join(lines) + "\n")
    built = build_fmus(None, folder, units=[folder / "model.py"], backend="native", fmi_version=version)
    return next(iter(built.values()))


def _slave(folder: Path, subject: Subject) -> Path:
    """Build with PythonFMU."""
    constants = {**subject.inputs, **subject.parameters}
    kinds = dict.fromkeys(subject.inputs, "input") | dict.fromkeys(subject.parameters, "parameter")
    starts = {**constants, **subject.states, **dict.fromkeys(subject.outputs, 0.0)}
    names = [*constants, *subject.states]
    replaced = {
        "MODEL": subject.name, "VARIABLES": repr([(n, kinds.get(n, "output"), x) for n, x in starts.items()]),
        "SELF_STATES": ", ".join(f"self.{name}" for name in subject.states), "STATES": ", ".join(subject.states),
        "RATES": ", ".join(subject.of_self(subject.rates[name], constants) for name in subject.states),
        "OUTPUTS": "; ".join(f"self.{name} = {subject.of_self(text, names)}" for name, text in subject.outputs.items()),
    }  # fmt: skip
    text = _SLAVE
    for word, new in replaced.items():
        text = text.replace(word, new)
    file = f"{subject.name.lower()}.py"
    (folder / file).write_text(text)
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
    here = Path.cwd()
    os.chdir(folder)
    try:
        files = dae.export_fmu({"no_warning": True})
        return Path(dae.pack_fmu(dae.compile_fmu(files, {"include_dirs": [str(folder / "headers")]}), {})).resolve()
    finally:
        os.chdir(here)


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
