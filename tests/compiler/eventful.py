"""Units with events, and their motions in closed form."""

# ruff: noqa: D102

from __future__ import annotations

import math

import numpy as np

from vdfmu.unit import Derivative, Event, Held, Input, Output, Parameter, State, Unit, where

G = 9.81


class Ball(Unit):
    """Bouncing ball."""

    e = Parameter("1", text="coefficient of restitution", start=0.7)
    h = State("m", text="height", start=1.0)
    v = State("m/s", text="velocity")
    h_dot = Derivative(h)
    v_dot = Derivative(v)
    bounces = Held("1", text="number of bounces")
    ground = Event("m", text="depth in the ground")

    def derivatives(self) -> None:
        self.h_dot, self.v_dot = self.v, -G

    def events(self) -> None:
        self.ground = -self.h

    def at_ground(self) -> None:
        self.h, self.v, self.bounces = 0.0, -self.e * self.v, self.bounces + 1.0


class Resting(Ball):
    """Bouncing ball that comes to rest, as that of the Reference FMUs."""

    flies = Held("1", text="1 in the air, 0 at rest", start=1.0)

    def derivatives(self) -> None:
        self.h_dot, self.v_dot = self.v, -G * self.flies

    def at_ground(self) -> None:
        v = -self.e * self.v
        self.bounces, self.flies = self.bounces + 1.0, where(v < 0.1, 0.0, 1.0)
        self.h, self.v = 0.0, self.flies * v


def ball(t: float, e: float = 0.7, h: float = 1.0) -> tuple[float, float, float]:
    """Height, velocity and number of bounces at a time."""
    time = math.sqrt(2.0 * h / G)
    if t < time:
        return h - 0.5 * G * t**2, -G * t, 0.0
    v, count = e * G * time, 1.0
    while t >= time + 2.0 * v / G:
        time, v, count = time + 2.0 * v / G, e * v, count + 1.0
    return v * (t - time) - 0.5 * G * (t - time) ** 2, v - G * (t - time), count


class Thermostat(Unit):
    """Room with a heater that switches by its temperature."""

    tau = Parameter("s", text="time constant", start=100.0, minimum=1e-6)
    T = State("K", text="temperature above the surroundings")
    T_dot = Derivative(T)
    on = Held("1", text="whether it heats", start=1.0)
    switched = Held("1", text="number of switchings")
    hot = Event("K", text="temperature above the upper limit")
    cold = Event("K", text="temperature below the lower limit")

    def derivatives(self) -> None:
        self.T_dot = (40.0 * self.on - self.T) / self.tau

    def events(self) -> None:
        self.hot, self.cold = self.T - 21.0, 19.0 - self.T

    def at_hot(self) -> None:
        self.on, self.switched = 0.0, self.switched + 1.0

    def at_cold(self) -> None:
        self.on, self.switched = 1.0, self.switched + 1.0


def thermostat(t: float, tau: float = 100.0) -> tuple[float, float, float]:
    """Temperature, state of the heater and number of switchings at a time."""
    T, target, time, count = 0.0, 40.0, 0.0, 0.0
    while True:
        limit = 21.0 if target else 19.0
        there = time + tau * math.log((target - T) / (target - limit))
        if there > t:
            return target + (T - target) * math.exp((time - t) / tau), target / 40.0, count
        T, target, time, count = limit, 40.0 - target, there, count + 1.0


class Clutch(Unit):
    """Two wheels that a clutch with dry friction joins."""

    tau = Input("N.m", text="torque on the first wheel", start=1.0)
    w = State("rad/s", 2, "speed of a wheel", start=[4.0, 0.0])
    w_dot = Derivative(w)
    side = Held("1", text="direction of the slip, 0: it is locked", start=1.0)
    passed = Output("N.m", text="torque from the first to the second wheel")
    met = Event("rad/s", text="slip against its direction")
    broken = Event("N.m", text="torque above the static friction")

    def torque(self):
        return where(np.abs(self.side) < 0.5, self.tau * 2.0 / 3.0, 2.0 * self.side)

    def outputs(self) -> None:
        self.passed = self.torque()

    def derivatives(self) -> None:
        self.w_dot = np.array([self.tau - self.torque(), self.torque() / 2.0])

    def events(self) -> None:
        self.met = -self.side * (self.w[0] - self.w[1])
        self.broken = where(np.abs(self.side) < 0.5, np.abs(self.tau) * 2.0 / 3.0 - 2.5, -1.0)

    def at_met(self) -> None:
        together = (self.w[0] + 2.0 * self.w[1]) / 3.0
        self.w, self.side = np.array([together, together]), 0.0

    def at_broken(self) -> None:
        self.side = np.sign(self.tau)


