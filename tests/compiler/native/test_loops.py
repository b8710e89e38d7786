"""Long traces become loops over what repeats in them, with the same bits."""

import ctypes
import subprocess
from functools import partial

import casadi as ca
import numpy as np
import pytest

from tests.cc import CC
from tests.conftest import heavy
from vdfmu.compiler.c.counterparts import Trace
from vdfmu.compiler.c.expressions import EXPRESSIONS, c_prototype, slopes
from vdfmu.compiler.c.functions import c_texts
from vdfmu.compiler.c.loop_text import c_loops
from vdfmu.compiler.c.loops import Loops, find_loops, straight
from vdfmu.compiler.c.operations import c_derivatives, c_operations
from vdfmu.compiler.c.series import find_series
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


def results_of(text, function, given, tmp_path, name="kernel", level="-O1"):
    """Compile the C text of a function, without a warning, and return its results for given arguments.

    It is called twice: the second time has what the first has left in memory.
    """
    source, library = tmp_path / f"{name}.c", tmp_path / f"{name}.so"
    source.write_text(f"#include <math.h>\n{c_prototype(function)};\n{text}")
    for file, other in c_operations().items():
        (tmp_path / file).write_text(other)
    sources = [source, *([tmp_path / "operations.c"] if "Operations" in text else [])]
    flags = ["-std=c11", "-Wall", "-Wextra", "-Wpedantic", "-Werror", level, "-ffp-contract=off", "-shared", "-fPIC"]
    subprocess.run([*CC, *flags, "-o", library, *sources, "-lm"], check=True)
    made = [np.full(function.numel_out(i), np.nan) for i in range(function.n_out())]
    arguments = [a.ctypes.data_as(ctypes.c_void_p) for a in (*given, *made)]
    called = ctypes.CDLL(str(library))[function.name()]
    called(*arguments)
    first = np.concatenate(made)
    called(*arguments)
    np.testing.assert_array_equal(np.concatenate(made), first)
    return first


def check_bits(function, loops, tmp_path):
    assert loops is not None
    text = c_loops(loops)
    rng = np.random.default_rng(1)
    given = [rng.uniform(0.5, 1.5, function.numel_in(i)) for i in range(function.n_in())]
    expected = results_of("\n".join(c_texts(function)), function, given, tmp_path, "line", "-O0")
    np.testing.assert_array_equal(results_of(text, function, given, tmp_path, "loops"), expected)
    return text


def derivatives(function, loops, direction, random, tmp_path):
    """Return the results of a derivative at random arguments, of the table and by CasADi."""
    traced = derivative(function, direction)
    given = [random(traced.numel_in(i)) for i in range(traced.n_in())]
    text = f'#include "operations.h"\n{c_derivatives(loops)}'
    found = results_of(text, traced, given, tmp_path, direction)
    return found, np.concatenate([each.full().ravel() for each in traced.call(given)])


def check_derivatives(function, loops, tmp_path):
    """Compare the derivatives of the table with CasADi's, which add the same terms in another order."""
    rng = np.random.default_rng(2)
    for direction in DIRECTIONS:
        found, expected = derivatives(function, loops, direction, partial(rng.uniform, 0.5, 1.5), tmp_path)
        np.testing.assert_allclose(found, expected, rtol=1e-12, atol=1e-12 * np.abs(found).max())


def test_a_recursion_up_and_down_is_as_many_loops(tmp_path):
    text = check_bits(chain := recursion(), find_loops(chain, N), tmp_path)
    assert text.count("for (int i") == 3
    assert text.count("i++") == 2 and text.count("i--") == 1


def test_the_text_does_not_grow_with_the_joints():
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
        found, expected = derivatives(function, loops, direction, random, tmp_path)
        np.testing.assert_allclose(found, expected, rtol=1e-12, atol=1e-14)


def test_a_recursion_whose_end_alone_is_a_result_is_one_loop(tmp_path):
    x = ca.SX.sym("x", N)
    product, total = ca.SX(1.0), ca.SX(0.0)
    for i in range(N):
        product = product * ca.cos(x[i]) - ca.sin(x[i])
        total = total + product**2
    chain = ca.Function("end", [x], [total, product], ["x"], ["y", "z"])
    text = check_bits(chain, find_loops(chain, N), tmp_path)
    assert text.count("for (int i") == 1


def test_arguments_may_be_called_as_what_loops_count_with(tmp_path):
    i, r = ca.SX.sym("i", N), ca.SX.sym("r", N)
    function = ca.Function("counted", [i, r], [ca.sin(i) * r + ca.cos(r * i)], ["i", "r"], ["z"])
    assert "for (int i" in check_bits(function, find_loops(function, N), tmp_path)


def test_every_operation_is_in_one_series():
    trace = Trace(recursion(seed=3))
    layout = find_series(trace, N, 1, trace.digests(0))
    assert layout is not None
    members = [operation for one in layout.series for operation in one.members]
    assert sorted(members) == [k for k in range(len(trace.operations)) if not trace.is_leaf(k)]


def test_a_function_without_loops_has_the_same_table(tmp_path):
    chain = recursion(9, seed=1)
    check_derivatives(chain, straight(chain), tmp_path)


def test_a_branch_that_is_not_taken_has_no_slope_where_its_own_is_infinite(tmp_path):
    x = ca.SX.sym("x")
    root = ca.Function("root", [x], [ca.if_else(x > 0.0, ca.sqrt(x), 3.0 * x)], ["x"], ["y"])
    text = f'#include "operations.h"\n{c_derivatives(straight(root))}'
    for direction in DIRECTIONS:
        given = [np.array([0.0]), np.array([2.0])]
        assert results_of(text, derivative(root, direction), given, tmp_path, direction) == 6.0


def test_few_joints_and_joints_with_nothing_in_common_have_no_loops():
    assert find_loops(recursion(9), 9) is None
    x = ca.SX.sym("x", N)
    functions = [ca.sin, ca.cos, ca.tan, ca.exp, ca.sqrt, ca.tanh, ca.atan, ca.log1p, ca.sinh, ca.cosh, ca.fabs]
    y = [functions[k % 11](functions[(k + 1 + k // 11) % 11](x[k])) for k in range(N)]
    assert find_loops(ca.Function("unlike", [x], [ca.vertcat(*y)], ["x"], ["y"]), N) is None
