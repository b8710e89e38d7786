"""Arguments of another type or without a meaning are refused by a sentence that names them."""

import math
from itertools import product

import numpy as np
import pytest

import vdfmu
from tests.conftest import invoked
from vdfmu.arm.fmus import build_fmus
from vdfmu.arm.units import find_unit
from vdfmu.base.errors import ModelError, UsageError, VdfmuError
from vdfmu.base.files import data_path
from vdfmu.system.scenario import load_scenario

LAG = find_unit(data_path("examples") / "units" / "low_pass.py")
BAD = [
    None, 5, -1, 2.5, "x", "", {}, {"x": 1}, {"a.u": None}, {1: 2}, [], ["a.u"], [1], (), math.nan, math.inf, object(),
    True, b"x", np.zeros(2), lambda *_: None, lambda *_: "x",
]  # fmt: skip


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    return tmp_path_factory.mktemp("misuse")


@pytest.fixture(scope="module")
def system(folder):
    fmu = vdfmu.build(LAG, folder / "lag.fmu")
    return vdfmu.connect({"a": fmu, "b": fmu}, {"a.y": "b.u"}, stop=0.1, step=0.01)


@pytest.fixture(scope="module")
def calls(folder, system):
    """Name to a function and its arguments that are not refused, or whose file there is not."""
    robot, fmu = vdfmu.load_robot("planar_2dof"), folder / "lag.fmu"
    simulator = system.instance().__enter__()
    simulator.reset()

    yield {
        "connect": (vdfmu.connect, dict(
            components={"a": fmu}, connections=(), robot=None, fmi="2.0", stop=None, step=None, algorithm=None,
            parameters=None, name="s",
        )),
        "connection": (lambda part, end: vdfmu.connect({"a": part, "b": fmu}, {"a.y": end}), dict(part=fmu, end="b.u")),
        "load": (vdfmu.load, dict(source=fmu)),
        "System.run": (system.run, dict(stop=None, step=None, parameters=None)),
        "System.margins": (system.margins, dict(opened=(), at=())),
        "System.write": (system.write, dict(path=folder / "o.ssp")),
        "Simulator.reset": (simulator.reset, dict(start=None, stop=None, step=None, parameters=None)),
        "Simulator.set": (simulator.set, dict(name="a.u", value=1.0)),
        "Simulator.get": (simulator.get, dict(name="a.u")),
        "run": (vdfmu.run, dict(scenario="nothing")),
        "sweep": (vdfmu.sweep, dict(scenario="planar_tracking", vary=())),
        "load_motion": (vdfmu.load_motion, dict(path="none.toml", robot=robot)),
        "build": (vdfmu.build, dict(unit="nothing", path=folder / "n.fmu", robot=None, fmi="2.0", parameters=None)),
        "build_fmus": (build_fmus, dict(robot=None, out_dir=folder, units="nothing", parameters=None)),
        "linearize": (vdfmu.linearize, dict(system=robot, at=[0.0, 0.0], dry=False, opened=())),
        "forward_kinematics": (vdfmu.dynamics.forward_kinematics, dict(robot=robot, q=[0.0, 0.0])),
        "load_robot": (vdfmu.load_robot, dict(path_or_name="planar_2dof")),
        "load_scenario": (load_scenario, dict(path_or_name="planar_tracking", robot=None)),
    }  # fmt: skip
    simulator.__exit__(None, None)


@pytest.mark.heavy
def test_no_argument_of_another_type_ends_in_an_error_of_python(calls, monkeypatch, folder):
    monkeypatch.chdir(folder)
    for name, (function, good) in calls.items():
        for argument, value in product(good, BAD):
            try:
                function(**good | {argument: value})
            except VdfmuError as error:
                assert len(str(error)) > 10, (name, argument, value)
            except Exception as error:
                raise AssertionError(f"{name}({argument}={value!r}): {type(error).__name__}: {error}") from error


@pytest.mark.parametrize(("call", "message"), [
    (lambda fmu: vdfmu.load(5), "source: expected a Scenario or a text or a path, got 5"),
    (lambda fmu: vdfmu.connect({"a": fmu}, {"a.y": 5}), "connections: expected 'component.output' to one"),
    (lambda fmu: vdfmu.connect({"a": fmu}, ["a.y"]), "connections: expected 'component.output' to one"),
    (lambda fmu: vdfmu.connect({"a": fmu}, stop=math.nan), "stop: expected a positive finite time in s, got nan"),
    (lambda fmu: vdfmu.connect({"a": fmu}, algorithm="x"), "unknown algorithm 'x'; there are gauss-seidel"),
    (lambda fmu: vdfmu.connect({"a.b": fmu}), "component: expected a name of letters, digits, spaces and _ "),
    (lambda fmu: vdfmu.connect({"a": fmu}, name="../x"), "name: expected a name of letters, digits, spaces and . _ "),
    (lambda fmu: vdfmu.sweep(5, {}), "scenario: expected|vary: expected at least one axis"),
])  # fmt: skip
def test_a_function_says_what_was_expected(system, folder, call, message):
    with pytest.raises(UsageError, match=message):
        call(folder / "lag.fmu")


@pytest.mark.parametrize("name", ["1a", "a-b", "a b", "ä+"])
def test_a_component_has_the_names_of_a_system_file(system, folder, name, tmp_path):
    named = vdfmu.connect({name: folder / "lag.fmu"}, stop=0.1, step=0.01)
    assert named.run(parameters={f"{name}.u": 1.0}).names
    assert vdfmu.load(named.write(tmp_path / "a.ssp")).outputs == [f"{name}.y"]


@pytest.mark.parametrize(("call", "message"), [
    (lambda system: system.run(settings={}), "^System.run: settings is now parameters.$"),
    (lambda system: system.judge(meant="sampled"), "^System.judge: meant is now sampled.$"),
    (lambda system: system.sweep({}, values={}), "^System.sweep: values is now parameters.$"),
    (lambda system: vdfmu.run("tracking", master="jacobi"), "^run: master is now algorithm.$"),
    (lambda system: vdfmu.connect({}, values={}, start_values={}), "connect: values .*\nconnect: start_values is now"),
    (lambda system: vdfmu.linearize("tracking", settings={}), "^linearize: settings is now parameters.$"),
])  # fmt: skip
def test_an_old_name_answers_with_the_new_one_and_the_call(system, call, message):
    with pytest.raises(UsageError, match=message):
        call(system)


@pytest.mark.parametrize(("call", "name"), [
    (lambda system: system.run(foo=1), "System.run"),
    (lambda system: vdfmu.load("tracking", foo=1), "load"),
    (lambda system: vdfmu.load("tracking", master="jacobi"), "load"),  # the name now is none of the call either
    (lambda system: system.run(meant="sampled"), "System.run"),
    (lambda system: vdfmu.linearize("tracking", 0.0, foo=1), "linearize"),
])  # fmt: skip
def test_an_unknown_name_is_refused_by_the_call_that_was_made(system, call, name):
    with pytest.raises(TypeError, match=rf"^{name}\(\) got an unexpected keyword argument"):
        call(system)


def test_old_options_answer_with_the_new_ones(tmp_path):
    assert "--meant is now --sampled/--continuous." in invoked("run", "tracking", "--meant", "sampled").output
    assert "--master is now --algorithm." in invoked("run", "any.ssp", "--master", "jacobi").output
    scenario = tmp_path / "old.toml"
    scenario.write_text('name = "old"\nstop = 0.1\nstep = 0.1\nmaster = "jacobi"\n')
    with pytest.raises(ModelError, match="master: expected a known key, got an unknown one. It is now algorithm."):
        load_scenario(scenario)
