"""Units as a user writes them, for test_own_units.py."""

# ruff: noqa: D102

import numpy as np

from vdfmu.unit import (
    JOINTS,
    Choice,
    Derivative,
    Input,
    Output,
    Parameter,
    RobotParameters,
    Sampled,
    State,
    Switch,
    Unit,
    expm,
    inv,
    solve,
    where,
)


class LowPass(Unit):
    """First-order low-pass filter.

    Solves::

        T y_dot = u - y
    """

    u = Input("V", text="signal")
    T = Parameter("s", text="time constant", start=0.1, minimum=1e-6)
    y = State("V", text="filtered signal")
    y_dot = Derivative(y)

    def derivatives(self) -> None:
        self.y_dot = (self.u - self.y) / self.T


class Encoder(Unit):
    """Encoder that rounds to its increments and is late by one sample."""

    q = Input("rad", 2, text="angle")
    increment = Parameter("rad", text="increment", start=0.01, minimum=1e-9)
    period = Parameter("s", text="time between samples", start=1e-3, minimum=1e-6)
    newest = Sampled("rad", 2, text="last sample")
    y = Sampled("rad", 2, text="sample before the last")

    def start(self) -> None:
        self.newest = self.y = self.increment * np.round(self.q / self.increment)

    def update(self) -> None:
        self.y = self.newest
        self.newest = self.increment * np.round(self.q / self.increment)


class Mixer(Unit):
    """Two signals, mixed in one of three ways."""

    u = Input("1", 2, text="signal", minimum=-1e3, maximum=1e3)
    way = Choice("sum", "product", "the larger", text="way of mixing")
    inverted = Switch(False, text="changes the sign")
    y = Output("1", text="mixture")

    def outputs(self) -> None:
        if self.way == "sum":
            y = self.u[0] + self.u[1]
        elif self.way == "product":
            y = self.u[0] * self.u[1]
        else:
            y = where(self.u[0] > self.u[1], self.u[0], self.u[1])
        self.y = -y if self.inverted else y


class Clock(Unit):
    """Sine of the time: a unit without inputs."""

    omega = Parameter("rad/s", text="angular frequency", start=2.0)
    y = Output("1", text="sine")

    def outputs(self) -> None:
        self.y = np.sin(self.omega * self.t)


class Weights(Unit):
    """Weight of each link at its motor."""

    g = Parameter("m/s2", text="gravity", start=9.81)
    q = Input("position", JOINTS, text="position")
    robot = RobotParameters("ell", "mass")
    y = Output("1", JOINTS, text="weight")

    def outputs(self) -> None:
        self.y = self.g * self.robot.mass / self.robot.ell * np.cos(self.q)


class Equations(Unit):
    """Solution of two linear equations, scaled to 1 where it is larger."""

    backend = "python"

    b = Input("1", 2, text="right-hand side")
    a = Parameter("1", text="element beside the diagonal", start=0.5)
    y = Output("1", 2, text="solution")

    def outputs(self) -> None:
        y = np.linalg.solve(np.array([[2.0, self.a], [self.a, 1.0]]), self.b)
        size = np.max(np.abs(y))
        self.y = y / size if size > 1.0 else y


class Words(Unit):
    """Damped oscillator whose variables have names that C and the traced functions use."""

    w1 = Input("N", text="force")
    y_new = Input("N", text="second force")
    d_x = Input("N", text="third force")
    p = Parameter("N.s/m", text="damping", start=0.4, minimum=0.0, tunable=True)
    t_0 = Parameter("kg", text="mass", start=0.5, minimum=1e-3)
    double = Parameter("N/m", text="stiffness", start=3.0)
    v0 = Parameter("m/s", text="speed of the ground", start=0.0)
    factors = Parameter("m/s", text="another speed", start=0.0)
    x = State("m", text="position")
    h = State("m/s", text="speed")
    x_dot = Derivative(x)
    h_dot = Derivative(h)
    norm = Output("N", text="sum of the forces")
    period = Parameter("s", text="time between samples", start=1e-2, minimum=1e-6)
    y = Sampled("N", text="second force, sampled")

    def update(self) -> None:
        self.y = self.y_new

    def outputs(self) -> None:
        self.norm = self.w1 + self.y + self.d_x

    def derivatives(self) -> None:
        self.x_dot = self.h + self.v0 + self.factors
        self.h_dot = (self.w1 + self.y + self.d_x - self.p * self.h - self.double * self.x) / self.t_0


class Burst(Unit):
    """State that runs away within a microsecond after the third sample."""

    period = Parameter("s", text="time between samples", start=1e-3, minimum=1e-6)
    x = State("1", text="state", start=1.0)
    x_dot = Derivative(x)
    count = Sampled("1", text="number of samples")

    def update(self) -> None:
        self.count = self.count + 1.0

    def derivatives(self) -> None:
        self.x_dot = where(self.count > 2.5, 1e6 * self.x * self.x, 0.0)


class OnlyParameter(Unit):
    """Has neither inputs nor outputs."""

    k = Parameter("1")


class Tensor(Unit):
    """Has commas in all names of FMI 2.0, which tables of reference results cannot have."""

    u = Input("1", (2, 1, 2))
    y = Output("1", (2, 1, 2))

    def outputs(self) -> None:
        self.y = 2.0 * self.u


class Rate(Unit):
    """Moves at constant rates, whatever its variables are."""

    x = State("1", 2)
    x_dot = Derivative(x)

    def derivatives(self) -> None:
        self.x_dot = [0.0, 2.0]


class Solves(Unit):
    """A system, an inverse, and the exact discretization of an oscillator."""

    u = Input("1", 3)
    A = Parameter("1", (3, 3), start=[[0.0, 2.0, 1.0], [1.0, 0.0, 0.5], [0.1, 0.2, 4.0]])
    T = Parameter("s", start=0.1, minimum=1e-6, tunable=True)
    y = Output("1", 3)
    z = Output("1", 3)
    F = Output("1", (2, 2))
    x = State("1", 3)
    x_dot = Derivative(x)

    def outputs(self) -> None:
        self.y = np.linalg.solve(self.A, self.u)
        self.z = inv(self.A) @ self.u
        self.F = expm(np.array([[0.0, 1.0], [-1.0, -0.2]]) * self.T)

    def derivatives(self) -> None:
        a, b, c = self.u
        self.x_dot = solve([[a * 0.0, 1.0, b], [2.0, a, 0.0], [0.0, c, 1.0]], -self.x)
