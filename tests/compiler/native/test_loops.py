"""Long traces become loops over what repeats in them, with the same bits."""

import ctypes
import subprocess

import casadi as ca
import numpy as np
import pytest

from vdfmu.compiler.c.expressions import c_prototype
from vdfmu.compiler.c.functions import c_texts
from vdfmu.compiler.c.loops import c_loops
from vdfmu.compiler.c.series import Trace, find_series

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


def results_of(text, function, given, tmp_path, name="kernel"):
    """Compile the C text of a function, without a warning, and return its results for given arguments."""
    source, library = tmp_path / f"{name}.c", tmp_path / f"{name}.so"
    source.write_text(f"#include <math.h>\n#include <stdint.h>\n{c_prototype(function)};\n{text}")
    flags = ["-std=c11", "-Wall", "-Wextra", "-Wpedantic", "-Werror", "-O1", "-ffp-contract=off", "-shared", "-fPIC"]
    subprocess.run(["cc", *flags, "-o", library, source, "-lm"], check=True)
    made = [np.full(function.numel_out(i), np.nan) for i in range(function.n_out())]
    ctypes.CDLL(str(library))[function.name()](*(a.ctypes.data_as(ctypes.c_void_p) for a in (*given, *made)))
    return np.concatenate(made)


def check_bits(function, joints, tmp_path):
    text = c_loops(function, joints)
    assert text is not None
    rng = np.random.default_rng(1)
    given = [rng.uniform(0.5, 1.5, function.numel_in(i)) for i in range(function.n_in())]
    expected = results_of("\n".join(c_texts(function)), function, given, tmp_path, "line")
    np.testing.assert_array_equal(results_of(text, function, given, tmp_path, "loops"), expected)
    return text


def test_a_recursion_up_and_down_is_as_many_loops(tmp_path):
    text = check_bits(recursion(), N, tmp_path)
    assert text.count("for (int i") == 3
    assert text.count("i++") == 2 and text.count("i--") == 1


def test_the_text_does_not_grow_with_the_joints():
    short, long = (c_loops(recursion(n), n) for n in (12, 200))
    assert short is not None and long is not None
    assert len(long) < 1.1 * len(short)  # more digits


@pytest.mark.parametrize("seed", range(12))
def test_joints_that_are_unlike_the_others_keep_their_operations(seed, tmp_path):
    check_bits(recursion(seed=seed), N, tmp_path)


@pytest.mark.heavy
@pytest.mark.parametrize("seed", range(100, 160))
def test_many_chains_keep_their_bits(seed, tmp_path):
    check_bits(recursion(seed=seed), N, tmp_path)


def test_every_operation_is_in_one_series():
    trace = Trace(recursion(seed=3))
    layout = find_series(trace, N, 1, trace.digests(0))
    assert layout is not None
    members = [operation for one in layout.series for operation in one.members]
    assert sorted(members) == [k for k in range(len(trace.operations)) if not trace.is_leaf(k)]


def test_few_joints_and_joints_with_nothing_in_common_have_no_loops():
    assert c_loops(recursion(9), 9) is None
    x = ca.SX.sym("x", N)
    functions = [ca.sin, ca.cos, ca.tan, ca.exp, ca.sqrt, ca.tanh, ca.atan, ca.log1p, ca.sinh, ca.cosh, ca.fabs]
    y = [functions[k % 11](functions[(k + 1 + k // 11) % 11](x[k])) for k in range(N)]
    assert c_loops(ca.Function("unlike", [x], [ca.vertcat(*y)], ["x"], ["y"]), N) is None
