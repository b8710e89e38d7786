"""Wrong arguments are refused with words, change nothing, and the instance goes on to the bit.

test_as_python.py repeats the tests of the Python units' words; test_every_call.py has every function in every phase.
"""

from __future__ import annotations

import ctypes as ct
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from tests.compiler.native.binding import DISCARD, ERROR, OK, Instance, doubles, references, same_bits
from tests.compiler.native.fmi_types import LOG_2, Callbacks
from tests.compiler.native.test_every_call import PHASES, bring
from vdfmu.compiler.unit.integrator import MAXIMUM_STEPS

Native = Callable[..., Instance]
NAN, INF = float("nan"), float("inf")
H = 1e-3


# ------------------------------------------------------------------ numbers that are none, steps, times


def test_discard_where_the_standard_says_so(native: Native, version: str) -> None:
    """Time and states that an integrator tries, and derivatives that overflow: it may try others."""
    unit = bring(native("plant", version, kind="ModelExchange"), "continuous")
    before = unit.complete()
    derivatives = "GetDerivatives" if version == "2.0" else "GetContinuousStateDerivatives"
    for value, text in ((NAN, "nan"), (INF, "inf"), (-INF, "-inf")):
        with unit.refuses(rf"setTime at t = 1 s failed: expected a finite time, got {text} s\.", DISCARD) as no:
            no("SetTime", value)
        x = np.zeros(8)
        x[5] = value
        with unit.refuses(
            rf"setContinuousStates .* failed: kappa_dot\[2\]: expected a finite number, got {text} rad/s\.", DISCARD
        ) as no:
            no("SetContinuousStates", doubles(x), 8)
        assert unit.complete() == before
    x = unit.get_states()
    unit.states(np.full(8, 1e300))
    room = (ct.c_double * 8)()
    with unit.refuses(r"der\(\w+(\[\d\])?\)(\[\d\])? is not finite\.", DISCARD) as no:
        no(derivatives, room, 8)
    assert not any(room)
    unit.states(x)
    twin = bring(native("plant", version, kind="ModelExchange"), "continuous")
    assert same_bits(unit.derivatives(), twin.derivatives())


@pytest.mark.parametrize("size", [0.0, -0.0, -H, NAN, INF, -INF])
def test_a_step_that_is_not_positive_and_finite_is_refused(
    native: Native, version: str, unit_name: str, size: float
) -> None:
    unit, twin = native(unit_name, version).start().step(), native(unit_name, version).start().step()
    before = unit.complete()
    words = rf"unit: doStep at t = 0.001 s failed: expected a finite positive communication step, got {size} s\."
    with unit.refuses(words) as no:
        no("DoStep", *unit.step_arguments(H, size))
    assert unit.complete() == before
    assert same_bits(unit.step().outputs(), twin.step().outputs())


@pytest.mark.parametrize("point", [0.0, 2 * H, H + 2e-9, -H, NAN, INF, 1e308])
def test_a_step_from_elsewhere_is_refused(native: Native, version: str, unit_name: str, point: float) -> None:
    unit = native(unit_name, version).start().step()
    before = unit.complete()
    words = r"unit: doStep at t = 0.001 s failed: expected the communication point t = 0.001 s, .*, got t = \S+ s\."
    with unit.refuses(words) as no:
        no("DoStep", *unit.step_arguments(point, H))
    assert unit.complete() == before


def test_a_step_to_a_time_beyond_all_numbers_is_refused(native: Native, version: str) -> None:
    unit = native("controller", version).start(1.7e308)
    with unit.refuses("expected a step that ends at a finite time, got 1e") as no:
        no("DoStep", *unit.step_arguments(1.7e308, 1e308))


