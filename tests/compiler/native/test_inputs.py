"""Inputs that change within a step: rates in FMI 2.0, intermediate updates with early return in FMI 3.0."""

import ctypes as ct
import re
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from tests.compiler.native.binding import ERROR, Instance, doubles, references, same_bits
from tests.compiler.native.calls import Calls

Native = Callable[..., Instance]
H = 1e-3


def rate_arguments(instance: Instance, rates: dict[str, Any], order: int = 1) -> tuple[Any, ...]:
    refs = [v.reference for group in rates for v in instance.model.group(group)]
    values = np.concatenate([np.atleast_1d(rate) for rate in rates.values()])
    return references(refs), len(refs), (ct.c_int * len(refs))(*[order] * len(refs)), doubles(values)


def set_rates(instance: Instance, **rates: Any) -> Instance:
    return instance.do("SetRealInputDerivatives", *rate_arguments(instance, rates))


def test_rates_are_of_second_order_and_held_inputs_of_first(native):
    """Torque A sin(w t) sampled by the importer: halving the step divides the error by 4, and by 2."""
    amplitude, w, stop = 0.2, 60.0, 0.064

    def end(steps: int, rates: bool) -> np.ndarray:
        unit = native().start(tolerance=1e-10, q_0=[0.3, -0.2])
        for k in range(steps):
            t = k * stop / steps
            unit.set(tau=amplitude * np.sin(w * t))
            if rates:
                set_rates(unit, tau=[amplitude * w * np.cos(w * t)] * 2)
            unit.step(stop / steps)
        return unit.get("q")

    exact = end(2048, True)  # its error is 64 times 64 times smaller than that of 32 steps
    for rates, order in ((False, 1.0), (True, 2.0)):
        errors = [np.abs(end(steps, rates) - exact).max() for steps in (32, 64, 128)]
        observed = np.log2(np.array(errors[:-1]) / errors[1:])
        # the error's next term is some H w = 6 % of the first at 64 steps, and may count double in the ratio
        np.testing.assert_allclose(observed, order, atol=0.2)


@pytest.mark.parametrize(
    ("name", "group"), [("controller", "q_d"), ("feedforward", "q_d_ddot"), ("feedforward", "q_d_ddddot")]
)
def test_a_unit_without_states_gives_the_outputs_of_the_end_of_the_step(native, name, group):
    """To the bit: 0.25 + 2 * 2^-10 is exact."""
    size = 2.0**-10
    moving = native(name).start(**{group: 0.25})
    set_rates(moving, **{group: [2.0, 2.0]}).step(size)
    held = native(name).start(**{group: 0.25})
    ended = native(name).start().set(**{group: 0.25 + 2.0 * size}).step(size)
    assert same_bits(moving.outputs(), ended.outputs())
    assert not same_bits(moving.outputs(), held.step(size).outputs())
    assert same_bits(moving.get(group), ended.get(group))


def test_a_rate_holds_for_one_step_and_is_saved_with_the_state(native):
    unit, twin = native().start(q_0=[0.3, 0.1]), native().start(q_0=[0.3, 0.1])
    for instance in (unit, twin):
        set_rates(instance.set(tau=0.1), tau=[50.0, -50.0]).step(H)
    unit.step(H)
    set_rates(twin, tau=[0.0, 0.0]).step(H)
    assert same_bits(unit.outputs(), twin.outputs())
    unit = native().start(q_0=[0.3, 0.1])
    set_rates(unit, tau=[50.0, -50.0])
    saved, data = unit.save(), unit.complete()
    first = unit.step(H).outputs()
    unit.restore(saved)
    unit.time = 0.0
    assert same_bits(unit.step(H).outputs(), first)
    other = native(name="other").start()
    other.restore(other.deserialize(data))
    assert same_bits(other.step(H).outputs(), first)
    assert not same_bits(native().start(q_0=[0.3, 0.1]).step(H).outputs(), first)


def test_a_step_that_fails_or_a_rate_beyond_all_numbers_leaves_inputs_and_rates(native):
    unit, twin = native().start(q_0=[0.3, 0.1]), native().start(q_0=[0.3, 0.1])
    for instance in (unit, twin):
        set_rates(instance.set(tau=0.1), tau=[50.0, -50.0])
    before = unit.complete()
    with unit.refuses("expected a finite positive communication step") as no:
        no("DoStep", 0.0, -H, 1)
    with unit.refuses("expected the communication point") as no:
        no("DoStep", 0.5, H, 1)
    assert unit.complete() == before
    assert same_bits(unit.step(H).outputs(), twin.step(H).outputs())
    unit = native().start()
    set_rates(unit, tau=[1e308, 0.0])
    before = unit.complete()
    with unit.refuses(r"doStep at t = 0 s failed: tau\[1\]: expected a finite number, got inf") as no:
        no("DoStep", 0.0, 10.0, 1)
    assert unit.complete() == before


