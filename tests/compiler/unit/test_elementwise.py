"""Elementwise functions, conditions and tables: the same numbers on symbols, in C and by numpy as on floats."""

import fmpy
import numpy as np
import pytest

from tests.compiler.unit.test_trace import both
from vdfmu.arm.fmus import build_fmus
from vdfmu.base.errors import UnitError
from vdfmu.compiler.unit.evaluate import Traced
from vdfmu.compiler.unit.interface import Interface
from vdfmu.unit import Input, Output, Parameter, Unit, clip, interpolate, lookup, maximum, minimum, sgn, where, zeros

EPS = np.finfo(float).eps
VALUES = np.concatenate(
    [
        np.random.default_rng(90).normal(scale=2.0, size=(200, 3)),
        [[0.0, -0.0, 0.5], [1.0, -1.0, 2.5], [-1.5, 3.0, -0.5]],
    ]
)
"""Random values, and those at which conditions and roundings change."""
POINTS, NUMBERS = [-2.0, -0.5, 0.5, 3.0], [1.0, -1.0, 4.0, 0.0]


def conditions(u, a, *_):
    """Return conditions of vdfmu.unit, on arrays and scalars."""
    return [
        where(np.logical_and(u > 0.3, np.logical_not(u > 1.0)) | np.logical_or(u < -2.0, u > 3.0), u, 1.0),
        where(u > 0.3, u, -u), where(u <= 0.5, 1.0, u), clip(u, -1.0, 1.0), clip(0.5, u, 2.0), minimum(u, 0.5),
        maximum(u[::-1], u), sgn(u), np.abs(u), where((u > -1.0) & ~(u >= 1.0) | (u < -2.0), u, 0.0),
        where(a > 0.0, a, 2.0 * a), minimum(a, 1.0), maximum(0.0, a), clip(a, 0.0, 1.0), sgn(+a), abs(a),
        np.any(u > 2.0), np.all(u < 2.0), np.clip(a, None, 0.5), np.clip(u, -0.5, None)[1],
    ]  # fmt: skip


def roundings(u, a, *_):
    """Return steps of all kinds."""
    return [
        np.floor(u), np.ceil(u), np.rint(u), np.round(u / 0.25) * 0.25, u // 0.3, u % 0.3, 1.5 // (u + 0.1),
        np.floor(u / 0.01) * 0.01, np.floor(a), np.rint(a), a // 2.0, a % 2.0, 3.0 % (a + 0.1), np.round(a),
    ]  # fmt: skip


def combined(u, *_):
    """Return conditions on results of arrays of arrays."""
    pair = np.concatenate([u, -u])
    limited = zeros((3,), u)
    for i in range(3):
        limited[i] = where(u[i] > 1.0, 1.0, u[i])
    partly = zeros((3,), u)  # symbols and numbers
    partly[1:] = u[0], 2.0
    chosen = where(clip(u, -1.0, 1.0) < 0.5, limited, where(u > 0.0, 2.0, 3.0))
    looked = [lookup(x, [-1.0, 0.0, 1.0, 2.0], [5.0, 7.0, -2.0]) for x in u]
    return [where(pair > 0.0, pair, 0.1 * pair), chosen, clip(partly, -1.0, 1.0), looked]


def functions(u, a, v, s, *_):
    """Return functions of numpy, some of which compare, take no objects, or take a number before a symbol."""
    M = np.outer(u, u) + np.eye(3)
    return [
        np.sin(u), np.cos(u), np.tan(s), np.arcsin(s), np.arccos(s), np.arctan(u), np.arctan2(u, v), np.sinh(s),
        np.cosh(s), np.exp(u), np.expm1(u), np.log(1.0 + u * u), np.log1p(u * u), np.sqrt(u * u), u**2, u**3, 2.0**u,
        (u * u) ** s, u @ u, np.sum(M @ u), np.dot(u, [1.0, 2.0, 3.0]), np.cross(u, [0.0, 1.0, 0.5])[2],
        np.hypot(u, v), np.hypot(3.0, u), np.arctan2(1.0, u), np.copysign(u, v), np.copysign(2.0, u),
        np.fmax(u, 0.5), np.fmin(u, v), np.maximum(0.5, u), np.minimum(u, v), np.square(u),
        np.reciprocal(u + 5.0 * np.sign(u) + 0.1), np.exp2(u), np.log2(u * u + 0.1), np.log10(u * u + 0.1),
        np.cbrt(u), np.deg2rad(u), np.rad2deg(u), np.radians(u), np.degrees(u), np.heaviside(u, 0.5), np.sign(u),
        np.clip(u, -1.0, v * v), np.trunc(u), np.fmod(u, 0.3), np.logaddexp(u, v), np.where(u > v, u, 2.0),
        np.arcsinh(u) + np.arccosh(1.0 + u * u) + np.arctanh(s), np.hypot(a, 1.0), np.sign(a), np.heaviside(a, 0.25),
        np.copysign(1.0, a), np.maximum(a, 0.0), np.max(u), u.min(), np.clip(a, -1.0, 1.0),
        np.where(a > 0.0, a, -1.0), np.fabs(a), np.float_power(2.0, a), np.fmod(1.0, a + 0.1), np.conjugate(a),
    ]  # fmt: skip


