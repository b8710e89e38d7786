"""References of systems that are not the shipped ones, against solutions by hand."""

import dataclasses
from pathlib import Path

import numpy as np
import pytest
from scipy.linalg import expm

from vdfmu.arm.fmus import build_fmus
from vdfmu.base.errors import UsageError, VdfmuError
from vdfmu.system.package.description import SystemDescription
from vdfmu.system.reference.reference import reference
from vdfmu.system.scenario import load_scenario
from vdfmu.system.scenario.system_file import Part, SystemFile
from vdfmu.unit import Derivative, Input, Output, Parameter, Sampled, State, Unit


class Wish(Unit):
    """Desired position."""

    r = Output("1", text="position")

    def outputs(self) -> None:
        """Follow a sine."""
        self.r = np.sin(self.t)


class Feedback(Unit):
    """Controller with feed-through."""

    r = Input("1")
    z = Input("1")
    u = Output("1")
    K = Parameter("1", start=3.0)

    def outputs(self) -> None:
        """Proportional feedback."""
        self.u = self.K * (self.r - self.z)


class Oscillator(Unit):
    """Mass on a spring, with an accelerometer, which feeds through."""

    u = Input("1")
    x = State("1", start=0.2)
    v = State("1")
    x_dot = Derivative(x)
    v_dot = Derivative(v)
    a = Output("1")

    def outputs(self) -> None:
        """Acceleration."""
        self.a = self.u - self.x

    def derivatives(self) -> None:
        """Newton's law."""
        self.x_dot, self.v_dot = self.v, self.u - self.x


class Sensor(Unit):
    """Sampled filter of position and acceleration."""

    x = Input("1")
    a = Input("1")
    period = Parameter("s", start=0.02, minimum=1e-6)
    z = Sampled("1", start=0.1, delayed=True)

    def update(self) -> None:
        """Half of the old value, a quarter of each new one."""
        self.z = 0.5 * self.z + 0.25 * self.x + 0.25 * self.a


class PlainSensor(Sensor):
    """The same, not traced."""

    backend = "python"


class Count(Unit):
    """Number of samples."""

    period = Parameter("s", start=0.1, minimum=1e-6)
    count = Sampled("1")

    def update(self) -> None:
        """One more."""
        self.count = self.count + 1.0


class Line(Unit):
    """A straight line, twice."""

    u = Input("1")
    w = Input("1")
    y = Output("1")
    s = Output("1")
    gain = Parameter("1", start=0.5)

    def outputs(self) -> None:
        """Each output from its own input."""
        self.y = self.gain * self.u + 1.0
        self.s = 3.0 * self.w


def made(connections, values=None, **units):
    system = SystemFile("made", "", Path(), {name: Part(unit) for name, unit in units.items()}, connections, {})
    scenario = dataclasses.replace(load_scenario("planar_tracking"), system=system)
    return SystemDescription(scenario, {name: {} for name in units} | (values or {}))


H, STOP = 0.01, 1.0
CONTROLLED = {
    "wish.r": ["feedback.r"], "feedback.u": ["oscillator.u"], "oscillator.x": ["sensor.x"],
    "oscillator.a": ["sensor.a"], "sensor.z": ["feedback.z"],
}  # fmt: skip


def moved(x, v, u, duration):
    c, s = np.cos(duration), np.sin(duration)
    return u + (x - u) * c + v * s, v * c - (x - u) * s


def times_of_samples(begin, end, period):
    k = np.arange(round(begin / period) - 2, round(end / period) + 3)
    times = k[k >= 0] * period
    return times[(times > begin - 1e-9) & (times < end - 1e-9)]


def by_hand(name, period):
    x, v, z, K = 0.2, 0.0, 0.1, 3.0
    m = round(STOP / H)
    if name == "continuous":
        # states x, v, z, sin(t), cos(t): linear between the samples
        u = np.array([0.0, 0.0, -K, K, 0.0])
        A = np.array([[0, 1, 0, 0, 0], [-1, 0, 0, 0, 0], [0, 0, 0, 0, 0], [0, 0, 0, 0, 1], [0, 0, 0, -1, 0.0]])
        A[1] += u
        state, t, rows = np.array([x, v, z, 0.0, 1.0]), 0.0, []
        for k in range(m + 1):
            for sample in times_of_samples(t, k * H, period):
                state, t = expm(A * (sample - t)) @ state, sample
                state[2] = 0.5 * state[2] + 0.25 * state[0] + 0.25 * (u @ state - state[0])
            state, t = expm(A * (k * H - t)) @ state, k * H
            rows.append([state[2], u @ state, state[0]])
        return np.array(rows)
    u = K * (0.0 - z)
    a, r = u - x, 0.0
    rows = [[z, u, x]]
    for k in range(m):
        new = K * (r - z)
        force = u if name == "sampled-delayed" else new
        x_new, v_new = moved(x, v, force, H)
        seen = a if name == "sampled-delayed" else force - x_new
        for _ in times_of_samples(k * H, (k + 1) * H, period):
            z = 0.5 * z + 0.25 * x + 0.25 * seen
        x, v, u, a, r = x_new, v_new, new, force - x_new, np.sin((k + 1) * H)
        rows.append([z, u, x])
    return np.array(rows)