@pytest.mark.parametrize(("rates", "order", "words"), [
    ({"tau": [1.0, 2.0]}, 2, r"tau\[1\]: expected a derivative of order 1, got one of order 2\."),
    ({"tau": [1.0, 2.0]}, 0, r"of order 0\."),
    ({"tau": [1.0, 2.0]}, -1, r"of order -1\."),
    ({"tau": [1.0, np.nan]}, 1, r"tau\[2\]: expected a finite derivative, got nan\."),
    ({"tau": [1.0, np.inf]}, 1, r"tau\[2\]: expected a finite derivative, got inf\."),
    ({"tau": [1.0, 1.0], "q": [0.0, 0.0]}, 1, r"expected inputs, got q\[1\]\."),
    ({"mass": [0.0, 0.0]}, 1, r"expected inputs, got mass\[1\]\."),
])  # fmt: skip
def test_a_rate_that_makes_no_sense_is_refused_and_none_of_the_call_is_set(native, rates, order, words):
    unit = native().start()
    before = unit.complete()
    with unit.refuses(rf"unit: setRealInputDerivatives at t = 0 s failed: .*{words}") as no:
        no("SetRealInputDerivatives", *rate_arguments(unit, rates, order))
    assert unit.complete() == before


def with_updates(native: Native, update: Callable[..., float | None], name: str = "plant", **options: Any) -> Instance:
    return native(name, "3.0", update=update, **options)


def test_an_intermediate_update_shows_the_motion_within_the_step(native):
    """Values at an internal step are those of a run with a step to there; both err by some 1e-10 a step."""
    seen: list[tuple[float, bool, bool, np.ndarray]] = []

    def look(unit: Instance, time: float, requested: bool, early: bool) -> None:
        seen.append((time, requested, early, np.append(unit.outputs(), unit.get("time"))))

    unit = with_updates(native, look).start(2.0, tolerance=1e-10, q_0=[0.4, -0.3], tau=0.2)
    unit.step(0.01)
    times = np.array([time for time, *_ in seen])
    assert len(seen) > 3
    assert np.all(np.diff(times) > 0.0)
    assert times[0] > 2.0
    assert times[-1] == 2.0 + 0.01
    # inputs may be set where the step goes on; this importer allowed no early return
    assert [requested for _, requested, *_ in seen] == [True] * (len(seen) - 1) + [False]
    assert not any(early for _, _, early, _ in seen)
    assert same_bits(seen[-1][3][:-1], unit.outputs())
    other = native("plant", "3.0").start(2.0, tolerance=1e-10, q_0=[0.4, -0.3], tau=0.2)
    for time, *_, values in seen:
        assert values[-1] == time
        other.step(time - other.time)
        np.testing.assert_allclose(values[:-1], other.outputs(), rtol=1e-8, atol=1e-8)


def test_looking_changes_nothing(native):
    looks: list[np.ndarray] = []
    looked = with_updates(native, lambda unit, *_: looks.append(unit.outputs()), early=True).start(q_0=[0.4, -0.3])
    alone = native("plant", "3.0").start(q_0=[0.4, -0.3])
    for k in range(20):
        for unit in (looked, alone):
            unit.step(H, tau=0.1 * np.sin(k))
        assert same_bits(looked.outputs(), alone.outputs())
    assert len(looks) > 20
    assert looked.complete() == alone.complete()


def test_an_input_that_is_set_within_the_step_counts_from_there(native):
    """Against a run whose step ends at that time; both err by some 1e-10 a step."""
    at: list[float] = []

    def change(unit: Instance, time: float, requested: bool, early: bool) -> None:
        if not at and time > 3e-3:
            at.append(time)
            unit.set(tau=[0.5, -0.4])

    unit = with_updates(native, change).start(tolerance=1e-10, q_0=[0.4, -0.3], tau=0.1).step(0.01)
    other = native("plant", "3.0").start(tolerance=1e-10, q_0=[0.4, -0.3], tau=0.1).step(at[0])
    same = native("plant", "3.0").start(tolerance=1e-10, q_0=[0.4, -0.3], tau=0.1).step(0.01)
    other.step(0.01 - at[0], tau=[0.5, -0.4])
    assert same_bits(unit.get("tau"), [0.5, -0.4])
    np.testing.assert_allclose(unit.outputs(), other.outputs(), rtol=1e-8, atol=1e-8)
    assert np.abs(unit.get("q") - same.get("q")).max() > 1e-5


