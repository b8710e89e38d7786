"""A unit on symbols and on floats, and units of the functions of numpy."""

import numpy as np

from vdfmu.compiler.unit.evaluate import Plain, Traced
from vdfmu.compiler.unit.interface import Interface
from vdfmu.unit import Input, Output, Unit


def both(unit, robot=None):
    interface = Interface(unit, robot)
    return Traced(interface), Plain(interface)


def unit_of(function):
    arrays, scalars = function(np.full(3, 0.5), 0.5)

    def outputs(self):
        y, self.z = function(self.u, self.u[0])
        self.y = np.stack(y)

    variables = {"u": Input("1", 3, start=1.0), "y": Output("1", (len(arrays), 3)), "z": Output("1", len(scalars))}
    return type("Made", (Unit,), {**variables, "outputs": outputs})


def functions(u, a):
    s, M = 0.99 * np.tanh(u), np.outer(u, u) + np.eye(3)
    return [
        np.sin(u), np.cos(u), np.tan(s), np.arcsin(s), np.arccos(s), np.arctan(u), np.arctan2(u, u[::-1]),
        np.sinh(s), np.cosh(s), np.exp(u), np.expm1(u), np.log(1.0 + u * u), np.log1p(u * u), np.sqrt(u * u),
        u**2, u**3, 2.0**u, (u * u) ** s,
    ], [u @ u, np.sum(M @ u), np.dot(u, [1.0, 2.0, 3.0]), np.cross(u, [0.0, 1.0, 0.5])[2]]  # fmt: skip


def further(u, a):
    v, s = u[::-1], 0.99 * np.tanh(u)
    return [
        np.hypot(u, v), np.hypot(3.0, u), np.arctan2(1.0, u), np.copysign(u, v), np.copysign(2.0, u),
        np.fmax(u, 0.5), np.fmin(u, v), np.maximum(0.5, u), np.minimum(u, v), np.square(u),
        np.reciprocal(u + 5.0 * np.sign(u) + 0.1), np.exp2(u), np.log2(u * u + 0.1), np.log10(u * u + 0.1),
        np.log1p(u * u), np.expm1(u), np.cbrt(u), np.deg2rad(u), np.rad2deg(u), np.radians(u), np.degrees(u),
        np.heaviside(u, 0.5), np.sign(u), np.clip(u, -1.0, v * v), np.trunc(u), np.fmod(u, 0.3),
        np.arcsinh(u) + np.arccosh(1.0 + u * u) + np.arctanh(s), np.logaddexp(u, v), np.where(u > v, u, 2.0),
    ], [
        np.hypot(a, 1.0), np.sign(a), np.heaviside(a, 0.25), np.copysign(1.0, a), np.maximum(a, 0.0), np.max(u),
        u.min(), np.clip(a, -1.0, 1.0), np.where(a > 0.0, a, -1.0), np.fabs(a), np.float_power(2.0, a),
        np.fmod(1.0, a + 0.1), np.conjugate(a),
    ]  # fmt: skip