@pytest.mark.parametrize(
    ("experiment", "words"),
    [
        ((1, 0.0, 0.0, 0, 0.0), r"expected a finite positive tolerance, got 0\.0\."),
        ((1, -1e-6, 0.0, 0, 0.0), r"expected a finite positive tolerance, got -1e-06\."),
        ((1, NAN, 0.0, 0, 0.0), r"expected a finite positive tolerance, got nan\."),
        ((1, INF, 0.0, 0, 0.0), r"expected a finite positive tolerance, got inf\."),
        ((1, 1e-17, 0.0, 0, 0.0), r"tolerance: expected at least 1e-12, got 1e-17\."),
        ((1, 0.5, 0.0, 0, 0.0), r"tolerance: expected at most 0.1, got 0.5\."),
        ((0, 0.0, NAN, 0, 0.0), r"expected a finite start time, got nan s\."),
        ((0, 0.0, INF, 0, 0.0), r"expected a finite start time, got inf s\."),
        ((0, 0.0, 1.0, 1, 0.5), r"expected a finite stop time not before the start time 1\.0 s, got 0\.5 s\."),
        ((0, 0.0, 1.0, 1, NAN), r"got nan s\."),
        ((0, 0.0, 1.0, 1, INF), r"got inf s\."),
    ],
)
@pytest.mark.parametrize("kind", PHASES)
def test_an_experiment_that_makes_no_sense_is_refused(
    native: Native, version: str, kind: str, experiment: tuple[Any, ...], words: str
) -> None:
    unit, twin = (native("plant", version, kind=kind) for _ in range(2))
    name = "SetupExperiment" if version == "2.0" else "EnterInitializationMode"
    if kind == "ModelExchange" and "tolerance: " in words:  # of the unit's own solver, which does not run there
        assert unit.call(name, *experiment) == OK
        return
    before = unit.complete()
    with unit.refuses(rf"unit: {name[0].lower()}{name[1:]} failed: .*{words}") as no:
        no(name, *experiment)
    assert unit.complete() == before
    unit.start()
    assert unit.complete() == twin.start().complete()


def test_a_step_beyond_the_stop_time_is_refused(native: Native, version: str) -> None:
    for unit_name in ("plant", "controller"):
        unit = native(unit_name, version)
        if version == "2.0":
            unit.do("SetupExperiment", 0, 0.0, 1.0, 1, 1.002).do("EnterInitializationMode")
        else:
            unit.do("EnterInitializationMode", False, 0.0, 1.0, True, 1.002)
        unit.time = 1.0
        unit.do("ExitInitializationMode").step().step()  # ends at 1.002 except for rounding
        before = unit.complete()
        with unit.refuses(r"expected a step that ends by the stop time t = 1\.002 s, got .* t = 1\.003") as no:
            no("DoStep", *unit.step_arguments(1.002, 1e-3))
        assert unit.complete() == before


def test_a_step_below_the_rounding_of_time_is_refused(native: Native, version: str) -> None:
    unit = native("plant", version).start(1e9)
    before = unit.complete()
    with unit.refuses(r"expected a step that moves the time t = 1000000000\.0 s, got one of 1e-08 s") as no:
        no("DoStep", *unit.step_arguments(1e9, 1e-8))
    assert unit.complete() == before


def test_categories_are_switched_one_by_one(native: Native, version: str) -> None:
    unit = native("controller", version)

    def said(*call: Any) -> bool:
        count = len(unit.messages)
        assert unit.call(*call) == ERROR
        return len(unit.messages) > count

    def switch(on: bool, category: bytes) -> None:
        unit.do("SetDebugLogging", on, 1, (ct.c_char_p * 1)(category))

    wrong = ("ExitInitializationMode",)
    assert said(*wrong)
    switch(False, b"logEvents")
    assert said(*wrong)
    switch(False, b"logStatusError")
    assert not said(*wrong)
    switch(True, b"logStatusDiscard")
    assert not said(*wrong)
    switch(True, b"logAll")
    assert said(*wrong)


def test_a_unit_without_a_solver_takes_any_positive_tolerance(native: Native, version: str) -> None:
    native("controller", version).start(tolerance=1e-17).step()


# ------------------------------------------------------------------ parameters that are not physical


