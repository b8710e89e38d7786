"""Units with events in numpy, against closed forms; what is refused, and how."""

import numpy as np
import pytest

from tests.compiler.eventful import Ball, Clutch, Counter, Endless, Pulse, Relay, Thermostat, ball, counter
from vdfmu.base.errors import KernelError, UnitError
from vdfmu.compiler.unit.interface import Interface
from vdfmu.unit import Derivative, Event, Held, Input, Output, Parameter, Sampled, State, Unit


@pytest.mark.parametrize("step", [0.1, 0.5])
def test_a_ball_bounces(step):
    solution = Ball().simulate(stop=2.5, step=step, tolerance=1e-12)
    expected = np.array([ball(t) for t in solution.t])
    # 1e-12 of each of 8 parts of 25 intervals; 11 bounces after one another share the error of the time, and a velocity
    # of 0.1 m/s has it 100 times
    np.testing.assert_allclose(solution["h"], expected[:, 0], atol=1e-9)
    np.testing.assert_allclose(solution["v"], expected[:, 1], atol=1e-7)
    assert np.array_equal(solution["bounces"], expected[:, 2])
    assert expected[-1, 2] == 11.0


def test_a_clutch_locks_and_slips_again():
    """Slip 4 - 2 t until 2 s, then both at 4/3 + ..; a torque of 6 N.m from 4 s on breaks it."""
    solution = Clutch().simulate({"tau": lambda t: 1.0 if t < 4.0 else 6.0}, stop=5.0, step=0.25, tolerance=1e-12)
    t = solution.t
    slipping = np.stack([4.0 - t, t], axis=1)
    locked = (2.0 + (t - 2.0) / 3.0)[:, None] * [1.0, 1.0]
    broken = locked[t == 4.0] + np.outer(t - 4.0, [4.0, 1.0])
    expected = np.where(t[:, None] <= 2.0, slipping, np.where(t[:, None] <= 4.0, locked, broken))
    np.testing.assert_allclose(solution["w"], expected, atol=1e-9)  # 1e-12 of 160 parts
    between = (t != 2.0) & (t != 4.0)  # where rounding decides
    assert np.array_equal(solution["side"][between], np.where((t > 2.0) & (t < 4.0), 0.0, 1.0)[between])


def test_a_counter_counts():
    solution = Counter().simulate(stop=20.0, step=0.5)
    assert np.array_equal(solution["turns"], [counter(t) for t in solution.t])


@pytest.mark.parametrize(("width", "count"), [(1e-6, 2.0), (1e-3, 2.0), (0.5, 2.0)])
def test_two_changes_in_an_interval_are_found(width, count):
    """A parabola however narrow, and a triangle that is wider than an eighth of the interval."""
    assert Pulse(width=width).simulate(stop=4.0, step=4.0)["count"][-1] == count


def test_a_relay_without_states_looks_at_the_rows():
    t = np.linspace(0.0, 2.0, 201)
    solution = Relay().simulate({"u": lambda t: np.sin(2.0 * np.pi * t)}, stop=2.0, step=0.01)
    expected, y = [], -1.0
    for u in np.sin(2.0 * np.pi * t):
        y = 1.0 if u > 0.5 else -1.0 if u < -0.5 else y
        expected.append(y)
    assert np.array_equal(solution["y"], expected)


@pytest.mark.heavy
def test_bounces_without_an_end_end_with_a_sentence():
    words = "events do not end: there are more than 1000 in one interval, the last of ground. Let at_ground stop"
    with pytest.raises(KernelError, match=rf"at t = 2\.5\d* s {words}"):
        Ball().simulate(stop=3.0, step=0.5)


def test_events_without_an_end_at_one_time_end_with_a_sentence():
    with pytest.raises(KernelError, match="events do not end: there are more than 100 at one time, the last of"):
        Endless().simulate({"u": lambda t: float(t > 0.2)}, stop=1.0, step=0.5)


def test_linear_models_hold_held_states():
    model = Thermostat().linearize()
    assert "held states are assumed to be constant: on, switched" in model.notes
    assert model.A.tolist() == [[-0.01]]


def declared(**members):
    return type("Wrong", (Unit,), {"u": Input("1"), "__module__": __name__, **members})


def sets(name, value=0.0):
    return lambda self: setattr(self, name, value)


STATE = State("1")
MOVING = {"x": STATE, "x_dot": Derivative(STATE), "derivatives": sets("x_dot")}
EVENTS = {"e": Event("1"), "events": sets("e")}


@pytest.mark.parametrize(("members", "words"), [
    (EVENTS, "e is an event and needs a method at_e that sets states"),
    ({"y": Output("1"), "outputs": sets("y"), "events": sets("y")}, r"events\(\) needs events: declare one"),
    (MOVING | EVENTS | {"at_e": sets("x"), "at_f": sets("x")}, r"at_f is for an event that is not declared: f = Event"),
    ({"m": Held("1")}, "m is a held state, which methods of events set: declare one"),
    (MOVING | {"e": Event("1", 2), "events": sets("e"), "at_e": sets("x")}, "e is an event and must have no shape"),
    (MOVING | EVENTS | {"at_e": sets("u")}, r"at_e\(\) must not set u, an input"),
    (MOVING | EVENTS | {"at_e": sets("x_dot")}, r"at_e\(\) must not set x_dot, a derivative"),
    (MOVING | EVENTS | {"at_e": sets("z")}, r"at_e\(\) sets z, which Wrong does not declare"),
    (MOVING | {"e": Event("1"), "at_e": sets("x")}, r"events\(\) of Wrong never sets e"),
    (MOVING | EVENTS | {"at_e": sets("x"), "outputs": sets("e")}, r"outputs\(\) must not set e, an event indicator"),
    (MOVING | EVENTS | {"at_e": sets("x"), "events": lambda s: (setattr(s, "e", 0.0), setattr(s, "x", 0.0))},
     r"events\(\) must not set x, a continuous state"),
    (EVENTS | {"s": Sampled("1"), "period": Parameter("s", start=1e-3, minimum=1e-6), "update": sets("s"),
               "at_e": sets("s")}, r"at_e\(\) must not set s, a sampled state"),
])  # fmt: skip
def test_wrong_declarations_are_refused(members, words):
    with pytest.raises(UnitError, match=words):
        _ = Interface(declared(**members), None).program


class Sentinel(Unit):
    """Clock that starts again, with a number that jumps between infinite values."""

    x = State("s", text="time since the last event")
    x_dot = Derivative(x)
    count = Held("1", text="number of events")
    full = Event("1", text="whether the time is over")

    def derivatives(self) -> None:
        self.x_dot = 1.0

    def events(self) -> None:
        self.full = np.where(self.x > 0.5, 1e200 * (1.0 + self.x) * 1e200, -1.0)

    def at_full(self) -> None:
        self.x, self.count = 0.0, self.count + 1.0


@pytest.mark.filterwarnings("ignore:overflow:RuntimeWarning")
def test_a_number_that_jumps_to_infinity_is_an_event_where_it_jumps():
    solution = Sentinel().simulate(stop=2.25, step=0.75, tolerance=1e-12)
    np.testing.assert_allclose(solution["x"], [0.0, 0.25, 0.5, 0.25], atol=1e-9)  # 1e-12 of 24 parts
    assert np.array_equal(solution["count"][[0, 1, 3]], [0.0, 1.0, 4.0])
