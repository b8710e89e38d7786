"""Elementwise functions, roundings and tables on symbols: the same numbers as on floats, and slopes of roundings."""

import casadi as ca
import numpy as np
import pytest

from tests.compiler.unit.pair import both, functions, further, unit_of
from vdfmu.base.errors import UnitError
from vdfmu.compiler.functions.derivatives import derivative
from vdfmu.compiler.unit.evaluate import Plain, Traced
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


def assert_same(unit, roundings=0):
    traced, plain = both(unit)
    moved = set()
    for row in VALUES:
        for evaluated in (traced, plain):
            evaluated.group("u")[:] = row
            evaluated.outputs()
        # functions of the mathematical library may be those of another one: a rounding each
        np.testing.assert_allclose(traced.memory, plain.memory, rtol=roundings * EPS, atol=roundings * EPS)
        moved.add(traced.memory.tobytes())
    assert len(moved) > 100


def chosen(u, a):
    return [
        where(np.logical_and(u > 0.3, np.logical_not(u > 1.0)) | np.logical_or(u < -2.0, u > 3.0), u, 1.0),
        where(u > 0.3, u, -u), where(u <= 0.5, 1.0, u), clip(u, -1.0, 1.0), clip(0.5, u, 2.0), minimum(u, 0.5),
        maximum(u[::-1], u), sgn(u), np.abs(u), where((u > -1.0) & ~(u >= 1.0) | (u < -2.0), u, 0.0),
    ], [
        where(a > 0.0, a, 2.0 * a), minimum(a, 1.0), maximum(0.0, a), clip(a, 0.0, 1.0), sgn(+a), abs(a),
        np.any(u > 2.0), np.all(u < 2.0), np.clip(a, None, 0.5), np.clip(u, -0.5, None)[1],
    ]  # fmt: skip


def rounded(u, a):
    return [
        np.floor(u), np.ceil(u), np.rint(u), np.round(u / 0.25) * 0.25, u // 0.3, u % 0.3, 1.5 // (u + 0.1),
        np.floor(u / 0.01) * 0.01,
    ], [np.floor(a), np.rint(a), a // 2.0, a % 2.0, 3.0 % (a + 0.1), np.round(a)]  # fmt: skip


def combined(u, a):
    pair = np.concatenate([u, -u])
    limited, partly = zeros((3,), u), zeros((3,), u)  # symbols, then symbols and numbers
    for i in range(3):
        limited[i] = where(u[i] > 1.0, 1.0, u[i])
    partly[1:] = a, 2.0
    chosen = where(clip(u, -1.0, 1.0) < 0.5, limited, where(u > 0.0, 2.0, 3.0))
    return [*where(pair > 0.0, pair, 0.1 * pair).reshape(2, 3), chosen, clip(partly, -1.0, 1.0)], [a]


@pytest.mark.parametrize("function", [chosen, rounded, combined, functions, further])
def test_conditions_and_steps_are_the_same_bits_on_symbols_as_on_floats_and_functions_nearly(function):
    # powers and products of some ten factors, each with its rounding
    assert_same(unit_of(function), roundings=50 if function in (functions, further) else 0)


@pytest.mark.parametrize("base", [10.0, 2.0])
def test_logarithms_of_whole_powers_are_whole(base):
    logarithm = np.log10 if base == 10.0 else np.log2
    traced = Traced(Interface(unit_of(lambda u, a: ([np.floor(logarithm(u))], [a])), None))
    for power in range(-20, 23):
        traced.group("u")[:] = base**power
        traced.outputs()
        assert (traced.group("y") == power).all()


@pytest.mark.parametrize(("rounding", "below"), [(ca.floor, 0.5), (ca.ceil, -0.5)])
def test_the_slope_of_the_square_of_a_rounding_is_that_of_its_line(rounding, below):
    """The line that a rounding follows is half a step below or above it."""
    x = ca.SX.sym("x")
    function = ca.Function("square", [x], [rounding(x) ** 2], ["x"], ["y"])
    for value in (3.2, -1.7):
        for direction in ("forward", "reverse"):
            slope = float(derivative(function, direction, rounded=True)(value, 1.0))
            assert slope == pytest.approx(2.0 * (value - below), rel=1e-14)  # roundings
        assert float(derivative(function, "forward")(value, 1.0)) == 0.0


class Table(Unit):
    """Interpolation in a table of parameters."""

    u = Input("1", 3)
    points = Parameter("1", 4, start=[-2.0, -0.5, 0.5, 3.0])
    values = Parameter("1", 4, start=[1.0, -1.0, 4.0, 0.0])
    y = Output("1", 3)
    z = Output("1")

    def outputs(self) -> None:
        self.y = interpolate(self.u, self.points, self.values)
        self.z = interpolate(self.u[0], self.points, self.values)


def test_interpolation_is_that_of_numpy_and_a_table_to_look_up_may_have_one_dimension():
    assert_same(Table, roundings=8)
    plain = Plain(Interface(Table, None))
    for row in VALUES:
        plain.group("u")[:] = row
        plain.outputs()
        expected = np.interp(row, plain.group("points"), plain.group("values"))
        # three pieces of size 5, each with some roundings
        np.testing.assert_allclose(plain.group("y"), expected, rtol=0, atol=50 * EPS)
    unit = unit_of(lambda u, a: ([[lookup(x, [-1.0, 0.0, 1.0, 2.0], [5.0, 7.0, -2.0]) for x in u]], [a]))
    assert_same(unit)
    traced = Traced(Interface(unit, None))
    traced.group("u")[:] = [-9.0, 0.0, 9.0]
    traced.outputs()
    assert traced.group("y").tolist() == [5.0, 7.0, -2.0]


@pytest.mark.parametrize(("value", "words"), [
    (lambda a: lookup(a, [0.0, 1.0, 2.0], [0.0, 1.0, 4.0]),
     r"lookup: .*\(m,\), got the shapes \(\), \(3,\) and \(3,\)\. For values at points use interpolate"),
    (lambda a: lookup(np.ones(2) * a, [0.0, 1.0, 2.0], [0.0, 1.0])[0],
     r"lookup: expected a scalar x, .*got the shapes \(2,\), \(3,\) and \(2,\)"),
    (lambda a: interpolate(a, [0.0, 1.0, 2.0], [0.0, 1.0]),
     r"interpolate: expected points \(m,\) and values \(m, \.\.\.\), got \(3,\) and \(2,\)"),
])  # fmt: skip
def test_tables_of_shapes_that_do_not_fit_are_refused(value, words):
    class Misshapen(Unit):
        """A table with edges or values too many."""

        u = Input("1")
        y = Output("1")

        def outputs(self) -> None:
            self.y = value(self.u)

    with pytest.raises(UnitError, match=rf"line \d+: outputs\(\) of Misshapen fails: {words}"):
        Traced(Interface(Misshapen, None))