@pytest.mark.parametrize(
    ("name", "variable", "value", "words"),
    [
        ("plant", "f_s[1]", 0.1, r"f_s\[1\]: expected f_s >= f_c, got f_s\[1\] = 0.1 N.m, f_c\[1\] = 0.3 N.m\."),
        ("feedforward", "f_c[2]", 0.9, r"f_s\[2\]: expected f_s >= f_c, got f_s\[2\] = 0.2 N.m, f_c\[2\] = 0.9 N.m\."),
        ("plant", "inertia[2,2,2]", -0.1, r"expected a positive definite inertia matrix, got .*\[2,2,2\] = -0.1 kg.m2"),
        ("plant", "inertia[1,1,1]", 0.5, r"expected no principal moment of inertia above the sum .*, got .*0.5 kg.m2"),
    ],
)  # fmt: skip
@pytest.mark.parametrize("late", [False, True])
def test_parameters_that_do_not_fit_together_are_refused_when_the_unit_starts(
    native: Native, version: str, name: str, variable: str, value: float, words: str, late: bool
) -> None:
    unit = native(name, version).setup()
    good = unit.get(variable)
    if late:
        unit.enter()
    unit.set_one(variable, value)
    before = unit.complete()
    call = "exitInitializationMode" if late else "enterInitializationMode"
    with unit.refuses(rf"^unit: {call} failed: .*{words}") as no:
        if late:
            no("ExitInitializationMode")
        else:
            no("EnterInitializationMode", *(() if version == "2.0" else (False, 0.0, 0.0, False, 0.0)))
    assert unit.complete() == before
    unit.set_one(variable, good)
    if not late:
        unit.enter()
    unit.do("ExitInitializationMode").step()


def test_all_that_is_not_physical_is_told_at_once(native: Native, version: str) -> None:
    unit = native("plant", version).setup().set(f_s=[0.1, 0.05])
    with unit.refuses(r"f_s\[1\]: .*f_s\[2\]: ") as no:
        no("EnterInitializationMode", *(() if version == "2.0" else (False, 0.0, 0.0, False, 0.0)))


def test_outputs_have_no_value_before_the_initialization(native: Native, version: str, unit_name: str) -> None:
    unit = native(unit_name, version)
    given = unit.model.of("input", "parameter")
    assert len(unit.read(given))
    for v in unit.model.of("output", "local"):
        with unit.refuses(r"it has no value before enterInitializationMode\.") as no:
            no(f"Get{unit._type('Real')}", *unit._values([v], unit._room("Real", len(v.names))))


# ------------------------------------------------------------------ the solver


@pytest.mark.parametrize("torque", [1e12, 1e300, 1.7e308])
def test_a_step_that_the_solver_cannot_make_is_told_with_time_and_state(
    native: Native, version: str, torque: float
) -> None:
    unit, twin = (native("plant", version).start(q_0=[0.3, 0.1]).step() for _ in range(2))
    for tau in ([torque, -torque], [0.0, torque]):
        unit.set(tau=tau)
        before = unit.complete()
        words = (
            r"^unit: doStep at t = 0.001 s failed: at t = 0\.00\d+ s (state \w+\[\d\] is not finite|the local error "
            r"of state \w+\[\d\] is \S+ times the tolerance 1e-07), and the internal step reached its minimum "
            r"1e-12 s\. Check its inputs and the gains behind them, its start and its parameters, or loosen the "
            r"tolerance\.$"
        )
        with unit.refuses(words) as no:
            no("DoStep", *unit.step_arguments(unit.time, H))
        assert unit.complete() == before
    unit.set(tau=0.0)
    assert same_bits(unit.step().outputs(), twin.step().outputs())


@pytest.mark.heavy
def test_a_step_of_too_many_internal_steps_ends_with_an_error(native: Native, version: str) -> None:
    """Seconds instead of for ever, with torques that turn the arm; 10 s as one step take a tenth of the limit."""
    unit = native("plant", version).start(tau=0.05).step(10.0)
    before = unit.complete()
    words = (
        r"^unit: doStep at t = 10 s failed: at t = \S+ s the communication step of 1e\+300 s is not done after "
        rf"{MAXIMUM_STEPS} internal steps, the last of \S+ s\. Take shorter communication steps\. Check its "
        r"inputs and the gains behind them, its start and its parameters, or loosen the tolerance\.$"
    )
    with unit.refuses(words) as no:
        no("DoStep", *unit.step_arguments(10.0, 1e300))
    assert unit.complete() == before


# ------------------------------------------------------------------ instantiation, messages


@pytest.mark.parametrize("guid", ["", "{0}", "{" + "a" * 5000, "%s%n%d"])
def test_another_guid_is_refused_with_both(model: Callable[..., Any], version: str, guid: str) -> None:
    found = model("plant", version)
    instance = Instance(found, guid=guid)
    assert instance.pointer is None
    (message,) = instance.messages
    assert message.status == ERROR
    call = "instantiate" if version == "2.0" else "instantiateCoSimulation"
    shown = guid[:100] if version == "3.0" else guid[:100].replace("%", "%%")
    assert message.text == f"unit: {call} failed: expected the GUID or instantiation token {found.guid}, got {shown}."


