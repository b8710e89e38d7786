"""Directional and adjoint derivatives of the traced functions, and the C text of traced functions."""

import casadi as ca
import numpy as np
import pytest

from tests.compiler.native.compiled import results_of
from vdfmu.base.errors import KernelError
from vdfmu.compiler.c.functions import c_texts
from vdfmu.compiler.c.operations import c_derivatives
from vdfmu.compiler.functions.derivatives import DIRECTIONS, derivative
from vdfmu.compiler.scalar.symbol import lookup_function
from vdfmu.compiler.unit.evaluate import traced_margins

NAMES = (
    "trajectory_outputs", "feedforward_outputs_inverse", "feedforward_outputs_vdc", "controller_outputs_kappa_dot",
    "plant_start_equilibrium", "plant_outputs", "plant_derivatives",
)  # fmt: skip


def nominal(function, p, rng):
    arguments = {name: rng.uniform(0.2, 0.9, function.size1_in(name)) for name in function.name_in()}
    if "T" in arguments:
        arguments |= {"t": np.array([3.0]), "T": np.array([10.0]), "t_start": np.array([0.0])}
    if "h" in arguments:  # a step of 0.5 s would enlarge roundings by 10^6 and more
        arguments["h"] = np.array([1e-3])
    if "tau_max" in arguments:
        arguments["tau_max"] += 1e6
    if "p" in arguments:
        arguments["p"] = p
    return list(arguments.values())


def flat(columns):
    return np.concatenate([np.ravel(c.full()) for c in (columns if isinstance(columns, tuple) else (columns,))])


@pytest.mark.few(6)
@pytest.mark.parametrize("name", NAMES)
def test_forward_is_the_slope_along_the_direction(robot, functions_of, name):
    functions, rng = functions_of(name.split("_")[0], robot), np.random.default_rng(75)
    function, forward = functions.casadi_function(name), functions.casadi_function(f"{name}_forward")
    assert forward.name_in() == [*function.name_in(), *(f"d_{a}" for a in function.name_in())]
    assert forward.name_out() == [f"d_{r}" for r in function.name_out()]
    start = nominal(function, robot.values(), rng)
    direction = [rng.uniform(-1.0, 1.0, a.shape) * np.maximum(np.abs(a), 1e-3) for a in start]
    tangent = flat(forward(*start, *direction))

    def slope(step):
        ahead, behind = ([a + s * d for a, d in zip(start, direction, strict=True)] for s in (step, -step))
        return (flat(function(*ahead)) - flat(function(*behind))) / (2 * step)

    # Richardson's extrapolation of central differences: error of order step^4 + rounding / step.
    difference = (4.0 * slope(5e-5) - slope(1e-4)) / 3.0
    scale = np.abs(flat(function(*start))).max() + np.abs(tangent).max()
    np.testing.assert_allclose(tangent, difference, rtol=0, atol=1e-9 * scale)


@pytest.mark.few(3)
@pytest.mark.parametrize(
    "name",
    ["plant_derivatives", "feedforward_outputs_vdc", "trajectory_outputs", "controller_outputs_mixed", "margins"],
)
def test_c_text_computes_what_the_trace_computes(robot, functions_of, name, tmp_path):
    if name == "margins":
        (function,) = traced_margins(robot)
    else:
        function = functions_of(name.split("_")[0], robot).casadi_function(name)
    check_c_text("\n".join(c_texts(function)), function, robot.values(), tmp_path)


@pytest.mark.few(4)
@pytest.mark.parametrize("name", ["plant_derivatives", "feedforward_outputs_vdc"])
@pytest.mark.parametrize("ending", DIRECTIONS)
def test_a_table_of_operations_has_the_derivatives_of_the_trace(robot, functions_of, name, ending, tmp_path):
    functions = functions_of(name.split("_")[0], robot)
    text = f'#include "operations.h"\n{c_derivatives(functions.casadi_function(name))}'
    check_c_text(text, functions.casadi_function(f"{name}_{ending}"), robot.values(), tmp_path)


def check_c_text(text, function, p, tmp_path):
    rng = np.random.default_rng(77)
    arguments = [np.ascontiguousarray(a) for a in nominal(function, p, rng)]
    expected = flat(function(*arguments))
    # The same operations. Elementary functions differ in the last bits, and a table adds in another order.
    np.testing.assert_allclose(
        results_of(text, function, arguments, tmp_path), expected, rtol=0, atol=1e-12 * np.abs(expected).max()
    )


@pytest.mark.parametrize("ending", ["", "_forward", "_reverse"])
def test_c_text_looks_rows_up(ending, tmp_path):
    """Both numbers of a row, of which one may overwrite the place that was looked up; a row has no derivative."""
    x = ca.SX.sym("x", 2)
    row = lookup_function(np.array([0.0, 1.0, 2.0]), np.array([[1.5, -2.0], [3.0, 5.0]]))(x[0] * x[1])
    function = ca.Function("looked_up", [x], [ca.vertcat(row[0] + x[1], row[1] * x[1])], ["x"], ["y"])
    function = derivative(function, ending.removeprefix("_")) if ending else function
    assert ca.OP_CALL in {function.instruction_id(k) for k in range(function.n_instructions())}
    for place in (0.4, 1.3):
        arguments = [np.array([place, 1.1]), np.array([0.3, 0.7])][: function.n_in()]
        actual = results_of("\n".join(c_texts(function)), function, arguments, tmp_path, f"at_{place:.0f}{ending}")
        np.testing.assert_array_equal(actual, flat(function(*arguments)))


def test_an_operation_without_c_text_is_refused():
    x = ca.SX.sym("x")
    with pytest.raises(KernelError, match="erf: CasADi's operation OP_ERF cannot be written in C"):
        c_texts(ca.Function("erf", [x], [ca.erf(x)]))
