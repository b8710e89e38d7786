"""Units of linear systems, CasADi functions and tables against scipy, CasADi and numpy."""

import casadi as ca
import numpy as np
import pytest
from scipy import signal
from scipy.integrate import solve_ivp

from vdfmu.arm.units import find_unit
from vdfmu.base.errors import UnitError, UsageError
from vdfmu.compiler.unit.interface import Interface
from vdfmu.extras.models import casadi_unit, linear_unit, table_unit

A, B = np.array([[-0.2, -4.0], [1.0, 0.0]]), np.array([[1.0, 0.5], [0.0, 1.0]])
C, D = np.array([[0.0, 1.0], [1.0, 1.0], [0.5, 0.0]]), np.array([[0.0, 0.0], [0.1, 0.0], [0.0, 2.0]])
HELD = ([[0.9, 0.1], [0.0, 0.8]], [[0.0], [1.0]], [[1.0, 0.0]], [[0.5]], 0.01)
x, u, p = ca.SX.sym("x", 2), ca.SX.sym("u"), ca.SX.sym("p")
ODE = ca.vertcat(x[1], u - p * ca.sin(x[0]))
PENDULUM = ca.Function("pendulum", [x, u, p], [ODE, x[0] ** 2], ["x", "u", "p"], ["ode", "y"])


a, b = ca.MX.sym("a", 2, 3), ca.MX.sym("b")
MAPS = ca.Function("maps", [a, b], [b * (a[:, ::-1].T @ ca.DM([1, 2])), a @ a.T], ["a", "b"], ["s", "w"])


def test_a_linear_system_has_the_response_of_scipy():
    unit = linear_unit(A, B, C, D)(x_0=[0.3, -0.1])
    results = unit.simulate({"u": lambda t: np.array([np.sin(t), 1.0])}, stop=2.0, step=1e-2, tolerance=1e-10)
    u = np.column_stack([np.sin(results.t), np.ones_like(results.t)])
    # lsim takes lines between the samples: the error of sin is 1e-4 / 8 of its amplitude, and the gain below 2
    assert np.abs(results["y"] - signal.lsim((A, B, C, D), u, results.t, [0.3, -0.1])[1]).max() < 2.5e-5
    model = unit.linearize()
    assert (model.A == A).all() and (model.B == B).all() and (model.C[2:] == C).all() and (model.D[2:] == D).all()


@pytest.mark.parametrize("system", [(A / 5, B, C, D, 0.5), HELD])
def test_a_discrete_system_gives_the_output_of_each_sample(system):
    unit, dt = linear_unit(*system)(), system[4]
    inputs, outputs = np.random.default_rng(1).normal(size=(20, np.shape(system[1])[1])), []
    unit.start()
    for unit.u in inputs:
        unit.update()
        outputs.append(unit.y)
    # 20 sums of few terms of about 1
    assert np.abs(outputs - signal.dlsim(system, inputs)[1]).max() < 1e-12
    with pytest.raises(UsageError, match="period"):
        type(unit)(period=2 * dt).simulate(stop=2 * dt, step=dt)


def test_a_casadi_function_is_a_unit_with_its_states_and_matrices_in_their_places():
    unit = casadi_unit(PENDULUM)(x_0=[1.0, 0.0], p=9.81)
    results = unit.simulate({"u": 0.2}, stop=1.0, tolerance=1e-12)
    end = solve_ivp(
        lambda t, x: PENDULUM(x, 0.2, 9.81)[0].full()[:, 0], (0.0, 1.0), [1.0, 0.0], "DOP853", rtol=1e-12, atol=1e-12
    ).y[:, -1]
    # 1e-12 in each of 1000 steps, and errors grow by exp(3.1) at most
    assert np.abs(results["x"][-1] - end).max() < 3e-8
    assert (results["y"] == results["x"][:, 0] ** 2).all()
    a = np.random.default_rng(2).normal(size=(2, 3))
    unit = casadi_unit(MAPS)(a=a, b=2.0)
    unit.outputs()
    # rounding of sums of three products of about 1
    assert np.abs(unit.s - 2.0 * a[:, ::-1].T @ [1, 2]).max() < 1e-14 and np.abs(unit.w - a @ a.T).max() < 1e-14


@pytest.mark.parametrize("first", ["time", "x"])
def test_a_table_is_linear_between_its_points(tmp_path, first):
    rows = np.column_stack([np.linspace(0.0, 3.0, 40) ** 2, np.random.default_rng(3).normal(size=(40, 2))])
    head = f"{first},q,w\ns,rad,rad/s"
    np.savetxt(tmp_path / "data.csv", rows, delimiter=",", header=head, comments="", fmt="%.17g")
    columns = dict(zip((f"{first} [s]", "q [rad]", "w[rad/s]"), rows.T, strict=True))
    for unit in (table_unit(tmp_path / "data.csv"), table_unit(columns)):
        results = unit().simulate({} if first == "time" else {"x": lambda t: t}, stop=10.0, step=0.1)
        assert [unit.declared[name].unit for name in "qw"] == ["rad", "rad/s"]
        for name, column in (("q", rows[:, 1]), ("w", rows[:, 2])):
            # slopes up to 1e3, between points as near as 0.006, and two roundings of numbers below 4 in each
            assert np.abs(results[name] - np.interp(results.t, rows[:, 0], column)).max() < 1e-13


