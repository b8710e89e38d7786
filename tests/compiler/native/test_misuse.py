"""Wrong arguments are refused with words, change nothing, and the instance goes on to the bit.

test_misuse_values.py has values that are refused, test_every_call.py every function in every phase, and
tests/compiler/fmu/test_python_unit.py what Python units say alone.
"""

import ctypes as ct
from itertools import product

import numpy as np
import pytest

from tests.compiler.conftest import EACH
from tests.compiler.native.binding import DISCARD, ERROR, OK, Instance, doubles, references, same_bits
from tests.compiler.native.fmi_types import LOG_2, Callbacks
from tests.compiler.native.phases import PHASES, bring
from vdfmu.compiler.unit.solver import MAXIMUM_STEPS

NAN, INF = float("nan"), float("inf")
H = 1e-3


def refused_step(unit, words, point, size):
    before = unit.complete()
    with unit.refuses(words) as no:
        no("DoStep", *unit.step_arguments(point, size))
    assert unit.complete() == before


def entering(unit):
    return () if unit.model.major == "2" else (False, 0.0, 0.0, False, 0.0)


def test_discard_where_the_standard_says_so(native, version):
    """Time and states that an integrator tries, and derivatives that overflow: it may try others."""
    unit, twin = (bring(native("plant", version, kind="ModelExchange"), "continuous") for _ in range(2))
    before = unit.complete()
    for value, text in ((NAN, "nan"), (INF, "inf"), (-INF, "-inf")):
        with unit.refuses(rf"setTime at t = 1 s failed: expected a finite time, got {text} s\.", DISCARD) as no:
            no("SetTime", value)
        x = np.zeros(8)
        x[5] = value
        words = rf"setContinuousStates .* failed: kappa_dot\[2\]: expected a finite number, got {text} rad/s\."
        with unit.refuses(words, DISCARD) as no:
            no("SetContinuousStates", doubles(x), 8)
        assert unit.complete() == before
    x = unit.get_states()
    unit.states(np.full(8, 1e300))
    room = (ct.c_double * 8)()
    with unit.refuses(r"der\(\w+(\[\d\])?\)(\[\d\])? is not finite\.", DISCARD) as no:
        no("GetDerivatives" if version == "2.0" else "GetContinuousStateDerivatives", room, 8)
    assert not any(room)
    assert same_bits(unit.states(x).derivatives(), twin.derivatives())


@pytest.mark.few(40)
@pytest.mark.parametrize(("point", "size", "words"), [
    *((H, size, rf"a finite positive communication step, got {size} s\.") for size in (0.0, -0.0, -H, NAN, INF)),
    *((point, H, r"the communication point t = 0.001 s, .*, got t = \S+ s\.")
      for point in (0.0, 2 * H, H + 2e-9, -H, NAN, INF, 1e308)),
])  # fmt: skip
@EACH
def test_a_step_of_no_length_or_from_elsewhere_is_refused(native, version, unit_name, point, size, words):
    unit, twin = (native(unit_name, version).start().step() for _ in range(2))
    refused_step(unit, f"unit: doStep at t = 0.001 s failed: expected {words}", point, size)
    assert same_bits(unit.step().outputs(), twin.step().outputs())


@pytest.mark.parametrize(("name", "start", "size", "words"), [
    ("controller", 1.7e308, 1e308, "expected a step that ends at a finite time, got 1e"),
    ("plant", 1e9, 1e-8, r"expected a step that moves the time t = 1000000000\.0 s, got one of 1e-08 s"),
])  # fmt: skip
def test_a_step_to_a_time_that_numbers_do_not_have_is_refused(native, version, name, start, size, words):
    refused_step(native(name, version).start(start), words, start, size)


@pytest.mark.parametrize(("experiment", "words"), [
    *(((1, x, 0.0, 0, 0.0), rf"a finite positive tolerance, got {x}\.") for x in (0.0, -1e-6, NAN, INF)),
    ((1, 1e-17, 0.0, 0, 0.0), r"at least 1e-12, got 1e-17\."),
    ((1, 0.5, 0.0, 0, 0.0), r"at most 0.1, got 0.5\."),
    *(((0, 0.0, x, 0, 0.0), rf"a finite start time, got {x} s\.") for x in (NAN, INF)),
    *(((0, 0.0, 1.0, 1, x), rf"a finite stop time not before the start time 1\.0 s, got {x} s\.")
      for x in (0.5, NAN, INF)),
])  # fmt: skip
@pytest.mark.parametrize(("version", "kind"), [*product(("2.0", "3.0"), PHASES), ("python", "CoSimulation")])
def test_an_experiment_that_makes_no_sense_is_refused(native, version, kind, experiment, words):
    unit, twin = (native("plant", version, kind=kind) for _ in range(2))
    name = "EnterInitializationMode" if version == "3.0" else "SetupExperiment"
    # limits of the unit's own solver, which does not run there; pythonfmu's library takes any stop time
    if kind == "ModelExchange" and words.startswith("at ") or version == "python" and "stop time" in words:
        assert unit.call(name, *experiment) == OK
        return
    before = unit.complete()
    with unit.refuses(rf"unit: {name[0].lower()}{name[1:]} failed: .*expected {words}") as no:
        no(name, *experiment)
    assert unit.complete() == before
    assert unit.start().complete() == twin.start().complete()


