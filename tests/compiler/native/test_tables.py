"""Tables of operations have the derivatives of the functions."""

import casadi as ca
import numpy as np

from tests.compiler.native.compiled import both_derivatives, called
from vdfmu.compiler.c.operations import has_table
from vdfmu.compiler.c.text import EXPRESSIONS, slopes
from vdfmu.compiler.scalar.symbol import lookup_function

N = 4


def function_of(operation):
    two = len(slopes(operation)) == 2
    x, y = ca.SX.sym("x", N), ca.SX.sym("y", N)
    rows = [ca.SX.binary(operation, x[i], y[i]) if two else ca.SX.unary(operation, x[i] + y[i]) for i in range(N)]
    return ca.Function(f"rows_{operation}", [x, y], [ca.vertcat(*rows)], ["x", "y"], ["z"])


def test_slopes_are_those_of_the_operation(tmp_path):
    traced, library = both_derivatives([function_of(operation) for operation in EXPRESSIONS], tmp_path)
    for operation, pair in zip(EXPRESSIONS, traced, strict=True):
        low = 1.1 if operation == ca.OP_ACOSH else 0.05
        for function in pair:
            random = np.random.default_rng(operation)
            inputs = [random.uniform(low, low + 0.4, function.numel_in(i)) for i in range(function.n_in())]
            expected = np.concatenate([each.full().ravel() for each in function.call(inputs)])
            actual = called(library, function, inputs)
            np.testing.assert_allclose(actual, expected, rtol=1e-12, atol=1e-14, err_msg=function.name())


def test_a_branch_that_is_not_taken_has_no_slope_where_its_own_is_infinite(tmp_path):
    x = ca.SX.sym("x")
    root = ca.Function("root", [x], [ca.if_else(x > 0.0, ca.sqrt(x), 3.0 * x)], ["x"], ["y"])
    (pair,), library = both_derivatives([root], tmp_path)
    for function in pair:
        assert called(library, function, [np.array([0.0]), np.array([2.0])]) == 6.0


def test_functions_without_a_line_for_each_operation_have_no_table():
    x = ca.SX.sym("x")
    assert has_table(ca.Function("root", [x], [ca.sqrt(x) + 2.0]))
    assert not has_table(ca.Function("erf", [x], [ca.erf(x)]))
    row = lookup_function(np.array([0.0, 1.0, 2.0]), np.array([[1.5], [3.0]]))(x)
    assert not has_table(ca.Function("looked_up", [x], [row]))