@pytest.mark.parametrize(
    ("wanted", "expected"),
    [(0.0042, 0.0042), (0.0, None), (-np.inf, None), (np.nan, None), (0.01, 0.01), (5.0, 0.01), (np.inf, 0.01)],
)
def test_a_step_returns_early_at_the_time_that_is_asked_for(native, wanted, expected):
    """A time in the past, or none, is now: the end of the internal step. The end or later is no early return."""
    asked: list[float] = []

    def stop(unit: Instance, time: float, requested: bool, early: bool) -> float | None:
        if early and not asked and time > 1e-3:
            asked.append(time)
            return wanted
        return None

    unit = with_updates(native, stop, early=True).start(tolerance=1e-10, q_0=[0.4, -0.3]).step(0.01)
    end = asked[0] if expected is None else expected
    assert unit.early == (end < 0.01)
    assert unit._last.value == unit.time == end
    other = native("plant", "3.0").start(tolerance=1e-10, q_0=[0.4, -0.3]).step(end)
    np.testing.assert_allclose(unit.outputs(), other.outputs(), rtol=1e-8, atol=1e-8)
    unit.step(0.01)  # goes on from there
    np.testing.assert_allclose(unit.outputs(), other.step(0.01).outputs(), rtol=1e-8, atol=1e-8)


def test_an_early_return_that_was_not_allowed_is_not_made_and_without_states_there_is_one_update(native):
    flags: list[bool] = []

    def stop(unit: Instance, time: float, requested: bool, early: bool) -> float:
        flags.append(early)
        return time

    unit = with_updates(native, stop).start(q_0=[0.4, -0.3]).step(0.01)
    assert unit.time == 0.01
    assert not unit.early
    assert not any(flags)
    seen: list[tuple[float, bool, bool]] = []

    def look(unit: Instance, *said: Any) -> None:
        seen.append(said)
        unit.outputs()

    unit = with_updates(native, look, "controller", early=True).start(q_d=0.1)
    unit.step(H).step(H)
    assert seen == [(H, False, False), (2 * H, False, False)]


def test_a_step_that_fails_after_intermediate_updates_is_as_if_it_had_not_been(native):
    def overload(unit: Instance, time: float, requested: bool, early: bool) -> None:
        if requested:
            unit.set(tau=[1e300, 0.0])

    unit = with_updates(native, overload, early=True).start(q_0=[0.4, -0.3]).set(tau=0.1)
    before = unit.complete()
    with unit.refuses(
        r"doStep at t = 0 s failed: at t = \S+ s .*state \w+\[\d\] .*internal step reached its minimum"
    ) as no:
        no("DoStep", *unit.step_arguments(0.0, 0.01))
    assert unit.complete() == before
    unit.update = lambda *_: None
    twin = native("plant", "3.0").start(q_0=[0.4, -0.3]).set(tau=0.1)
    assert same_bits(unit.step(H).outputs(), twin.step(H).outputs())


ALLOWED = r"(Get|Set)(U?Int\d+|Float\d+|Boolean|String|Binary|Clock|(Shift|Interval)\w+)|Get\w*Dependencies"
"""Functions that are allowed in an intermediate update; those of a fixed parameter alone are refused."""


def test_within_a_step_nothing_else_is_allowed(native):
    """Reading all and setting inputs is; every other call is refused and changes nothing."""
    calls = Calls(native("plant", "3.0").start())  # whose memory stays where it is
    outcomes: dict[str, tuple[int, list[str]]] = {}

    def misuse(unit: Instance, time: float, requested: bool, early: bool) -> None:
        for name, arguments in {} if outcomes else calls.all.items():
            count = len(unit.messages)
            outcomes[name] = unit.call(name, *arguments), [message.text for message in unit.messages[count:]]

    unit = with_updates(native, misuse, early=True).start(q_0=[0.4, -0.3]).step(0.01)
    refused = {name: texts for name, (status, texts) in outcomes.items() if status == ERROR}
    allowed = {name for name in calls.all if re.fullmatch(ALLOWED, name)} - {"SetFloat64", "SetBoolean"}
    assert refused.keys() == calls.all.keys() - allowed
    for name, texts in refused.items():
        (text,) = texts
        assert re.match(rf"unit: {name[0].lower()}{name[1:]} at t = .*failed: ", text), text
    alone = native("plant", "3.0").start(q_0=[0.4, -0.3]).step(0.01)
    assert same_bits(unit.outputs(), alone.outputs())
