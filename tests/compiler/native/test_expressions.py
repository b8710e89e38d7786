"""Operations that are written into the expressions of others."""

import casadi as ca
import numpy as np

from vdfmu.compiler.c.functions import c_texts, operations_of
from vdfmu.compiler.c.grouping import short_lines
from vdfmu.compiler.c.loaded import compiled_rows


def traced() -> ca.Function:
    """Return a function with values that are read once and twice, and with negative numbers and nested functions."""
    x = ca.SX.sym("x", 3)
    once, twice = x[0] - (x[1] - x[2]), x[0] * x[1] + x[2]
    results = [
        once * twice,
        -(twice * twice) / (x[1] - (-3.5)),
        ca.fmin(ca.sqrt(ca.fabs(once / twice)), -0.25) - (-x[2]),
        ca.if_else(ca.logic_and(x[0] < x[1], x[2] > -1.0), once, twice) * 2.0,
    ]
    return ca.Function("nested", [x], [ca.vertcat(*results)], ["x"], ["y"])


def test_results_are_bit_identical_to_those_of_the_trace():
    function = traced()
    points = np.random.default_rng(5).normal(size=(50, 3))
    rows = np.empty((50, 4))
    evaluate = compiled_rows(function)
    assert evaluate is not None
    evaluate([points], rows)
    assert np.array_equal(rows, [function(point).full().ravel() for point in points])


def test_a_value_has_a_name_only_if_it_is_read_twice_or_by_a_function_of_a_number():
    lines = short_lines(operations_of(traced()))
    named = [operation for operation in lines if operation.writes]
    assert len(named) < len(lines) < len(operations_of(traced())) / 3
    (text,) = c_texts(traced())
    assert "x[0] - (x[1] - x[2])" in text
    assert "fmin(" in text and ", -0.25)" not in text  # the fmin of vectors takes no number
