"""Every run is held against the plain methods of its units: faults in cache, trace, C and parameters are found."""

import dataclasses
import re
import shutil

import casadi as ca
import numpy as np
import pytest

import vdfmu
from vdfmu.arm.robot import load_robot
from vdfmu.base.cache import load, store
from vdfmu.compiler.c import generate
from vdfmu.compiler.functions.traced import Functions
from vdfmu.compiler.unit.evaluate import Plain
from vdfmu.compiler.unit.program import UnitFunctions
from vdfmu.engine.masters.observer import Reading
from vdfmu.engine.results.results import Results
from vdfmu.study.run import scenario_run as study
from vdfmu.system.package.description import SystemDescription
from vdfmu.system.package.write import write_ssp
from vdfmu.system.reference.witness import Witness
from vdfmu.system.scenario import load_scenario

SHORT = {"stop": 0.05, "reference": False}


HELD = '''
from vdfmu.unit import JOINTS, Input, Output, Parameter, Sampled, Unit


class Held(Unit):
    """Feedforward and a filtered velocity error."""

    q_d_dot = Input("velocity", JOINTS, "desired velocity")
    kappa_dot = Input("velocity", JOINTS, "velocity of the rotor")
    tau_m = Input("N.m", JOINTS, "feedforward")
    tau = Output("N.m", JOINTS, "torque")
    e = Sampled("velocity", JOINTS, "filtered velocity error")
    period = Parameter("s", start=1e-3, minimum=1e-6)

    def outputs(self):
        self.tau = self.tau_m + 0.1 * self.e

    def update(self):
        self.e = 0.5 * self.e + 0.5 * (self.q_d_dot - self.kappa_dot)
'''


@pytest.fixture(scope="module")
def primed(kernel_cache, tmp_path_factory):
    """Return a cache with the functions of the small arm, and of one with another second axis."""
    cache = tmp_path_factory.mktemp("primed")
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("VDFMU_CACHE_DIR", str(cache))
        for robot in (None, other_robot()):
            vdfmu.run("planar_tracking", robot=robot, backend="python", out=False, **SHORT)
    return cache


@pytest.fixture
def cache(primed, tmp_path, monkeypatch):
    folder = tmp_path / "cache"
    shutil.copytree(primed, folder)
    monkeypatch.setenv("VDFMU_CACHE_DIR", str(folder))
    return folder


def other_robot():
    robot = load_robot("planar_2dof")
    c, s = np.cos(0.3), np.sin(0.3)
    rotation = robot.rotation.copy()
    rotation[1] = [[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]]
    return dataclasses.replace(robot, name="other", rotation=rotation)


def faults(**options):
    options = {"backend": "python", **SHORT, **options}
    return vdfmu.run("planar_tracking", out=False, **options).summary["witness"]["faults"]


def entries(cache, name):
    paths = list(cache.glob(f"*/{name}.casadi"))
    assert paths
    return paths


def change(cache, name, made):
    """Let a cached function have other results: `made` gets and returns them by name, beside its arguments."""
    for path in entries(cache, name):
        content = load(path)
        assert content is not None
        function = ca.Function.deserialize(content.decode())
        arguments = {key: ca.MX.sym(key, *function.size_in(key)) for key in function.name_in()}
        results = dict(zip(function.name_out(), function.call(list(arguments.values())), strict=True))
        results |= made(arguments | results)
        new = ca.Function(name, [*arguments.values()], [*results.values()], [*arguments], [*results])
        store(path, new.serialize().encode())


def another_robot(cache):
    first, second = (path.parent for path in entries(cache, "plant_derivatives"))
    functions = {path.name: (load(path), load(second / path.name)) for path in first.glob("*.casadi")}
    for name, (content, content_of_second) in functions.items():
        store(first / name, content_of_second)
        store(second / name, content)


# function in the cache, the results that it has then, and what is said
CACHED = {
    "a flipped sign": ("plant_outputs", lambda v: {"p_O": -v["p_O"]}, r"plant\.p_O\[\d\] at t = .* s: expected"),
    "a changed coefficient": (
        "controller_outputs_kappa_dot", lambda v: {"tau": (1.0 + 1e-6) * v["tau"]}, r"controller\.tau\[",
    ),
    "swapped outputs": (
        "plant_outputs", lambda v: {"E_kin": v["E_pot"], "E_pot": v["E_kin"]}, r"plant\.E_(kin|pot)",
    ),
    "a term that is left out": (
        "feedforward_outputs_inverse", lambda v: {"tau_m": v["tau_m"] - 1e-6}, r"feedforward\.tau_m",
    ),
    "a solver that moves too far": (
        "plant_step", lambda v: {"x_new": v["x"] + 1.001 * (v["x_new"] - v["x"])}, r"plant\.der\(",
    ),
    "another start": (
        "plant_start_equilibrium", lambda v: {"x": 1.0001 * v["x"]}, r"plant\.(q|tau_s)\[\d\] at t = 0 s",
    ),
}  # fmt: skip


@pytest.mark.heavy
@pytest.mark.parametrize("fault", ["the trace of another robot", *CACHED])
def test_faults_in_the_cache_are_found(fault, cache):
    if fault in CACHED:
        name, made, text = CACHED[fault]
        change(cache, name, made)
    else:
        text = r"plant\.|feedforward\."
        another_robot(cache)
    messages = faults()
    assert messages
    assert re.search(text, messages[0]), messages


@pytest.mark.heavy
def test_a_run_in_another_process_is_witnessed(tmp_path):
    """Python FMUs of the user's units are isolated."""
    path = tmp_path / "held.py"
    path.write_text(HELD)
    options = {"units": {"controller": path}, "stop": 0.01, "reference": False, "backend": "python"}
    results = vdfmu.run("planar_tracking", out=False, **options)
    assert results.summary["isolated"]
    assert "controller" in results.summary["witness"]["components"]
    assert results.summary["witness"]["faults"] == []


