"""What components can tell beyond their outputs, in the coupling of two masses with a solution in closed form."""

import numpy as np
import pytest
from scipy.linalg import expm

from tests.conftest import heavy
from tests.engine.reference.masses import HELD, JACOBIAN, MASS, RATES, STRAIGHT, UPDATES, WIRES
from vdfmu.engine.run import simulate

SOFT = {
    "a": {"m": 1.0, "k": 4.0, "b": 0.1, "c": 3.0, "d": 0.2},
    "b": {"m": 0.5, "k": 1.0, "b": 0.1, "c": 3.0, "d": 0.2},
}
# b is light and heavily damped: it follows a within 1 ms, a tenth of the step or less
STIFF = {
    "a": {"m": 1.0, "k": 4.0, "b": 0.1, "c": 3.0, "d": 0.0},
    "b": {"m": 1e-3, "k": 1.0, "b": 2.0, "c": 3e3, "d": 0.0, "x": 3e3 / 3001},
}


def solution(values, t):
    A = np.zeros((4, 4))
    for first, second, p in ((0, 2, values["a"]), (2, 0, values["b"])):
        A[first, first + 1] = 1.0
        A[first + 1, first] = -(p["k"] + p["c"]) / p["m"]
        A[first + 1, first + 1] = -(p["b"] + p["d"]) / p["m"]
        A[first + 1, second], A[first + 1, second + 1] = p["c"] / p["m"], p["d"] / p["m"]
    return np.array([expm(A * time) @ [1.0, 0.0, values["b"].get("x", 0.0), 0.0] for time in t])


def run(system, model, version, values, **options):
    parameters = {f"{name}.{p}": x for name, numbers in values.items() for p, x in numbers.items()} | {"a.x": 1.0}
    path = system({"a": (model, version), "b": (model, version)}, WIRES)
    results = simulate(path, parameters=parameters, **options)
    motion = np.column_stack([results[name] for name in ("a.x", "a.v", "b.x", "b.v")])
    return np.abs(motion - solution(values, results.time)).max(), results


@pytest.mark.heavy
@pytest.mark.parametrize("version", ["2.0", "3.0"])
def test_derivatives_of_outputs_halve_the_error_of_the_prediction(system, version):
    """A line through the last two values of y is off by h^2 y'', one with the slope at the last by half of that."""
    for h in (0.04, 0.02, 0.01):
        plain, with_rates = (
            run(system, model, version, SOFT, stop=4.0, step=h, algorithm="extrapolated")[0] for model in (MASS, RATES)
        )
        # a part of the error comes from the inputs that hold, and a term of the next order is h of it: 0.52, 0.52, 0.51
        assert 0.45 < with_rates / plain < 0.55


@pytest.mark.few(2)
@pytest.mark.parametrize("algorithm", ["extrapolated", *heavy("iterative")])
@pytest.mark.parametrize(
    ("model", "version"), [(MASS, "3.0"), (RATES, "2.0"), (RATES, "3.0"), (STRAIGHT, "3.0"), (JACOBIAN, "3.0")]
)
def test_the_coupling_is_of_second_order(system, model, version, algorithm):
    steps = np.array([0.08, 0.04, 0.02, 0.01])
    errors = [run(system, model, version, SOFT, stop=4.0, step=h, algorithm=algorithm, isolate=False)[0] for h in steps]
    order = np.polyfit(np.log(steps), np.log(errors), 1)[0]
    assert 1.9 < order < 2.1  # 2, except for terms of the next order, some h of the error


@pytest.mark.heavy
@pytest.mark.parametrize("version", ["2.0", "3.0"])
def test_directional_derivatives_save_repetitions(system, version):
    """With the exact Jacobian of a linear loop the first repetition solves it, where it is to be learnt else."""
    runs = [run(system, model, version, SOFT, stop=4.0, step=0.1, algorithm="iterative") for model in (MASS, JACOBIAN)]
    (plain, _), (exact, results) = runs
    plain_steps, steps = (r.summary["communication"]["unit_steps"] for _, r in runs)
    assert steps == 40 * 2 * 2  # two sweeps over two units
    assert plain_steps > 1.3 * steps
    # both are the solution of the same equations, to 1e-8 in each of 40 steps
    np.testing.assert_allclose(exact, plain, rtol=0, atol=40 * 1e-8)
    assert results.summary["communication"]["convergence"] == 1e-8


@pytest.mark.heavy
@pytest.mark.parametrize("algorithm", ["extrapolated", "iterative"])
def test_intermediate_updates_let_a_fast_component_follow(system, algorithm):
    """With an input that holds it ends where that was at the middle of the step: h / 2 late."""
    for h in (0.04, 0.02):
        lag, rest = (
            np.abs(results["b.x"] - solution(STIFF, results.time)[:, 2]).max()
            for results in (
                run(system, model, "3.0", STIFF, stop=4.0, step=h, algorithm=algorithm)[1] for model in (HELD, UPDATES)
            )
        )  # fmt: skip
        # x of b is about cos(2 t): h / 2 late that is h at most, less for the damping, and a part of it moves a, too
        assert 0.5 * h < lag < 3 * h
        assert rest < 0.1 * lag  # of second order
