"""Components of FMI 3.0, and of 2.0 beside them: types, arrays, sizes, events, clocks."""

import numpy as np
import pytest

from tests.engine.reference import models
from vdfmu.base.errors import CosimError, SspError, UsageError
from vdfmu.engine.fmu import instance
from vdfmu.engine.fmu.access import Transfer
from vdfmu.engine.package.read import load_ssp
from vdfmu.engine.plan.check import check_system
from vdfmu.engine.plan.schedule import variable_graph
from vdfmu.engine.run import simulate


def test_the_graph_of_an_array_grows_with_its_length(system):
    """Every element of an output depends on every element of an input."""

    def edges(n):
        code = "static void outputs(Instance *I) { for (int i = 0; i < N; i++) I->d.y[i] = I->d.u[i] + 1; }\n"
        variables = [models.V("u", "input", start=[0.0] * n, dims=(n,), room=n),
                     models.V("y", "output", dims=(n,), room=n, needs=("u",))]  # fmt: skip
        model = models.Model(f"Array{n}", variables, code.replace("N", str(n)))
        path = system({"a": (model, "3.0"), "b": (model, "3.0")}, [f"a.y[{i}] -> b.u[{i}]" for i in range(1, n + 1)])
        checked = check_system(load_ssp(path))
        results = simulate(path, stop=0.2, step=0.1)
        assert results[f"b.y[{n}]"].tolist() == [2.0] * 3
        return len(variable_graph(checked.descriptions, checked.links, initial=True)[1])

    assert edges(40) < 2.1 * edges(20)


def test_units_of_both_versions_in_one_system(system):
    """Real is Float64, Float32 and Real; integers are integers of any length."""
    path = system(
        {"two": (models.FEEDTHROUGH_2, "2.0"), "three": (models.FEEDTHROUGH, "3.0"),
         "back": (models.FEEDTHROUGH_2, "2.0")},
        ["two.Float64_output -> three.Float64_input", "two.Int32_output -> three.Int8_input",
         "two.Boolean_output -> three.Boolean_input", "three.Float64_output -> back.Float64_input",
         "three.Int8_output -> back.Int32_input", "three.Boolean_output -> back.Boolean_input"],
    )  # fmt: skip
    values = {"two.Float64_input": 0.1, "two.Int32_input": -128, "two.Boolean_input": True}
    results = simulate(path, stop=0.2, step=0.1, parameters=values)
    assert results["back.Float64_output"].tolist() == [0.1] * 3
    assert results["back.Int32_output"].tolist() == [-128] * 3
    assert results["back.Boolean_output"].all()
    # what does not fit is no other number
    with pytest.raises(CosimError, match=r"three failed .* in setInt8: expected a value of type Int8, got 128"):
        simulate(path, stop=0.2, step=0.1, parameters=values | {"two.Int32_input": 128}, isolate=False)


def test_whole_numbers_and_truths_feed_reals(system):
    units = {"a": (models.FEEDTHROUGH, "3.0"), "two": (models.FEEDTHROUGH_2, "2.0"), "s": (models.STATE_SPACE, "3.0")}
    links = ["a.Int64_output -> s.u[1]", "a.Boolean_output -> s.u[2]", "a.Enumeration_output -> s.u[3]"]
    path = system(units, [*links, "a.Boolean_output -> two.Int32_input", "two.Int32_output -> a.Float64_input"])
    starts = {"a.Int64_input": -(2**53) - 1, "a.Boolean_input": True, "a.Enumeration_input": 2}
    for stepper, isolate in (("fmpy", False), ("c", False), ("c", True)):
        options = {"stop": 0.2, "step": 0.1, "stepper": stepper, "isolate": isolate, "record": ["*"]}
        results = simulate(path, parameters=starts, **options)
        assert results["s.u"].tolist() == [[-(2.0**53), 1.0, 2.0]] * 3  # to the nearest real
        assert results["a.Float64_output"].tolist() == [1.0] * 3
        assert results["a.Int64_output"].tolist() == [-(2**53) - 1] * 3


