"""Elementwise functions and tables on symbols: the same numbers as on floats."""

import fmpy
import numpy as np
import pytest

from tests.compiler.unit.test_trace import both
from vdfmu.arm.fmus import build_fmus
from vdfmu.base.errors import UnitError
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
    """Assert that outputs are the same on symbols as on floats, for random inputs."""
    traced, plain = both(unit)
    inputs = [i for i, v in enumerate(traced.interface) if v.causality == "input"]
    moved = set()
    for row in VALUES:
        for evaluated in (traced, plain):
            evaluated.memory[inputs] = np.resize(row, len(inputs))
            evaluated.outputs()
        # functions of the mathematical library may be those of another one: a rounding each
        np.testing.assert_allclose(traced.memory, plain.memory, rtol=roundings * EPS, atol=roundings * EPS)
        moved.add(traced.memory.tobytes())
    assert len(moved) > 100


class Elementwise(Unit):
    """What vdfmu.unit gives, on arrays and scalars."""

    u = Input("1", 3)
    y = Output("1", (10, 3))
    z = Output("1", 10)

    def outputs(self) -> None:
        u, a = self.u, self.u[0]
        self.y = np.stack([
            where(np.logical_and(u > 0.3, np.logical_not(u > 1.0)) | np.logical_or(u < -2.0, u > 3.0), u, 1.0),
            where(u > 0.3, u, -u), where(u <= 0.5, 1.0, u), clip(u, -1.0, 1.0), clip(0.5, u, 2.0), minimum(u, 0.5),
            maximum(u[::-1], u), sgn(u), np.abs(u), where((u > -1.0) & ~(u >= 1.0) | (u < -2.0), u, 0.0),
        ])  # fmt: skip
        self.z = [
            where(a > 0.0, a, 2.0 * a), minimum(a, 1.0), maximum(0.0, a), clip(a, 0.0, 1.0), sgn(+a), abs(a),
            np.any(u > 2.0), np.all(u < 2.0), np.clip(a, None, 0.5), np.clip(u, -0.5, None)[1],
        ]  # fmt: skip