def test_a_name_that_is_missing_is_refused(model: Callable[..., Any], version: str) -> None:
    instance = Instance(model("plant", version), name="")
    assert instance.pointer is None
    assert "failed: expected a name of the instance, got an empty one." in instance.messages[-1].text


def test_units_without_states_are_for_co_simulation_only(model: Callable[..., Any], version: str) -> None:
    for name in ("trajectory", "feedforward", "controller"):
        instance = Instance(model(name, version), kind="ModelExchange")
        assert instance.pointer is None
        assert "has no continuous states and is for co-simulation only." in instance.messages[-1].text


def test_null_pointers_at_instantiation_are_refused(model: Callable[..., Any]) -> None:
    two, three = model("plant", "2.0"), model("plant", "3.0")
    said: list[str] = []
    log = LOG_2(lambda *a: said.append(a[4].decode()))
    make = two.function("Instantiate")
    guid = two.guid.encode()
    assert make(b"unit", 1, guid, None, None, 0, 0) is None
    assert make(None, 1, guid, None, ct.byref(Callbacks(log)), 0, 0) is None
    assert make(b"unit", 1, None, None, ct.byref(Callbacks(log)), 0, 0) is None
    assert len(said) == 2
    pointer = make(b"unit", 1, guid, None, ct.byref(Callbacks()), 0, 1)  # no logger: silent
    assert pointer
    assert two.function("DoStep")(pointer, 0.0, -1.0, 1) == ERROR
    two.function("FreeInstance")(pointer)
    two.function("FreeInstance")(None)
    assert make(b"unit", 7, guid, None, ct.byref(Callbacks(log)), 0, 0) is None
    assert "expected an instance for model exchange (0) or co-simulation (1)" in said[-1]
    token = three.guid.encode()
    start = three.function("InstantiateCoSimulation")
    assert start(None, token, None, False, False, False, False, None, 0, None, None, None) is None
    assert start(b"unit", None, None, False, False, False, False, None, 0, None, None, None) is None
    assert start(b"unit", token, None, False, False, False, False, None, 3, None, None, None) is None
    assert start(b"unit", token, None, False, False, True, False, None, 0, None, None, None) is None  # event mode
    unknown = references([9999])
    assert start(b"unit", token, None, False, False, False, False, unknown, 1, None, None, None) is None
    schedule = three.function("InstantiateScheduledExecution")
    assert schedule(b"unit", token, None, False, False, None, None, None, None, None) is None
    three.function("FreeInstance")(None)


def test_a_percent_sign_in_a_name_does_not_reach_printf(native: Native, version: str) -> None:
    """FMI 2 passes the text as a format: importers print it, and with arguments that are not there."""
    name = "arm 100%s %n ä"
    unit = native("plant", version, name=name).start()
    with unit.refuses("failed: expected a finite positive") as no:
        no("DoStep", *unit.step_arguments(0.0, -1.0))
    shown = name.replace("%", "%%") if version == "2.0" else name
    assert unit.messages[-1].text.startswith(f"{shown}: doStep at t = 0 s failed")


def test_errors_are_told_with_logging_off_and_events_only_with_it_on(native: Native, version: str) -> None:
    quiet, loud = native("plant", version), native("plant", version, logging=True)
    quiet.start()
    loud.start(2.0)
    assert quiet.messages == []
    assert [m.text for m in loud.messages] == ["unit: starts at t = 2 s"]
    with quiet.refuses("failed") as no:
        no("DoStep", *quiet.step_arguments(0.0, -1.0))
    name = (ct.c_char_p * 1)(b"logNonsense")
    with quiet.refuses(r"expected categories out of logEvents, .*, got logNonsense\.") as no:
        no("SetDebugLogging", 1, 1, name)
    none = (ct.c_char_p * 1)(None)
    with quiet.refuses("expected the name of a category, got a null pointer") as no:
        no("SetDebugLogging", 1, 1, none)
    name[0] = b"logEvents"
    quiet.do("SetDebugLogging", 1, 1, name).do("Reset").start()
    assert quiet.messages[-1].category == "logEvents"
