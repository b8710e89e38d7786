"""Components of the systems of :mod:`benchmarks.judge`."""

from __future__ import annotations

import numpy as np

from tests.engine.reference.models import Model, V
from vdfmu.unit import Derivative, Input, Output, Parameter, Sampled, State, Unit, maximum, where


class Block(Unit):
    """Linear component: three states, two inputs, two outputs."""

    u, y = Input("1", 2, "inputs"), Output("1", 2, "outputs")
    A, B = Parameter("1", (3, 3), "A"), Parameter("1", (3, 2), "B")
    C, D = Parameter("1", (2, 3), "C"), Parameter("1", (2, 2), "D")
    x = State("1", 3, "states")
    x_dot = Derivative(x)

    def outputs(self) -> None:
        """``y = C x + D u``."""
        self.y = self.C @ self.x + self.D @ self.u

    def derivatives(self) -> None:
        """``x_dot = A x + B u``."""
        self.x_dot = self.A @ self.x + self.B @ self.u


class Lags(Unit):
    """Two lags in a row."""

    u, z, y = Input("1", text="input"), State("1", text="between"), State("1", text="output")
    a, b = Parameter("1/s", text="first rate", start=1.0), Parameter("1/s", text="second rate", start=1.0)
    z_dot, y_dot = Derivative(z), Derivative(y)

    def derivatives(self) -> None:
        """``z_dot = a (u - z)``, ``y_dot = b (z - y)``."""
        self.z_dot, self.y_dot = self.a * (self.u - self.z), self.b * (self.z - self.y)


class Mass(Unit):
    """Mass with a spring and a damper."""

    F, x, v = Input("1", text="force"), State("1", text="position"), State("1", text="speed")
    m, g = Parameter("1", text="mass", start=1.0), Parameter("1", text="acceleration")
    k, c = Parameter("1", text="stiffness"), Parameter("1", text="damping")
    x_dot, v_dot = Derivative(x), Derivative(v)

    def derivatives(self) -> None:
        """Newton's law."""
        self.x_dot, self.v_dot = self.v, (self.F - self.k * self.x - self.c * self.v) / self.m - self.g


class Drag(Unit):
    """Spring and damper that are drawn at a constant speed."""

    sampled = False
    x, v, F = Input("1", text="position"), Input("1", text="speed"), Output("1", text="force")
    k, c = Parameter("1", text="stiffness"), Parameter("1", text="damping")
    speed = Parameter("1", text="speed of its other end")

    def outputs(self) -> None:
        """Spring and damper."""
        self.F = self.k * (self.speed * self.t - self.x) + self.c * (self.speed - self.v)


class Tone(Unit):
    """Tone."""

    y = Output("1", text="tone")
    f, phi = Parameter("1", text="frequency"), Parameter("rad", text="phase")

    def outputs(self) -> None:
        """Tone."""
        self.y = np.sin(2.0 * np.pi * self.f * self.t + self.phi)


class Floor(Unit):
    """A floor that pushes and never pulls."""

    sampled = False
    x, v = Input("1", text="height"), Input("1", text="speed")
    F = Output("1", text="force")
    k, c = Parameter("1", text="stiffness", start=1e3), Parameter("1", text="damping", start=1.0)

    def outputs(self) -> None:
        """Spring and damper."""
        self.F = where(self.x < 0.0, maximum(-self.k * self.x - self.c * self.v, 0.0), 0.0)


class LorenzX(Unit):
    """First equation of Lorenz."""

    u, x = Input("1", text="y"), State("1", text="x")
    x_dot = Derivative(x)

    def derivatives(self) -> None:
        """Equation."""
        self.x_dot = 10.0 * (self.u - self.x)


class LorenzYZ(Unit):
    """Second and third equation of Lorenz."""

    u, y, z = Input("1", text="x"), State("1", text="y"), State("1", text="z")
    y_dot, z_dot = Derivative(y), Derivative(z)

    def derivatives(self) -> None:
        """Equations."""
        self.y_dot = self.u * (28.0 - self.z) - self.y
        self.z_dot = self.u * self.y - 8.0 / 3.0 * self.z