class Rounding(Unit):
    """Steps of all kinds."""

    u = Input("1", 3)
    y = Output("1", (8, 3))
    z = Output("1", 6)

    def outputs(self) -> None:
        u, a = self.u, self.u[1]
        self.y = np.array([
            np.floor(u), np.ceil(u), np.rint(u), np.round(u / 0.25) * 0.25, u // 0.3, u % 0.3, 1.5 // (u + 0.1),
            np.floor(u / 0.01) * 0.01,
        ])  # fmt: skip
        self.z = [np.floor(a), np.rint(a), a // 2.0, a % 2.0, 3.0 % (a + 0.1), np.round(a)]


class Functions(Unit):
    """Functions of numpy."""

    u = Input("1", 3)
    y = Output("1", (18, 3))
    z = Output("1", 4)

    def outputs(self) -> None:
        u = self.u
        s = 0.99 * np.tanh(u)
        self.y = np.concatenate([
            [np.sin(u), np.cos(u), np.tan(s), np.arcsin(s), np.arccos(s), np.arctan(u), np.arctan2(u, u[::-1])],
            [np.sinh(s), np.cosh(s), np.exp(u), np.expm1(u), np.log(1.0 + u * u), np.log1p(u * u), np.sqrt(u * u)],
            [u**2, u**3, 2.0**u, (u * u) ** s],
        ])  # fmt: skip
        M = np.outer(u, u) + np.eye(3)
        self.z = [u @ u, np.sum(M @ u), np.dot(u, [1.0, 2.0, 3.0]), np.cross(u, [0.0, 1.0, 0.5])[2]]


class More(Unit):
    """Functions of numpy that compare, take no objects, or take a number before a symbol."""

    u = Input("1", 3)
    y = Output("1", (29, 3))
    z = Output("1", 13)

    def outputs(self) -> None:
        u, a = self.u, self.u[0]
        v, s = u[::-1], 0.99 * np.tanh(u)
        self.y = np.stack([
            np.hypot(u, v), np.hypot(3.0, u), np.arctan2(1.0, u), np.copysign(u, v), np.copysign(2.0, u),
            np.fmax(u, 0.5), np.fmin(u, v), np.maximum(0.5, u), np.minimum(u, v), np.square(u),
            np.reciprocal(u + 5.0 * np.sign(u) + 0.1), np.exp2(u), np.log2(u * u + 0.1), np.log10(u * u + 0.1),
            np.log1p(u * u), np.expm1(u), np.cbrt(u), np.deg2rad(u), np.rad2deg(u), np.radians(u), np.degrees(u),
            np.heaviside(u, 0.5), np.sign(u), np.clip(u, -1.0, v * v), np.trunc(u), np.fmod(u, 0.3),
            np.arcsinh(u) + np.arccosh(1.0 + u * u) + np.arctanh(s), np.logaddexp(u, v), np.where(u > v, u, 2.0),
        ])  # fmt: skip
        self.z = [
            np.hypot(a, 1.0), np.sign(a), np.heaviside(a, 0.25), np.copysign(1.0, a), np.maximum(a, 0.0), np.max(u),
            u.min(), np.clip(a, -1.0, 1.0), np.where(a > 0.0, a, -1.0), np.fabs(a), np.float_power(2.0, a),
            np.fmod(1.0, a + 0.1), np.conjugate(a),
        ]  # fmt: skip


class Combined(Unit):
    """Conditions on what arrays of arrays give."""

    u = Input("1", 3)
    y = Output("1", 6)
    z = Output("1", 3)
    w = Output("1", 3)

    def outputs(self) -> None:
        both = np.concatenate([self.u, -self.u])
        self.y = where(both > 0.0, both, 0.1 * both)
        limited = zeros((3,), self.u)
        for i in range(3):
            limited[i] = where(self.u[i] > 1.0, 1.0, self.u[i])
        self.z = where(clip(self.u, -1.0, 1.0) < 0.5, limited, where(self.u > 0.0, 2.0, 3.0))
        partly = zeros((3,), self.u)  # symbols and numbers
        partly[1:] = self.u[0], 2.0
        self.w = clip(partly, -1.0, 1.0)


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


@pytest.mark.parametrize("unit", [Elementwise, Rounding, Combined, Functions, More])
def test_conditions_and_steps_are_the_same_bits_on_symbols_as_on_floats_and_functions_nearly(unit):
    # powers and products of some ten factors, each with its rounding
    assert_same(unit, roundings=50 if unit in (Functions, More) else 0)


@pytest.mark.heavy
@pytest.mark.parametrize("unit", [Functions, More])
def test_functions_of_numpy_run_in_c(unit, tmp_path):
    u = np.array([0.7, -1.3, 2.1])
    evaluated, _ = both(unit)
    evaluated.memory[:3] = u
    evaluated.outputs()
    (path,) = build_fmus(None, tmp_path, units=[unit], backend="native").values()
    start = {f"u[{i + 1}]": value for i, value in enumerate(u)}
    row = fmpy.simulate_fmu(str(path), stop_time=0.01, output_interval=0.01, start_values=start)[0]
    expected = {v.name: evaluated.memory[i] for i, v in enumerate(evaluated.interface)}
    found = {name: row[name] for name in row.dtype.names if name != "time"}
    # as above: the functions of C are those of another library
    assert found == pytest.approx({name: expected[name] for name in found}, rel=50 * EPS, abs=50 * EPS)


class Whole(Unit):
    """Logarithms whose floor is asked for."""

    u = Input("1", 3, start=1.0)
    y = Output("1", (2, 3))

    def outputs(self) -> None:
        self.y = np.floor([np.log10(self.u), np.log2(self.u)])


@pytest.mark.parametrize("base", [10.0, 2.0])
def test_logarithms_of_whole_powers_are_whole(base):
    traced = Traced(Interface(Whole, None))
    for power in range(-20, 23):
        traced.group("u")[:] = base**power
        traced.outputs()
        assert traced.group("y")[0 if base == 10.0 else 3] == power


def test_interpolation_is_that_of_numpy():
    assert_same(Table, roundings=8)
    plain = Plain(Interface(Table, None))
    for row in VALUES:
        plain.group("u")[:] = row
        plain.outputs()
        expected = np.interp(row, plain.group("points"), plain.group("values"))
        # three pieces of size 5, each with some roundings
        np.testing.assert_allclose(plain.group("y"), expected, rtol=0, atol=50 * EPS)


class Looked(Unit):
    """A table of numbers, looked up."""

    u = Input("1", 3)
    y = Output("1", 3)

    def outputs(self) -> None:
        self.y = [lookup(u, [-1.0, 0.0, 1.0, 2.0], [5.0, 7.0, -2.0]) for u in self.u]


def test_a_table_to_look_up_may_have_one_dimension():
    assert_same(Looked)
    traced = Traced(Interface(Looked, None))
    traced.group("u")[:] = [-9.0, 0.0, 9.0]
    traced.outputs()
    assert traced.group("y").tolist() == [5.0, 7.0, -2.0]


class Misshapen(Unit):
    """As many edges as rows."""

    u = Input("1")
    y = Output("1")

    def outputs(self) -> None:
        self.y = lookup(self.u, [0.0, 1.0, 2.0], [0.0, 1.0, 4.0])


class Uneven(Misshapen):
    """More points than values."""

    def outputs(self) -> None:
        self.y = interpolate(self.u, [0.0, 1.0, 2.0], [0.0, 1.0])


class Many(Misshapen):
    """Several places at once."""

    def outputs(self) -> None:
        self.y = lookup(np.ones(2) * self.u, [0.0, 1.0, 2.0], [0.0, 1.0])[0]


@pytest.mark.parametrize(
    ("unit", "words"),
    [
        (Misshapen, r"lookup: .*\(m,\), got the shapes \(\), \(3,\) and \(3,\)\. Values at points are for interpolate"),
        (Many, r"lookup: expected a scalar x, .*got the shapes \(2,\), \(3,\) and \(2,\)"),
        (Uneven, r"interpolate: expected points \(m,\) and values \(m, \.\.\.\), got \(3,\) and \(2,\)"),
    ],
)
def test_tables_of_shapes_that_do_not_fit_are_refused(unit, words):
    with pytest.raises(UnitError, match=rf"line \d+: outputs\(\) of {unit.__name__} fails: {words}"):
        Traced(Interface(unit, None))


def test_functions_on_floats_are_those_of_numpy():
    assert (lookup(1.5, [0.0, 1.0, 2.0], [[1.0, 2.0], [3.0, 4.0]]) + 1.0).tolist() == [4.0, 5.0]
    for row in VALUES:
        np.testing.assert_array_equal(where(row > 0.0, row, 2.0), np.where(row > 0.0, row, 2.0))
        np.testing.assert_array_equal(clip(row, -1.0, 1.0), np.clip(row, -1.0, 1.0))
        np.testing.assert_array_equal(minimum(row, 0.5), np.minimum(row, 0.5))
        np.testing.assert_array_equal(maximum(row, row[::-1]), np.maximum(row, row[::-1]))
        np.testing.assert_array_equal(sgn(row), np.copysign(1.0, row))