@pytest.mark.parametrize("unit_name", ["plant", "controller"])
def test_a_step_beyond_the_stop_time_is_refused(native, version, unit_name):
    unit = native(unit_name, version)
    if version == "2.0":
        unit.do("SetupExperiment", 0, 0.0, 1.0, 1, 1.002).do("EnterInitializationMode")
    else:
        unit.do("EnterInitializationMode", False, 0.0, 1.0, True, 1.002)
    unit.time = 1.0
    unit.do("ExitInitializationMode").step().step()  # ends at 1.002 except for rounding
    words = r"expected a step that ends by the stop time t = 1\.002 s, got .* t = 1\.003"
    refused_step(unit, words, 1.002, 1e-3)


@pytest.mark.parametrize(("name", "variable", "value", "words"), [
    ("plant", "f_s[1]", 0.1, r"f_s\[1\]: expected f_s >= f_c, got f_s\[1\] = 0.1 N.m, f_c\[1\] = 0.3 N.m\."),
    ("feedforward", "f_c[2]", 0.9, r"f_s\[2\]: expected f_s >= f_c, got f_s\[2\] = 0.2 N.m, f_c\[2\] = 0.9 N.m\."),
    ("plant", "inertia[2,2,2]", -0.1, r"expected a positive definite inertia matrix, got .*\[2,2,2\] = -0.1 kg.m2"),
    ("plant", "inertia[1,1,1]", 0.5, r"expected no principal moment of inertia above the sum .*, got .*0.5 kg.m2"),
    ("plant", "f_s", [0.1, 0.05], r"f_s\[1\]: .*f_s\[2\]: "),  # all at once
])  # fmt: skip
@pytest.mark.parametrize("late", [False, True])
@EACH
def test_parameters_that_do_not_fit_together_are_refused_when_the_unit_starts(
    native, version, name, variable, value, words, late
):
    unit = native(name, version).setup()
    good = unit.get(variable)
    put = unit.set_one if "[" in variable else lambda name, value: unit.set(**{name: value})
    if late:
        unit.enter()
    put(variable, value)
    before = unit.complete()
    if late:  # nor is there a value of an output
        with unit.refuses(f"failed: .*{words}") as no:
            output = unit.model.of("output")[0]
            no(f"Get{unit._type('Real')}", *unit._values([output], unit._room("Real", len(output.names))))
    call = "ExitInitializationMode" if late else "EnterInitializationMode"
    with unit.refuses(rf"^unit: e{call[1:]} failed: .*{words}") as no:
        no(call, *(() if late else entering(unit)))
    assert unit.complete() == before
    put(variable, good)
    if not late:
        unit.enter()
    unit.do("ExitInitializationMode").step()


@EACH
def test_outputs_have_no_value_before_the_initialization(native, version, unit_name):
    unit = native(unit_name, version)
    assert len(unit.read(unit.model.of("input", "parameter")))
    for v in unit.model.of("output", "local"):
        with unit.refuses(r"it has no value before enterInitializationMode\.") as no:
            no(f"Get{unit._type('Real')}", *unit._values([v], unit._room("Real", len(v.names))))
    assert np.all(np.isfinite(unit.start().outputs()))


END = r"Check its inputs and the gains behind them, its start and its parameters, or loosen the tolerance\.$"


@pytest.mark.parametrize("torque", [1e12, 1e300, 1.7e308])
@EACH
def test_a_step_that_the_solver_cannot_make_is_told_with_time_and_state(native, version, torque):
    unit, twin = (native("plant", version).start(q_0=[0.3, 0.1]).step() for _ in range(2))
    words = (
        r"^unit: doStep at t = 0.001 s failed: at t = 0\.00\d+ s (state \w+\[\d\] is not finite|the local error of "
        r"state \w+\[\d\] is \S+ times the tolerance 1e-07), and the internal step reached its minimum 1e-12 s\. " + END
    )
    for tau in ([torque, -torque], [0.0, torque]):
        refused_step(unit.set(tau=tau), words, unit.time, H)
    assert same_bits(unit.step(tau=0.0).outputs(), twin.step(tau=0.0).outputs())


@pytest.mark.heavy
def test_a_step_of_too_many_internal_steps_ends_with_an_error(native, version):
    """Seconds instead of for ever, with torques that turn the arm; 10 s as one step take a tenth of the limit."""
    unit = native("plant", version).start(tau=0.05).step(10.0)
    words = (
        r"^unit: doStep at t = 10 s failed: at t = \S+ s the communication step of 1e\+300 s is not done after "
        rf"{MAXIMUM_STEPS} internal steps, the last of \S+ s\. Take shorter communication steps\. " + END
    )
    refused_step(unit, words, 10.0, 1e300)


