"""Options of functions are held against their declared types, before anything runs."""

import numpy as np
import pytest

import vdfmu
from vdfmu.base.errors import UsageError
from vdfmu.base.option import type_problem
from vdfmu.engine.plan.inputs import read_inputs
from vdfmu.engine.run import Simulator
from vdfmu.study.sweeps.axes import read_axes


@pytest.mark.parametrize(("wrong", "words"), [
    ({"stop": "1"}, "^stop: expected a number in s, got '1'.$"),
    ({"stop": True}, "^stop: expected a number in s, got True"),
    ({"step": np.array([1e-3, 2e-3])}, "^step: expected a number in s, got array"),
    ({"overwrite": "no"}, "^overwrite: expected True or False, got 'no'"),
    ({"reference": 0}, "^reference: expected True or False, got 0"),
    ({"formats": "csv"}, r"^formats: expected a sequence of texts, got 'csv'. Put it into a list: \['csv'\]"),
    ({"parameters": [("controller.K_p", 1)]}, "^parameters: expected a mapping with texts as keys"),
    ({"parameters": {3: 1}}, "^parameters: expected a mapping with texts as keys, got {3: 1}"),
    ({"robot": 3}, "^robot: expected a Robot or a text or a path, got 3"),
    ({"backend": 3}, "^backend: expected a text, one of python, native, got 3"),
    ({"pace": "x", "out": True}, "^pace: .*\nout: expected a text or a path or False, got True"),
])  # fmt: skip
def test_a_value_of_another_type_is_refused_before_the_run(wrong, words):
    with pytest.raises(UsageError, match=words):
        vdfmu.run("planar_tracking", **wrong)


@pytest.mark.parametrize("wrong", [{"points": 2.5}, {"workers": "2"}, {"retry": "no"}, {"measure": "e=rms(plant.q)"}])
def test_so_it_is_of_a_study(wrong):
    with pytest.raises(UsageError, match=f"^{next(iter(wrong))}: expected"):
        vdfmu.sweep("planar_tracking", {"controller.K_p": [500.0]}, **wrong)


def test_so_it_is_of_arguments_and_of_a_run_of_a_simulator(arm_package):
    with pytest.raises(UsageError, match=r"^opened: .*, got 'plant.tau'. Put it into a list: \['plant.tau'\]"):
        vdfmu.linearize("planar_tracking", 0.1, sampled=True, opened="plant.tau")
    with Simulator(arm_package("python")) as simulator:
        for run in (simulator.run, simulator.reset):
            with pytest.raises(UsageError, match="^parameters: expected a mapping with texts as keys, got 3"):
                run(stop=0.01, parameters=3)
        with pytest.raises(UsageError, match="^stream: expected a pathlib.Path or a sequence of them, got 'x'"):
            simulator.run(stop=0.01, stream="x")


def test_numbers_of_numpy_are_numbers_and_an_iterator_is_not_used_up():
    number, whole, switch = "float | None", "int", "bool"
    for value in (1, 0.5, np.float32(1), np.int64(3), np.array(0.1), None):
        assert type_problem("x", number, value) is None
    assert type_problem("x", whole, np.int64(3)) is None
    assert type_problem("x", switch, np.bool_(True)) is None
    assert str(type_problem("x", number, np.bool_(True))).startswith("x: expected a number, got ")
    assert type_problem("x", whole, 3.0) == "x: expected a whole number, got 3.0."
    texts = iter(["a", "b"])
    assert type_problem("x", "Sequence[str]", texts) is None
    assert list(texts) == ["a", "b"]


def test_what_varies_and_inputs_are_held_against_theirs():
    for wrong, words in (("a=1", "Put it into a list"), (3, "got 3"), ({3: [1]}, "texts as keys")):
        with pytest.raises(UsageError, match=f"^vary: expected .*{words}"):
            read_axes(wrong)
    with pytest.raises(UsageError, match=r"^a: expected a value or a list of values, got the shape \(2, 2\)"):
        read_axes({"a": np.zeros((2, 2))})
    for wrong in (3, [3]):
        with pytest.raises(UsageError, match="^inputs: expected a path"):
            read_inputs(wrong)