@pytest.mark.few(6)
@pytest.mark.parametrize("sensor", [Sensor, PlainSensor])
@pytest.mark.parametrize("period", [0.02, 0.015, 0.004])
@pytest.mark.parametrize("name", ["sampled", "sampled-delayed", "continuous"])
def test_a_system_of_other_wiring_is_solved_as_by_hand(name, period, sensor):
    """Scipy's local error, 1e-11 of states below 2, adds up over 100 steps: 2e-9."""
    system = made(
        CONTROLLED, {"sensor": {"period": period}}, wish=Wish, sensor=sensor, oscillator=Oscillator, feedback=Feedback
    )  # fmt: skip
    solution = reference(name, system, step=H, stop=STOP)
    states = np.hstack([solution[key] for key in ("sensor.z", "feedback.u", "oscillator.x")])
    np.testing.assert_allclose(states, by_hand(name, period), rtol=0.0, atol=2e-9)


@pytest.mark.parametrize("name", ["sampled", "sampled-delayed", "continuous"])
def test_samples_at_the_same_time_are_taken_once_each(name):
    """3 x 0.1 is not 0.3 to the bit."""
    system = made({}, {"slow": {"period": 0.3}}, fast=Count, slow=Count)
    solution = reference(name, system, step=0.1, stop=3.0)
    k = np.arange(31)
    np.testing.assert_array_equal(solution["fast.count"][:, 0], k)
    np.testing.assert_array_equal(solution["slow.count"][:, 0], -(-k // 3))


def test_units_that_read_each_other_and_themselves_need_no_loop():
    """Each output of a Line has its own input: a chain of four outputs that goes through two units, back and forth."""
    system = made({"wish.r": ["a.u"], "a.y": ["b.w"], "b.s": ["b.u"], "b.y": ["a.w"]}, a=Line, b=Line, wish=Wish)
    solution = reference("continuous", system, step=0.1, stop=1.0)
    expected = 3.0 * (0.5 * 3.0 * (0.5 * np.sin(solution.t) + 1.0) + 1.0)
    np.testing.assert_allclose(solution["a.s"][:, 0], expected, rtol=1e-14)  # some ten operations
    with pytest.raises(UsageError, match=r"no sampled reference: (a|b) -> .* would each have to step before the next"):
        reference("sampled", system, step=0.1, stop=1.0)


@pytest.mark.parametrize("name", ["sampled", "sampled-delayed", "continuous"])
def test_an_algebraic_loop_is_named(name):
    system = made({"a.y": ["b.u"], "b.y": ["a.u"]}, a=Line, b=Line)
    with pytest.raises(
        UsageError, match=r"there is no reference: algebraic loop at the start: (a\.y -> b\.y|b\.y -> a\.y) -> "
    ):
        reference(name, system, step=0.1, stop=1.0)


class Lag(Unit):
    """A fast sensor."""

    K = Parameter("1/s")
    x = State("1", start=2.0)
    x_dot = Derivative(x)
    y = Output("1")

    def outputs(self) -> None:
        """Measured value."""
        self.y = self.x

    def derivatives(self) -> None:
        """Tend to a cosine."""
        self.x_dot = self.K * (np.cos(self.t) - self.x)


@pytest.mark.parametrize("K", [1e6, 1e17])
def test_a_stiff_unit_has_a_continuous_reference(K):
    """Too stiff for an explicit method, in 1e5 steps of each 0.1 s."""
    system = made({}, {"lag": {"K": K}}, lag=Lag)
    solution = reference("continuous", system, step=0.1, stop=1.0)
    exact = np.cos(solution.t[1:]) + np.sin(solution.t[1:]) / K
    np.testing.assert_allclose(solution["lag.y"][1:, 0], exact, rtol=0.0, atol=1e-11)
    with pytest.raises(VdfmuError, match=r"lag has no finite state after t = .* s, or is too stiff for its"):
        reference("sampled", system, step=0.1, stop=1.0)


def test_an_fmu_of_another_tool_has_no_reference(tmp_path):
    fmu = build_fmus(None, tmp_path, units=[Wish])["wish"]
    system = made({"wish.r": ["feedback.r"]}, wish=str(fmu), feedback=Feedback)
    with pytest.raises(UsageError, match="no reference: wish is an FMU of another tool"):
        reference("continuous", system, step=0.1, stop=1.0)