def test_elements_of_arrays_that_fit_are_connected_one_by_one(system):
    path = system({"a": (models.FEEDTHROUGH, "3.0")})
    with pytest.raises(UsageError, match=r"'a.UInt8_input': expected at most 255, got 256"):
        simulate(path, stop=0.1, step=0.1, parameters={"a.UInt8_input": 256})
    with pytest.raises(
        UsageError, match=r"'a.Binary_input': expected bytes, or a text of hexadecimal digits, got 'no hex'"
    ):
        simulate(path, stop=0.1, step=0.1, parameters={"a.Binary_input": "no hex"})
    mixed = {"a": (models.FEEDTHROUGH, "3.0"), "b": (models.FEEDTHROUGH, "3.0")}
    path = system(mixed, ["a.Float64_output -> b.Int8_input", "a.String_output -> b.Binary_input"])
    with pytest.raises(SspError, match=r"type mismatch, Float64 to Int8\n?(.|\n)*type mismatch, String to Binary"):
        check_system(load_ssp(path))
    # One element fed, the others as set: the array is set as a whole all the same.
    path = system(
        {"k": (models.FEEDTHROUGH_2, "2.0"), "s": (models.STATE_SPACE, "3.0"), "t": (models.STATE_SPACE, "3.0")},
        ["k.Float64_output -> s.u[2]", "s.y[3] -> t.u[1]", "s.y[1] -> t.u[3]"],
    )
    zero = {f"{name}.{matrix}": [0.0] * 9 for name in ("s", "t") for matrix in ("A", "B")}
    results = simulate(
        path, stop=0.2, step=0.1, parameters={"k.Float64_input": 7.0, "s.u[1]": 5.0, "t.u[2]": -1.0, **zero}
    )
    assert results["s.y"].tolist() == [[5.0, 7.0, 3.0]] * 3
    assert results["t.y"].tolist() == [[3.0, -1.0, 5.0]] * 3


@pytest.mark.heavy
def test_structural_parameters_size_the_arrays(system):
    sizes = {"s.n": 2, "s.m": 1, "s.r": 4}
    path = system({"s": (models.STATE_SPACE, "3.0")})
    values = {"s.A": [0.0, 1.0, -1.0, 0.0], "s.B": [0.0, 0.0], "s.C": [1.0, 0.0, 0.0, 1.0, 2.0, 0.0, 1.0, 1.0],
              "s.D": [0.0] * 4, "s.x0": [1.0, 0.0], "s.u": [0.0]}  # fmt: skip
    results = simulate(path, stop=1.0, step=0.01, parameters=sizes | values)
    y = results["s.y"]
    assert y.shape == (101, 4)
    # the Euler method with 1 ms: an error of half a millisecond times the second derivative, 1, and as much again
    np.testing.assert_allclose(y[-1, 0], np.cos(1.0), atol=1e-3)
    np.testing.assert_array_equal(y[:, 2], 2 * y[:, 0])
    np.testing.assert_array_equal(y[:, 3], y[:, 0] + y[:, 1])
    with pytest.raises(UsageError, match=r"'s.A': expected one value, or 4 for A\[1,1\] to A\[2,2\], got 9"):
        simulate(path, stop=0.1, step=0.1, parameters=sizes | {"s.A": [0.0] * 9})


def test_the_start_of_a_run_plans_the_transfer_of_a_whole_array_once(system, monkeypatch):
    planned: list[str] = []

    class Counted(Transfer):
        """Notes what is planned."""

        def __init__(self, verb, variables, *rest):
            planned.append(verb)
            super().__init__(verb, variables, *rest)

    monkeypatch.setattr(instance, "Transfer", Counted)
    simulate(system({name: (models.STATE_SPACE, "3.0") for name in "ab"}, ["a.y[1] -> b.u[1]"]), stop=0.2, step=0.1)
    assert planned.count("Get") == 3  # the value of the connection, and the outputs of each