d, q = ca.SX.sym("d", ca.Sparsity.diag(2)), ca.MX.sym("q")
ROOT = ca.rootfinder("r", "newton", {"x": u, "g": u**2 - 2})(x0=q)["x"]


@pytest.mark.parametrize(("make", "match"), [
    (lambda: linear_unit(A, np.ones((3, 1)), C, D), r"B must have shape \(2, 2\), .*got \(3, 1\)"),
    (lambda: linear_unit(A, B, np.full((3, 2), np.nan), D), "C must hold finite real numbers"),
    (lambda: linear_unit(A * 1j, B, C, D), "A must hold finite real numbers"),
    (lambda: linear_unit([], [], [], []), "must have an input and an output"),
    (lambda: linear_unit(A, B, C, D, -1.0), "dt must be the time between samples in s, .*got -1"),
    (lambda: casadi_unit(ca.Function("f", [x], [x[0]], ["x"], ["ode"])), r"shape of x, \(2, 1\), got \(1, 1\)"),
    (lambda: casadi_unit(ca.Function("f", [d], [ca.sum1(d)], ["u"], ["y"])), "u must be dense, .*sparse"),
    (lambda: casadi_unit(ca.Function("f", [x, u], [x, u], ["x", "z"], ["ode", "alg"])), "must not have .* alg"),
    (lambda: casadi_unit(ca.Function("f", [q], [ROOT], ["q"], ["y"])), "must use only scalar operations"),
    (lambda: table_unit({"a": [1, 2]}), "must have names, and two columns"),
    (lambda: table_unit({"a": [1, 2], "b": [1, np.nan]}), "rows of finite numbers"),
    (lambda: table_unit({"a": [1, 0], "b": [2, 3]}), "Column a must increase"),
    (lambda: table_unit({"a": [1, 2], "b b": [2, 3], "b_b": [2, 3]}), "b_b must be one column"),
    (lambda: table_unit({"a": [1, 2], "outputs": [2, 3]}), "cannot be called outputs"),
    (lambda: table_unit({"a": [1, 2], "b [furlong]": [2, 3]}), "expected a unit of measurement"),
])  # fmt: skip
def test_a_factory_refuses_what_is_no_unit(make, match):
    with pytest.raises((UsageError, UnitError), match=match):
        make()


@pytest.mark.parametrize(("content", "match"), [
    ("", "must have names"), ("a,b\n1,2\n", "two rows"),
    ("a,1b\n1,2\n2,3\n", "a variable cannot be called 1b"),
    ("a,b\n1,2\n3,x\n", "Row 3: b: expected a number, got 'x'"),
])  # fmt: skip
def test_a_bad_table_is_refused(tmp_path, content, match):
    (tmp_path / "table.csv").write_text(content)
    with pytest.raises((UsageError, UnitError), match=match):
        table_unit(tmp_path / "table.csv")


def test_two_units_of_one_name_are_refused(tmp_path):
    linear, table = "linear_unit([], [], [], [k])", "table_unit({'t': [0, 1], 'y': [1, k]})"
    for name, expression in (("LinearUnit", linear), ("TableUnit", table)):
        (tmp_path / "two.py").write_text(f"from vdfmu.extras.models import *\na, b = ({expression} for k in (2, 3))\n")
        with pytest.raises(UnitError, match=rf"two\.py: {name} must be the name of one unit, got two"):
            find_unit(str(tmp_path / "two.py"))


def test_a_table_may_have_decimal_commas_and_empty_lines(tmp_path):
    (tmp_path / "table.csv").write_text('Time [s];b\n0;1,5\n\n1;"2,5"\n')
    results = table_unit(tmp_path / "table.csv")().simulate(stop=1.0, step=0.5)
    assert results["b"].tolist() == [1.5, 2.0, 2.5]


def test_linear_systems_keep_a_jacobian_of_numbers():
    """A large matrix of states is no call, because each step would calculate its Jacobian again."""
    unit = linear_unit(-np.eye(48), np.ones((48, 1)), np.ones((1, 48)), [[0.0]])
    functions = Interface(unit, None).functions
    assert not functions.casadi_function(f"{functions.name}_derivatives").find_functions(0)
    assert functions.casadi_function(f"{functions.name}_jacobian").n_instructions() < 48 * 48 * 3