@pytest.mark.heavy
def test_rounding_is_not_a_fault(cache):
    """A factor of 1 + 1e-14 is some 45 roundings."""
    for name, result in (("plant_outputs", "p_O"), ("feedforward_outputs_inverse", "tau_m")):
        change(cache, name, lambda v, result=result: {result: (1.0 + 1e-14) * v[result]})
    assert faults() == []


@pytest.mark.heavy
def test_a_parameter_that_is_not_the_scenarios_is_found(cache, monkeypatch):
    def write(scenario, fmus, path, values, **options):
        values = {**values, "plant": values["plant"] | {"mass[2]": 1.5}}
        return write_ssp(scenario, fmus, path, values, **options)

    monkeypatch.setattr(study, "write_ssp", write)
    assert faults()[0] == "plant.mass[2] at t = 0 s: expected 1, got 1.5"


@pytest.fixture(scope="module")
def objects(tmp_path_factory):
    cache = tmp_path_factory.mktemp("objects")
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("VDFMU_CACHE_DIR", str(cache))
        vdfmu.run("planar_tracking", backend="native", out=False, **SHORT)
    return cache


def replaced(files, name, where, old, new):
    """Replace the first `old` after `where` in a file, if it is there."""
    if name not in files:
        return files
    before, separator, after = files[name].partition(where)
    assert separator
    assert old in after
    return {**files, name: before + separator + after.replace(old, new, 1)}


# file, place in it, what is replaced by what there, and what is said
WRITTEN = {
    "a flipped sign": ("kernel_plant_derivatives.c", "double w0", " - ", " + ", r"plant\.der\("),
    "a wrong constant": ("kernel_plant_outputs.c", "double w0", " = 2.0 *", " = 2.000001 *", r"plant\.E_spring "),
    "a wrong index": ("kernel_plant_outputs.c", "double w0", "x[7]", "x[6]", r"plant\.(kappa|E_spring)"),
    "a flipped sign in a sample": ("kernel_held_update.c", "double w0", " + ", " - ", r"controller\.e\["),
    "a flipped sign in the solver": ("kernel_plant_step.c", "value_out)\n{", " - ", " + ", r"plant\.der\(q_dot"),
}


@pytest.mark.heavy
@pytest.mark.parametrize("fault", WRITTEN)
def test_faults_in_generated_c_are_found(fault, objects, tmp_path, monkeypatch):
    *seed, text = WRITTEN[fault]
    plain = generate.kernel_files
    monkeypatch.setenv("VDFMU_CACHE_DIR", str(objects))
    monkeypatch.setattr(generate, "kernel_files", lambda *arguments: replaced(plain(*arguments), *seed))
    shutil.rmtree(objects / "fmus")
    path = tmp_path / "held.py"
    path.write_text(HELD)
    units = {"controller": path} if "sample" in fault else None
    stop = 0.1 if units or "solver" in fault else 1.0  # unstable, and of short steps, with these faults
    messages = faults(backend="native", stop=stop, units=units)
    assert re.match(text, messages[0]), messages


def test_a_number_that_is_off_by_more_than_the_promise_is_a_fault_and_a_smaller_one_is_rounding():
    """Agreement is promised to 1e-9 of a group's largest value, and to as much as such errors of the sources cause.

    The arm hangs at rest. A number that is off by 1e-8 of itself is beyond both: its sources move it by less.
    """
    system = SystemDescription(load_scenario("planar_tracking"))
    witness, values, places = Witness(system), {}, {}
    for name, table in system.tables.items():
        plain = Plain(table, table.memory_of(system.values[name]))
        plain.start()
        plain.outputs()
        plain.derivatives()
        values[name] = dict(enumerate(plain.memory.tolist()))
        places |= {f"{name}.{v.name}": k for k, v in enumerate(table.memory)}
    none = Results(np.zeros(1), [], {})

    def faults_with(signal, change):
        name = signal.partition(".")[0]
        moved = values | {name: values[name] | {places[signal]: (1.0 + change) * values[name][places[signal]]}}
        witness.probe.readings = [Reading(0, 0.0, moved, {})]
        return witness.summary(none)["faults"]

    for signal in (
        "plant.q[1]",
        "plant.kappa[1]",
        "plant.p_O[3]",
        "plant.E_pot",
        "trajectory.q_d[1]",
        "feedforward.tau_s[1]",
    ):
        assert faults_with(signal, 0.0) == faults_with(signal, 1e-12) == []
        assert faults_with(signal, 1e-8), signal


def refuse(*_, **__):
    raise AssertionError("the witness has no trace, no cache and no C")


def test_it_shares_nothing_and_takes_little_time(monkeypatch, calls):
    made = []
    monkeypatch.setattr(study, "Witness", lambda *arguments: made.append(Witness(*arguments)) or made[0])
    results = vdfmu.run("tracking", stop=0.1, reference=False, backend="python", out=False)
    for place in (UnitFunctions, Functions):
        monkeypatch.setattr(place, "casadi_function", refuse)
    monkeypatch.setattr("vdfmu.compiler.functions.traced.load", refuse)
    monkeypatch.setattr("vdfmu.compiler.unit.evaluate.Traced", refuse)
    witnessed = made[0].summary(results)
    assert witnessed["faults"] == []
    assert witnessed["components"] == ["trajectory", "feedforward", "controller", "plant"]
    assert len(witnessed["times_s"]) == 5
    assert calls(lambda: made[0].summary(results)) < 200_000  # seen: 165 thousand, in 0.06 s
