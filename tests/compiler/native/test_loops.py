"""Long traces become loops over what repeats in them, with the same bits."""

from functools import partial

import casadi as ca
import numpy as np
import pytest

from tests.compiler.native.loops import check_bits, check_derivatives, derivatives, results_of
from tests.conftest import heavy
from vdfmu.compiler.c.counterparts import Trace
from vdfmu.compiler.c.loop_text import c_loops
from vdfmu.compiler.c.loops import Loops, find_loops, straight
from vdfmu.compiler.c.operations import c_derivatives
from vdfmu.compiler.c.series import find_series
from vdfmu.compiler.c.text import EXPRESSIONS, slopes
from vdfmu.compiler.functions.derivatives import DIRECTIONS, derivative

N = 24


def recursion(n=N, seed=None):
    """Return a chain that is calculated up, down, and up; with a seed some of its joints are unlike the others."""
    rng = np.random.default_rng(seed)
    odd = set(rng.choice(n, 4, replace=False).tolist()) if seed is not None else set()
    x, p, g = ca.SX.sym("x", 2 * n), ca.SX.sym("p", 3 * n + 1), ca.SX.sym("g")
    up, down, last = [], [ca.SX(0)] * n, []
    kinds = rng.integers(0, 4, (n, 3))
    for i in range(n):
        base = up[-1] if i else g
        value = ca.sin(x[i]) * base + p[3 * i] * x[n + i]
        if i in odd and kinds[i, 0]:
            value = (base + p[3 * i + 1]) / (2.0 + x[i] ** 2) if kinds[i, 0] > 1 else value - up[i // 2] if i else value
        up.append(value)
    for i in reversed(range(n)):
        tip = down[i + 1] if i + 1 < n else p[3 * n]
        value = up[i] * p[3 * i + 1] + tip * ca.cos(x[i]) + (up[i - 1] if i else 0.0)
        if i in odd and kinds[i, 1]:
            value = ca.fmax(value, tip) if kinds[i, 1] > 1 else -value * up[-1]
        down[i] = value
    for i in range(n):
        value = (last[-1] if i else 0.0) + down[i] / (1.0 + up[i] ** 2) - 0.5 * p[3 * i + 2]
        if i in odd and kinds[i, 2] > 1:
            value = value * down[(i * 7) % n]
        last.append(value)
    results = [ca.vertcat(*last, *down), ca.vertcat(*up)]
    return ca.Function("chain", [x, p, g], results, ["x", "p", "g"], ["y", "u"])


def test_a_recursion_up_and_down_is_as_many_loops_whose_text_does_not_grow_with_the_joints(tmp_path):
    text = check_bits(chain := recursion(), find_loops(chain, N), tmp_path)
    assert text.count("for (int i") == 3
    assert text.count("i++") == 2 and text.count("i--") == 1
    short, long = (find_loops(recursion(n), n) for n in (12, 200))
    for text in (c_loops, c_derivatives):
        assert len(text(long)) < 1.1 * len(text(short))  # more digits


@pytest.mark.parametrize("seed", [*range(12), *heavy(*range(100, 116))])
def test_joints_that_are_unlike_the_others_keep_their_operations(seed, tmp_path):
    chain = recursion(seed=seed)
    loops = find_loops(chain, N)
    check_bits(chain, loops, tmp_path)
    check_derivatives(chain, loops, tmp_path)


@pytest.mark.parametrize("operation", EXPRESSIONS)
def test_slopes_are_those_of_the_operation(operation, tmp_path):
    two = len(slopes(operation)) == 2
    x, y = ca.SX.sym("x", N), ca.SX.sym("y", N)
    rows = [ca.SX.binary(operation, x[i], y[i]) if two else ca.SX.unary(operation, x[i] + y[i]) for i in range(N)]
    function = ca.Function("rows", [x, y], [ca.vertcat(*rows)], ["x", "y"], ["z"])
    loops = Loops(find_series(trace := Trace(function), N, 1, trace.digests(0)))
    for direction in DIRECTIONS:
        low = 1.1 if operation == ca.OP_ACOSH else 0.05
        random = partial(np.random.default_rng(operation).uniform, low, low + 0.4)
        actual, expected = derivatives(function, loops, direction, random, tmp_path)
        np.testing.assert_allclose(actual, expected, rtol=1e-12, atol=1e-14)


def test_arguments_may_be_called_as_what_loops_count_with(tmp_path):
    i, r = ca.SX.sym("i", N), ca.SX.sym("r", N)
    function = ca.Function("counted", [i, r], [ca.sin(i) * r + ca.cos(r * i)], ["i", "r"], ["z"])
    assert "for (int i" in check_bits(function, find_loops(function, N), tmp_path)


def test_joints_with_nothing_in_common_have_no_loops(tmp_path):
    chain = recursion(9, seed=1)
    check_derivatives(chain, straight(chain), tmp_path)
    assert find_loops(recursion(9), 9) is None
    x = ca.SX.sym("x", N)
    functions = [ca.sin, ca.cos, ca.tan, ca.exp, ca.sqrt, ca.tanh, ca.atan, ca.log1p, ca.sinh, ca.cosh, ca.fabs]
    y = [functions[k % 11](functions[(k + 1 + k // 11) % 11](x[k])) for k in range(N)]
    assert find_loops(ca.Function("unlike", [x], [ca.vertcat(*y)], ["x"], ["y"]), N) is None


def test_a_branch_that_is_not_taken_has_no_slope_where_its_own_is_infinite(tmp_path):
    x = ca.SX.sym("x")
    root = ca.Function("root", [x], [ca.if_else(x > 0.0, ca.sqrt(x), 3.0 * x)], ["x"], ["y"])
    text = f'#include "operations.h"\n{c_derivatives(straight(root))}'
    for direction in DIRECTIONS:
        inputs = [np.array([0.0]), np.array([2.0])]
        assert results_of(text, derivative(root, direction), inputs, tmp_path, direction) == 6.0