class Step(Unit):
    """A step."""

    y = Output("1", text="step")
    at = Parameter("s", text="its time", start=0.5)

    def outputs(self) -> None:
        """Step."""
        self.y = where(self.t > self.at, 1.0, 0.0)


class SampledRelay(Unit):
    """A thermostat that samples."""

    u = Input("1", text="temperature")
    y = Sampled("1", text="heat")
    period = Parameter("s", text="time between samples", start=0.1, minimum=1e-6)
    low, high = Parameter("1", text="limit below", start=0.4), Parameter("1", text="limit above", start=0.6)

    def update(self) -> None:
        """Switch."""
        self.y = where(self.u < self.low, 1.0, where(self.u > self.high, 0.0, self.y))


BLOCK = Model(
    "Block",
    [V("x", "output", start=0.0), V("v", "output", start=0.0), V("der(x)", needs=("v",)), V("der(v)", needs=("F",)),
     V("F", "input", start=0.0), V("m", "parameter", start=1.0), V("hold", "parameter", start=1.0),
     V("drag", "parameter", start=0.7), V("mode", start=0.0), V("z", more={"indicator": "1"})],
    """
static void outputs(Instance *I)
{
    Data *d = &I->d;
    d->der_x = d->v;
    d->der_v = d->mode == 0 ? 0 : (d->F - d->mode * d->drag) / d->m;
    d->z = d->mode == 0 ? d->hold - fabs(d->F) : d->mode * d->v;
}
static void indicators(Instance *I, double *z) { outputs(I), z[0] = I->d.z; }
static void event(Instance *I)
{
    Data *d = &I->d;
    if (d->mode == 0 && fabs(d->F) > d->hold)
        d->mode = d->F > 0 ? 1 : -1;
    else if (d->mode != 0 && d->mode * d->v <= 0 && d->mode * d->F < d->drag) {
        d->v = 0;
        d->mode = d->F < -d->hold ? -1 : d->F > d->hold ? 1 : 0;
        I->changed = true;
    }
}
""",
    step=1e-3, states=("x", "v"), indicators=1, kinds=("ModelExchange",),
)  # fmt: skip
NUMBERS = ("a", "b1", "b2", "c1", "c2", "d1", "d2", "d3")
PIECE = Model(
    "Piece",
    [V("x", "output", start=1.0), V("der(x)", needs=("x", "s", "f")), V("s", "input", start=0.0),
     V("f", "input", start=0.0), V("s_out", "output", needs=("s", "x")), V("r", "output", needs=("f", "x", "s")),
     *(V(name, "parameter", start=0.0) for name in NUMBERS)],
    "static void outputs(Instance *I)\n{\n    Data *d = &I->d;\n"
    "    d->der_x = d->a * d->x + d->b1 * d->s + d->b2 * d->f;\n    d->s_out = d->c1 * d->x + d->d1 * d->s;\n"
    "    d->r = d->c2 * d->x + d->d2 * d->f + d->d3 * d->s;\n}\n",
    step=1e-2, states=("x",), kinds=("ModelExchange",),
)  # fmt: skip
DELAY = Model(
    "Delay",
    [V("u", "input", start=0.0), V("y", "output", needs=("u",)), V("n", "parameter", start=1.0)],
    "static double ring[8192];\nstatic void begin(Instance *I) { (void)I; memset(ring, 0, sizeof ring); }\n"
    "static void outputs(Instance *I)\n{\n    long k = I->steps;\n    ring[k % 8192] = I->d.u;\n"
    "    I->d.y = k < (long)I->d.n ? 0.0 : ring[(k - (long)I->d.n) % 8192];\n}\n",
    step=1e-3, kinds=("CoSimulation",),
)  # fmt: skip
HIDDEN = Model(
    "Hidden",
    [V("u", "input", start=0.0), V("y", "output", needs=("u",)), V("K", "parameter", start=1.0),
     V("period", "parameter", start=1.0), V("next", "parameter", start=0.0)],
    "static void outputs(Instance *I)\n{\n    if (I->time > I->d.next - 1e-9) {\n"
    "        I->d.y = I->d.K * (1.0 - I->d.u);\n        I->d.next += I->d.period;\n    }\n}\n",
    step=1e-3, kinds=("CoSimulation",),
)  # fmt: skip