class Relay(Unit):
    """Relay with hysteresis, without continuous states."""

    u = Input("1", text="signal")
    y = Held("1", text="position", start=-1.0)
    up = Event("1", text="signal above the upper threshold")
    down = Event("1", text="signal below the lower threshold")

    def events(self) -> None:
        self.up, self.down = self.u - 0.5, -0.5 - self.u

    def at_up(self) -> None:
        self.y = 1.0

    def at_down(self) -> None:
        self.y = -1.0


class Lag(Unit):
    """First-order lag, the plant of a relay."""

    u = Input("1", text="signal")
    x = State("1", text="state", start=0.6)
    x_dot = Derivative(x)
    turned = Output("1", text="state with its sign turned")

    def outputs(self) -> None:
        self.turned = -self.x

    def derivatives(self) -> None:
        self.x_dot = self.u - self.x


class Counter(Unit):
    """Counter of the turns of a wheel of constant speed, from the projection of a mark."""

    speed = Parameter("rad/s", text="speed", start=2.0 * math.pi)
    c = State("1", text="first coordinate of the mark", start=1.0)
    s = State("1", text="second coordinate of the mark")
    c_dot = Derivative(c)
    s_dot = Derivative(s)
    turns = Held("1", text="number of turns")
    top = Event("1", text="height of the mark")

    def derivatives(self) -> None:
        self.c_dot, self.s_dot = -self.speed * self.s, self.speed * self.c

    def events(self) -> None:
        self.top = self.c - 0.5

    def at_top(self) -> None:
        self.turns = self.turns + 1.0


def counter(t: float) -> float:
    """Return the number of rises of cos(2 pi t) above 0.5, at 5/6, 11/6, ..."""
    return float(math.floor(t + 1.0 / 6.0))


class Pulse(Unit):
    """A number that is above 0 for a short time in a motion of constant speed, which one internal step covers."""

    width = Parameter("1", text="half the width", start=1e-3)
    x = State("1", text="place")
    x_dot = Derivative(x)
    count = Held("1", text="number of pulses")
    round = Event("1", text="height of a parabola")
    sharp = Event("1", text="height of a triangle")

    def derivatives(self) -> None:
        self.x_dot = 1.0

    def events(self) -> None:
        self.round = self.width**2 - (self.x - 0.777) ** 2
        self.sharp = 0.3 - np.abs(self.x - 2.111)

    def at_round(self) -> None:
        self.count = self.count + 1.0

    def at_sharp(self) -> None:
        self.count = self.count + 1.0


class Chain(Unit):
    """Events, one of which is the cause of the next at the same time."""

    u = Input("1", text="signal")
    a = Held("1", text="first")
    b = Held("1", text="second")
    first = Event("1", text="of the signal")
    second = Event("1", text="of the first")

    def events(self) -> None:
        self.first, self.second = self.u, self.a - 0.5

    def at_first(self) -> None:
        self.a = 1.0

    def at_second(self) -> None:
        self.b = 1.0


class Endless(Unit):
    """Two events, each of which is the cause of the other at the same time."""

    u = Input("1", text="signal")
    a = Held("1", text="state", start=1.0)
    x = State("1", text="another state")
    x_dot = Derivative(x)
    full = Event("1", text="of the signal, and not the state")
    empty = Event("1", text="of the signal and the state")

    def derivatives(self) -> None:
        self.x_dot = self.u

    def events(self) -> None:
        self.full = where(self.u > 0.5, 0.5 - self.a, -1.0)
        self.empty = where(self.u > 0.5, self.a - 0.5, -1.0)

    def at_full(self) -> None:
        self.a = 1.0

    def at_empty(self) -> None:
        self.a = 0.0
