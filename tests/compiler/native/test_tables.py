"""Tables of operations have the derivatives of the functions."""

from functools import partial

import casadi as ca
import numpy as np
import pytest

from tests.compiler.native.compiled import derivatives, results_of
from vdfmu.compiler.c.operations import c_derivatives, has_table
from vdfmu.compiler.c.text import EXPRESSIONS, slopes
from vdfmu.compiler.functions.derivatives import DIRECTIONS, derivative
from vdfmu.compiler.scalar.symbol import lookup_function

N = 4


@pytest.mark.parametrize("operation", EXPRESSIONS)
def test_slopes_are_those_of_the_operation(operation, tmp_path):
    two = len(slopes(operation)) == 2
    x, y = ca.SX.sym("x", N), ca.SX.sym("y", N)
    rows = [ca.SX.binary(operation, x[i], y[i]) if two else ca.SX.unary(operation, x[i] + y[i]) for i in range(N)]
    function = ca.Function("rows", [x, y], [ca.vertcat(*rows)], ["x", "y"], ["z"])
    for direction in DIRECTIONS:
        low = 1.1 if operation == ca.OP_ACOSH else 0.05
        random = partial(np.random.default_rng(operation).uniform, low, low + 0.4)
        actual, expected = derivatives(function, direction, random, tmp_path)
        np.testing.assert_allclose(actual, expected, rtol=1e-12, atol=1e-14)


def test_a_branch_that_is_not_taken_has_no_slope_where_its_own_is_infinite(tmp_path):
    x = ca.SX.sym("x")
    root = ca.Function("root", [x], [ca.if_else(x > 0.0, ca.sqrt(x), 3.0 * x)], ["x"], ["y"])
    text = f'#include "operations.h"\n{c_derivatives(root)}'
    for direction in DIRECTIONS:
        inputs = [np.array([0.0]), np.array([2.0])]
        assert results_of(text, derivative(root, direction), inputs, tmp_path, direction) == 6.0


def test_functions_without_a_line_for_each_operation_have_no_table():
    x = ca.SX.sym("x")
    assert has_table(ca.Function("root", [x], [ca.sqrt(x) + 2.0]))
    assert not has_table(ca.Function("erf", [x], [ca.erf(x)]))
    row = lookup_function(np.array([0.0, 1.0, 2.0]), np.array([[1.5], [3.0]]))(x)
    assert not has_table(ca.Function("looked_up", [x], [row]))