@pytest.mark.parametrize("guid", ["", "{0}", "{" + "a" * 5000, "%s%n%d"])
def test_another_guid_is_refused_with_both(model, version, guid):
    fmu = model("plant", version)
    instance = Instance(fmu, guid=guid)
    assert instance.pointer is None
    (message,) = instance.messages
    assert message.status == ERROR
    call = "instantiate" if version == "2.0" else "instantiateCoSimulation"
    shown = guid[:100] if version == "3.0" else guid[:100].replace("%", "%%")
    assert message.text == f"unit: {call} failed: expected the GUID or instantiation token {fmu.guid}, got {shown}."


@pytest.mark.parametrize(("unit_name", "options", "words"), [
    ("plant", {"name": ""}, "failed: expected a name of the instance, got an empty one."),
    *((name, {"kind": "ModelExchange"}, "has no continuous states and is for co-simulation only.")
      for name in ("trajectory", "feedforward", "controller")),
])  # fmt: skip
def test_an_instance_without_a_name_or_of_another_kind_is_refused(model, version, unit_name, options, words):
    instance = Instance(model(unit_name, version), **options)
    assert instance.pointer is None
    assert words in instance.messages[-1].text


def test_instantiations_without_what_they_need_are_refused(model):
    said = []
    log = LOG_2(lambda *a: said.append(a[4].decode()))
    two, talking = model("plant", "2.0"), ct.byref(Callbacks(log))
    make, guid = two.function("Instantiate"), two.guid.encode()
    assert make(b"unit", 1, guid, None, None, 0, 0) is None
    assert make(None, 1, guid, None, talking, 0, 0) is None
    assert make(b"unit", 1, None, None, talking, 0, 0) is None
    assert len(said) == 2
    pointer = make(b"unit", 1, guid, None, ct.byref(Callbacks()), 0, 1)  # no logger: silent
    assert pointer
    assert two.function("DoStep")(pointer, 0.0, -1.0, 1) == ERROR
    two.function("FreeInstance")(pointer)
    two.function("FreeInstance")(None)
    assert make(b"unit", 7, guid, None, talking, 0, 0) is None
    assert "expected an instance for model exchange (0) or co-simulation (1)" in said[-1]
    three = model("plant", "3.0")
    start, token, unknown = three.function("InstantiateCoSimulation"), three.guid.encode(), references([9999])
    for name, guid, event_mode, intermediate in (
        (None, token, False, (None, 0)),
        (b"unit", None, False, (None, 0)),
        (b"unit", token, False, (None, 3)),
        (b"unit", token, True, (None, 0)),
        (b"unit", token, False, (unknown, 1)),
    ):
        assert start(name, guid, None, False, False, event_mode, False, *intermediate, None, None, None) is None
    schedule = three.function("InstantiateScheduledExecution")
    assert schedule(b"unit", token, None, False, False, None, None, None, None, None) is None
    three.function("FreeInstance")(None)


def test_a_percent_sign_does_not_reach_printf_and_events_are_told_with_logging_on_only(native, version):
    """FMI 2 passes the text as a format: importers print it, and with arguments that are not there."""
    name = "arm 100%s %n ä"
    unit = native("plant", version, name=name).start()
    refused_step(unit, "failed: expected a finite positive", 0.0, -1.0)
    shown = name.replace("%", "%%") if version == "2.0" else name
    assert unit.messages[-1].text.startswith(f"{shown}: doStep at t = 0 s failed")
    quiet, loud = native("plant", version), native("plant", version, logging=True)
    quiet.start()
    loud.start(2.0)
    assert quiet.messages == []
    assert [m.text for m in loud.messages] == ["unit: starts at t = 2 s"]
    refused_step(quiet, "failed", 0.0, -1.0)
    for category, words in (
        (b"logNonsense", r"expected categories out of logEvents, .*, got logNonsense\."),
        (None, "expected the name of a category, got a null pointer"),
    ):
        with quiet.refuses(words) as no:
            no("SetDebugLogging", 1, 1, (ct.c_char_p * 1)(category))
    quiet.do("SetDebugLogging", 1, 1, (ct.c_char_p * 1)(b"logEvents")).do("Reset").start()
    assert quiet.messages[-1].category == "logEvents"


def test_categories_are_switched_one_by_one(native, version):
    unit = native("controller", version)
    for on, category, logged in (
        (True, b"logAll", True),
        (False, b"logEvents", True),
        (False, b"logStatusError", False),
        (True, b"logStatusDiscard", False),
        (True, b"logAll", True),
    ):
        unit.do("SetDebugLogging", on, 1, (ct.c_char_p * 1)(category))
        count = len(unit.messages)
        assert unit.call("ExitInitializationMode") == ERROR
        assert (len(unit.messages) > count) == logged
