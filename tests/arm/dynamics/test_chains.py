"""The functions of a long arm call the functions of its joints, with the values and derivatives of the whole trace."""

import dataclasses
from functools import cache

import numpy as np
import pytest

from benchmarks.chains import repeated_link
from tests.compiler.native.compiled import results_of
from tests.conftest import heavy
from vdfmu.arm.robot import load_robot
from vdfmu.arm.units import find_unit
from vdfmu.compiler.c.functions import c_texts, operations_of
from vdfmu.compiler.functions.derivatives import DIRECTIONS, derivative
from vdfmu.compiler.unit.program import Program, UnitFunctions


def unlike(n):
    """Return an arm whose joints are of two kinds, with coupled rotors, a payload, a moving base and a load."""
    robot = dataclasses.replace(
        repeated_link(n), joint_types=("revolute", "prismatic", "revolute") * (n // 3), rotor_coupling=True,
        moving_base=True, coupled_tool=True,
    )  # fmt: skip
    return robot.unfolded().with_parameters(payload_mass=0.7, payload_centroid=[0.1, 0.2, -0.1])


ARMS = {"equal": lambda: repeated_link(10), "unlike": lambda: unlike(9), "snake": lambda: load_robot("snake_24dof")}
NAMES = (
    "plant_start_equilibrium", "plant_outputs", "plant_derivatives", "feedforward_outputs_inverse",
    "feedforward_outputs_vdc",
)  # fmt: skip


@cache
def pair(arm, name):
    """Return a function of calls and the function of one trace, and arguments."""
    unit, robot = find_unit(name.split("_")[0]), ARMS[arm]()
    calls = UnitFunctions(unit, robot, cache=None).casadi_function(name)
    whole = type("Short", (unit,), {"chain": None})
    functions = UnitFunctions(whole, robot, cache=None)
    (called,) = (call.function for call in Program(functions).calls if call.function.endswith(name.split("_", 1)[1]))
    trace = functions.casadi_function(called)
    rng = np.random.default_rng(4)
    arguments = [rng.uniform(-0.5, 0.5, trace.numel_in(i)) for i in range(trace.n_in())]
    if "p" in trace.name_in():
        arguments[trace.index_in("p")] = robot.values()
    return calls, trace, arguments


def steps(arm):
    """Return the step of a plant by calls, and by one trace."""
    plant, robot = find_unit("plant"), ARMS[arm]()
    whole = type("Short", (plant,), {"chain": None})
    return tuple(UnitFunctions(unit, robot, cache=None).casadi_function(f"{name}_step") for unit, name in (
        (plant, "plant"), (whole, "short"),
    ))  # fmt: skip


def flat(results):
    return np.concatenate([result.full().ravel() for result in results])


@pytest.mark.parametrize("arm", ["unlike", *heavy("equal", "snake")])
@pytest.mark.parametrize("name", ["plant_start_equilibrium", *heavy(*NAMES[1:])])
def test_calls_have_the_values_of_the_trace(arm, name):
    calls, trace, arguments = pair(arm, name)
    assert calls.name_in() == trace.name_in() and calls.name_out() == trace.name_out()
    assert not calls.is_a("SXFunction")
    expected = flat(trace.call(arguments))
    # some hundred roundings, in another order where a sum has terms that two joints share
    np.testing.assert_allclose(flat(calls.call(arguments)), expected, rtol=0, atol=1e-13 * np.abs(expected).max())


@pytest.mark.few(2)
@pytest.mark.parametrize("ending", ["", *DIRECTIONS])
@pytest.mark.parametrize("name", ["plant_start_equilibrium", *heavy("plant_outputs", "plant_derivatives", NAMES[4])])
@pytest.mark.parametrize("arm", ["unlike", *heavy("equal")])
def test_their_c_has_the_values_and_derivatives_of_the_trace(arm, name, ending, tmp_path):
    calls, trace, arguments = pair(arm, name)
    if ending:
        calls, trace = derivative(calls, ending), derivative(trace, ending)
        assert calls.name_in() == trace.name_in() and calls.name_out() == trace.name_out()
        rng = np.random.default_rng(5)
        arguments = [
            *arguments,
            *(rng.uniform(-1.0, 1.0, trace.numel_in(i)) for i in range(len(arguments), trace.n_in())),
        ]
    expected = flat(trace.call(arguments))
    actual = results_of("\n".join(c_texts(calls)), calls, arguments, tmp_path)
    np.testing.assert_allclose(actual, expected, rtol=0, atol=1e-12 * np.abs(expected).max())


@pytest.mark.heavy
@pytest.mark.parametrize("arm", ARMS)
def test_the_step_of_calls_is_the_step_of_the_trace(arm, tmp_path):
    calls, whole = steps(arm)
    assert calls.name_in() == whole.name_in()
    rng = np.random.default_rng(6)
    arguments = {name: rng.uniform(-0.5, 0.5, calls.numel_in(name)) for name in calls.name_in()}
    arguments |= {"p": ARMS[arm]().values(), "h": np.array([1e-4]), "tolerance": np.array([1e-7])}
    if "R_S" in arguments:
        half = rng.uniform(-1.0, 1.0, (6, 6))
        arguments |= {"R_S": np.eye(3).ravel(), "M_e": (half @ half.T).ravel(), "rate_M_e": np.zeros(36)}
    expected = whole.call(list(arguments.values()))
    compiled = results_of("\n".join(c_texts(calls)), calls, list(arguments.values()), tmp_path)
    m = len(arguments["x"])
    called = [result.full().ravel() for result in calls.call(list(arguments.values()))]
    for x_new, _, ratio in (called, np.split(compiled, [m, m + 1])):
        moved = np.abs(expected[0].full().ravel() - arguments["x"]).max()
        # some thousand roundings of the elimination
        np.testing.assert_allclose(x_new, expected[0].full().ravel(), rtol=0, atol=1e-12 * (moved + 1.0))
        # the error is the difference of two solutions
        wanted = expected[2].full().ravel()
        np.testing.assert_allclose(ratio, wanted, rtol=0, atol=1e-8 * np.abs(wanted).max() + 1e-12 / 1e-7)


def test_equal_joints_share_their_functions():
    functions = {
        n: UnitFunctions(find_unit("plant"), repeated_link(n), cache=None).casadi_function("plant_derivatives")
        for n in (10, 20)
    }
    few, many = ([each.name() for each in function.find_functions(0)] for function in functions.values())
    assert few == many
    few, many = (len("\n".join(c_texts(function))) for function in functions.values())
    assert many - few < 10 * 2_000  # three calls a joint


def test_their_calls_can_be_written_out():
    calls, _, _ = pair("equal", "plant_start_equilibrium")
    assert len(operations_of(calls)) > 10 * calls.n_instructions()
