"""Sources and blocks after Modelica.Blocks, of which the SSP fixtures of pyssporg/ssp_references are made."""

# ruff: noqa: D102

import numpy as np

from vdfmu.unit import Derivative, Input, Output, Parameter, State, Unit, where


class Step(Unit):
    """Step from an offset, at a time."""

    height = Parameter("1", text="height", start=1.0)
    offset = Parameter("1", text="value before the step")
    startTime = Parameter("s", text="time of the step")
    y = Output("1", text="signal")

    def outputs(self) -> None:
        self.y = self.offset + where(self.t < self.startTime, 0.0, self.height)


class Sine(Unit):
    """Sine that begins at a time."""

    amplitude = Parameter("1", text="amplitude", start=1.0)
    f = Parameter("Hz", text="frequency", start=1.0)
    phase = Parameter("rad", text="phase at the begin")
    offset = Parameter("1", text="mean")
    startTime = Parameter("s", text="time of the begin")
    y = Output("1", text="signal")

    def outputs(self) -> None:
        swing = self.amplitude * np.sin(2.0 * np.pi * self.f * (self.t - self.startTime) + self.phase)
        self.y = self.offset + where(self.t < self.startTime, 0.0, swing)


class Gain(Unit):
    """Factor."""

    k = Parameter("1", text="factor", start=1.0)
    u = Input("1", text="in")
    y = Output("1", text="out")

    def outputs(self) -> None:
        self.y = self.k * self.u


class Add(Unit):
    """Weighted sum."""

    k1 = Parameter("1", text="first factor", start=1.0)
    k2 = Parameter("1", text="second factor", start=1.0)
    u1 = Input("1", text="first")
    u2 = Input("1", text="second")
    y = Output("1", text="sum")

    def outputs(self) -> None:
        self.y = self.k1 * self.u1 + self.k2 * self.u2


class Product(Unit):
    """Product."""

    u1 = Input("1", text="first")
    u2 = Input("1", text="second")
    y = Output("1", text="product")

    def outputs(self) -> None:
        self.y = self.u1 * self.u2


class Machine(Unit):
    """Direct-current machine."""

    R = Parameter("Ohm", text="resistance", start=0.5)
    L = Parameter("H", text="inductance", start=1e-3)
    k = Parameter("N.m/A", text="torque constant", start=0.1)
    U = Input("V", text="voltage")
    w = Input("rad/s", text="speed")
    I = State("A", text="current")  # noqa: E741
    I_dot = Derivative(I)
    M = Output("N.m", text="torque")

    def outputs(self) -> None:
        self.M = self.k * self.I

    def derivatives(self) -> None:
        self.I_dot = (self.U - self.R * self.I - self.k * self.w) / self.L


class Mass(Unit):
    """Inertia with a damper."""

    J = Parameter("kg.m2", text="inertia", start=0.002)
    d = Parameter("N.m.s/rad", text="damping", start=0.001)
    M_A = Input("N.m", text="torque of the machine")
    M_B = Input("N.m", text="torque of the load")
    wA = State("rad/s", text="speed")
    wA_dot = Derivative(wA)

    def derivatives(self) -> None:
        self.wA_dot = (self.M_A + self.M_B - self.d * self.wA) / self.J


class Stimuli(Unit):
    """Voltage and load."""

    height = Parameter("V", text="voltage", start=12.0)
    k = Parameter("N.m", text="load", start=0.05)
    U = Output("V", text="voltage")
    M_load = Output("N.m", text="load")

    def outputs(self) -> None:
        self.U, self.M_load = self.height, self.k