def tables(u, a, _, __, points, values):
    """Return interpolations in a table of parameters."""
    return [interpolate(u, points, values), interpolate(a, points, values)]


def unit_of(function, name="", start=0.0):
    """Return the unit whose output is all that a function gives, one after the other."""

    def flat(u, points, values):
        found = function(u, u[0], u[::-1], 0.99 * np.tanh(u), points, values)
        return np.concatenate([np.ravel(each) for each in found])

    def outputs(self):
        self.y = flat(self.u, self.points, self.values)

    size = len(flat(np.full(3, 0.4), np.array(POINTS), np.array(NUMBERS)))
    table = {"points": Parameter("1", 4, start=POINTS), "values": Parameter("1", 4, start=NUMBERS)}
    body = {
        "u": Input("1", 3, start=start),
        "y": Output("1", size),
        **table,
        "outputs": outputs,
        "__module__": __name__,
    }
    return type(name or function.__name__.title(), (Unit,), body)


# functions of the mathematical library may be those of another one: powers and products of some ten factors, each with
# its rounding; the others are the same bits
CASES = {conditions: 0, roundings: 0, combined: 0, functions: 50, tables: 8}


@pytest.mark.parametrize("function", CASES, ids=lambda function: function.__name__)
def test_symbols_give_the_numbers_of_floats(function):
    traced, plain = both(unit_of(function))
    moved = set()
    for row in VALUES:
        for evaluated in (traced, plain):
            evaluated.group("u")[:] = row
            evaluated.outputs()
        few = CASES[function] * EPS
        np.testing.assert_allclose(traced.memory, plain.memory, rtol=few, atol=few)
        moved.add(traced.memory.tobytes())
        if function is tables:
            # three pieces of size 5, each with some roundings
            np.testing.assert_allclose(plain.group("y")[:3], np.interp(row, POINTS, NUMBERS), rtol=0, atol=50 * EPS)
    assert len(moved) > 100


@pytest.mark.heavy
def test_functions_of_numpy_run_in_c(tmp_path):
    unit, u = unit_of(functions), np.array([0.7, -1.3, 2.1])
    evaluated, _ = both(unit)
    evaluated.group("u")[:] = u
    evaluated.outputs()
    (path,) = build_fmus(None, tmp_path, units=[unit], backend="native").values()
    start = {f"u[{i + 1}]": value for i, value in enumerate(u)}
    row = fmpy.simulate_fmu(str(path), stop_time=0.01, output_interval=0.01, start_values=start)[0]
    # as above: the functions of C are those of another library
    np.testing.assert_allclose(list(row)[1:], evaluated.group("y"), rtol=50 * EPS, atol=50 * EPS)


@pytest.mark.parametrize(("base", "logarithm"), [(10.0, np.log10), (2.0, np.log2)])
def test_logarithms_of_whole_powers_are_whole(base, logarithm):
    traced = Traced(Interface(unit_of(lambda u, *_: [np.floor(logarithm(u))], "Whole", 1.0), None))
    for power in range(-20, 23):
        traced.group("u")[:] = base**power
        traced.outputs()
        assert traced.group("y")[0] == power


@pytest.mark.parametrize(
    ("make", "words"),
    [
        (lambda u: lookup(u, [0.0, 1.0, 2.0], [0.0, 1.0, 4.0]),
         r"lookup: .*\(m,\), got the shapes \(\), \(3,\) and \(3,\)\. Values at points are for interpolate"),
        (lambda u: lookup(np.ones(2) * u, [0.0, 1.0, 2.0], [0.0, 1.0])[0],
         r"lookup: expected a scalar x, .*got the shapes \(2,\), \(3,\) and \(2,\)"),
        (lambda u: interpolate(u, [0.0, 1.0, 2.0], [0.0, 1.0]),
         r"interpolate: expected points \(m,\) and values \(m, \.\.\.\), got \(3,\) and \(2,\)"),
    ],
)  # fmt: skip
def test_tables_of_shapes_that_do_not_fit_are_refused(make, words):
    class Misshapen(Unit):
        """Misshapen."""

        u, y = Input("1"), Output("1")

        def outputs(self) -> None:
            self.y = make(self.u)

    with pytest.raises(UnitError, match=rf"line \d+: outputs\(\) of Misshapen fails: {words}"):
        Traced(Interface(Misshapen, None))


def test_functions_on_floats_are_those_of_numpy():
    assert (lookup(1.5, [0.0, 1.0, 2.0], [[1.0, 2.0], [3.0, 4.0]]) + 1.0).tolist() == [4.0, 5.0]
    looked = [lookup(x, [-1.0, 0.0, 1.0, 2.0], [5.0, 7.0, -2.0]) for x in (-9.0, 0.0, 9.0)]
    assert looked == [5.0, 7.0, -2.0]
    for row in VALUES:
        np.testing.assert_array_equal(where(row > 0.0, row, 2.0), np.where(row > 0.0, row, 2.0))
        np.testing.assert_array_equal(clip(row, -1.0, 1.0), np.clip(row, -1.0, 1.0))
        np.testing.assert_array_equal(minimum(row, 0.5), np.minimum(row, 0.5))
        np.testing.assert_array_equal(maximum(row, row[::-1]), np.maximum(row, row[::-1]))
        np.testing.assert_array_equal(sgn(row), np.copysign(1.0, row))
