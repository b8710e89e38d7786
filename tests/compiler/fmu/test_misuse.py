"""Wrong use is refused with words that say unit, call, time, what was expected, what came and the way out.

The words are those that a user of fmpy reads. Nothing that is refused changes the unit.
"""

from typing import Any

import numpy as np
import pytest

from tests.compiler.conftest import BOTH

NAN, INF = float("nan"), float("inf")


def initializing(unit: Any) -> Any:
    unit.setup()
    unit.fmu.enterInitializationMode()
    return unit


@pytest.mark.parametrize(("name", "variable", "value", "words"), [
    ("plant", "mass[1]", 0.0, r"mass\[1\]: expected a number above 0, got 0 kg\."),
    ("plant", "mass[2]", -1.0, r"mass\[2\]: expected a number above 0, got -1 kg\."),
    ("plant", "mass[1]", NAN, r"mass\[1\]: expected a finite number, got nan kg\."),
    ("plant", "I_m[1]", 0.0, r"I_m\[1\]: expected a number above 0, got 0 kg.m2\."),
    ("plant", "ell[1]", 0.5, r"ell\[1\]: expected at least 1, got 0.5\."),
    ("plant", "K_f0[2]", 0.0, r"K_f0\[2\]: expected a number above 0, got 0 N.m/rad\."),
    ("plant", "c_w[1]", -2.0, r"c_w\[1\]: expected a number above 0, got -2 1/\(N.m\)\."),
    ("plant", "f_v[1]", -0.1, r"f_v\[1\]: expected at least 0 N.m.s/rad, got -0.1 N.m.s/rad\."),
    ("plant", "eps[1]", 0.0, r"eps\[1\]: expected a number above 0, got 0 rad/s\."),
    ("plant", "tolerance", 0.5, r"tolerance: expected at most 0.1, got 0.5\."),
    ("plant", "tolerance", 0.0, r"tolerance: expected a number above 0, got 0\."),
    ("plant", "tolerance", 1e-15, r"tolerance: expected at least 1e-12, got 1e-15\."),
    ("plant", "gravity[3]", INF, r"gravity\[3\]: expected a finite number, got inf m/s2\."),
    ("plant", "q_0[1]", NAN, r"q_0\[1\]: expected a finite number, got nan rad\."),
    ("plant", "tau[2]", NAN, r"tau\[2\]: expected a finite number, got nan N.m\."),
    ("plant", "F_e[6]", -INF, r"F_e\[6\]: expected a finite number, got -inf N.m\."),
    ("feedforward", "q_d_ddddot[1]", INF, r"q_d_ddddot\[1\]: expected a finite number, got inf rad/s4\."),
    ("feedforward", "mode", 2, r"mode: expected 0 \(inverse\) or 1 \(vdc\), got 2\."),
    ("feedforward", "mode", -1, r"mode: expected 0 \(inverse\) or 1 \(vdc\), got -1\."),
    ("feedforward", "Lambda[1]", -1.0, r"Lambda\[1\]: expected at least 0 1/s, got -1 1/s\."),
    ("controller", "velocity", 7, r"velocity: expected 0 \(kappa_dot\) or 1 \(q_dot\) or 2 \(mixed\), got 7\."),
    ("controller", "tau_max[1]", -1.0, r"tau_max\[1\]: expected at least 0 N.m, got -1 N.m\."),
    ("controller", "q[1]", NAN, r"q\[1\]: expected a finite number, got nan rad\."),
    ("trajectory", "T", 0.0, r"T: expected at least 1e-06 s, got 0 s\."),
    ("trajectory", "q_end[2]", INF, r"q_end\[2\]: expected a finite number, got inf rad\."),
])  # fmt: skip
@BOTH
def test_a_value_out_of_bounds_is_refused_where_it_is_set(open_unit, name, variable, value, words):
    unit = open_unit(name)
    before = unit.get(variable)
    call = "setInteger" if isinstance(value, int) else "setReal"
    with unit.refuses(rf"unit: {call} failed: {words}$"):
        unit.set_one(variable, value)
    assert np.array_equal(unit.get(variable), before)


@pytest.mark.parametrize(("name", "variable", "value", "words"), [
    ("plant", "f_s[1]", 0.1, r"f_s\[1\]: expected f_s >= f_c, got f_s\[1\] = 0.1 N.m, f_c\[1\] = 0.3 N.m\."),
    ("feedforward", "f_c[2]", 0.9, r"f_s\[2\]: expected f_s >= f_c, got f_s\[2\] = 0.2 N.m, f_c\[2\] = 0.9 N.m\."),
    ("plant", "inertia[1,1,1]", 0.5,
     r"inertia\[1,1,1\]: expected no principal moment of inertia above .*, got inertia\[1,1,1\] = 0.5 kg.m2"),
    ("plant", "inertia[2,2,2]", -0.1,
     r"inertia\[2,1,1\]: expected a positive definite inertia matrix, got .*\[2,2,2\] = -0.1 kg.m2"),
])  # fmt: skip
def test_values_that_only_together_are_not_physical_are_refused_when_initialization_starts(
    open_unit, name, variable, value, words
):
    """They are set one after the other, so the unit waits until all are there."""
    unit = open_unit(name).setup()
    unit.set_one(variable, value)
    with unit.refuses(rf"unit: enterInitializationMode failed: {words}"):
        unit.fmu.enterInitializationMode()


def test_all_that_is_not_physical_is_told_at_once(open_unit):
    unit = open_unit("plant").setup()
    unit.set(f_s=[0.1, 0.05])
    with unit.refuses(r"f_s\[1\]: .*got f_s\[1\] = 0.1 .*f_s\[2\]: .*got f_s\[2\] = 0.05 "):
        unit.fmu.enterInitializationMode()


@BOTH
def test_values_that_do_not_fit_together_are_refused_in_initialization_mode_too(open_unit):
    unit = initializing(open_unit("plant"))
    unit.set_one("f_s[1]", 0.1)
    with unit.refuses(r"unit: exitInitializationMode failed: f_s\[1\]: expected f_s >= f_c"):
        unit.fmu.exitInitializationMode()
    with unit.refuses(r"unit: getReal failed: f_s\[1\]: expected f_s >= f_c"):
        unit.get("q")
    unit.set_one("f_s[1]", 0.6)
    unit.fmu.exitInitializationMode()


@BOTH
def test_a_call_sets_all_of_its_values_or_none_and_sums_that_overflow_or_cancel_are_seen(open_unit):
    unit = open_unit("plant").start()
    unit.set(tau=[0.1, 0.2])
    with unit.refuses(r"unit: setReal at t = 0 s failed: tau\[2\]: expected a finite number"):
        unit.set(tau=[0.3, NAN])
    assert np.array_equal(unit.get("tau"), [0.1, 0.2])
    unit = open_unit("plant").start()
    with unit.refuses(r"tau\[1\]: expected a finite number, got inf N.m"):
        unit.set(tau=[INF, -INF])
    unit = open_unit("controller").start(q_d=[1e308, 1e308])
    assert np.array_equal(unit.get("q_d"), [1e308, 1e308])


@pytest.mark.parametrize(
    ("name", "variable", "value"),
    [("plant", "mass[1]", 3.0), ("plant", "equilibrium", False), ("plant", "q_0[2]", 1.0), ("plant", "tolerance", 1e-5),
     ("feedforward", "mode", 1), ("feedforward", "K_f0[1]", 9e3), ("controller", "ell[2]", 50.0),
     ("controller", "velocity", 1), ("trajectory", "T", 3.0), ("trajectory", "q_end[1]", 1.0)],
)  # fmt: skip
@BOTH
def test_a_fixed_parameter_is_refused_after_initialization(open_unit, name, variable, value):
    unit = open_unit(name)
    unit.set_one(variable, value)
    unit.setup().fmu.enterInitializationMode()
    unit.set_one(variable, value)
    unit.fmu.exitInitializationMode()
    words = (
        variable.replace("[", r"\[").replace("]", r"\]")
        + r" is a fixed parameter and can be set only before exitInitializationMode\. Reset the unit to set it\."
    )
    for _ in range(2):  # a refusal is not remembered as a permission
        with unit.refuses(rf"unit: set\w+ at t = 0 s failed: {words}"):
            unit.set_one(variable, value)
    unit.fmu.reset()
    unit.set_one(variable, value)


@pytest.mark.parametrize(("name", "variable", "inputs", "effect"), [
    ("controller", "K_p", {"q_d": 0.1}, "tau_e"),
    ("controller", "K_v", {"kappa_dot_d": 0.1}, "tau_e"),
    ("controller", "tau_max", {"q_d": 0.1}, "tau"),
    ("feedforward", "Lambda", {"q_d": 0.1}, "tau_m"),
    ("feedforward", "K_V", {"q_d_dot": 0.1}, "tau_m"),
    ("feedforward", "k_vq", {"q_d_dot": 0.1}, "tau_m"),
    ("feedforward", "k_vkappa", {"q_d_dot": 0.1}, "tau_m"),
])  # fmt: skip
@BOTH
def test_a_tunable_parameter_takes_effect_at_the_next_step(open_unit, name, variable, inputs, effect):
    unit = open_unit(name)
    if name == "feedforward":
        unit.set(mode=1)
    before = unit.start(**inputs).step().get(effect)
    unit.set(**{variable: 0.125})
    assert np.array_equal(unit.get(variable), [0.125, 0.125])
    assert np.array_equal(unit.get(effect), before)
    assert np.all(unit.step().get(effect) != before)


@pytest.mark.parametrize("phase", ["instantiated", "initialization", "step"])
@BOTH
def test_an_output_cannot_be_set(open_unit, phase):
    unit = open_unit("plant")
    if phase == "initialization":
        initializing(unit)
    elif phase == "step":
        unit.start()
    with unit.refuses(r"unit: setReal.* failed: q\[1\] is an output and cannot be set\."):
        unit.set_one("q[1]", 0.0)


def test_an_unknown_value_reference_is_refused(open_unit):
    unit = open_unit("controller").start()
    last = len(unit.description.modelVariables) - 1
    for call in (lambda vr: unit.fmu.getReal([vr]), lambda vr: unit.fmu.setReal([vr], [0.0])):
        for reference in (last + 1, 10_000, 2**32 - 1):
            with unit.refuses(rf"etReal at t = 0 s failed: there is no value reference .*; they go from 0 to {last}\."):
                call(reference)


@pytest.mark.parametrize(("kind", "variable", "words"), [
    ("Real", "mode", r"expected variables of type Real, got mode \(value reference \d+\) of type Integer\."),
    ("Integer", "Lambda[1]", r"expected variables of type Integer, got Lambda\[1\] .* of type Real\."),
    ("Boolean", "mode", r"expected variables of type Boolean, got mode .* of type Integer\."),
    ("String", "mode", r"expected variables of type String, got mode .* of type Integer\."),
])  # fmt: skip
@BOTH
def test_a_call_of_the_wrong_type_is_refused(open_unit, kind, variable, words):
    unit = open_unit("feedforward")
    references = unit.references(variable)
    value = {"Real": 0.0, "Integer": 0, "Boolean": True, "String": "0"}[kind]
    with unit.refuses(rf"unit: get{kind} failed: {words}"):
        getattr(unit.fmu, "get" + kind)(references)
    with unit.refuses(rf"unit: set{kind} failed: {words}"):
        getattr(unit.fmu, "set" + kind)(references, [value])


@BOTH
def test_references_in_any_order_twice_or_none_are_what_they_name_and_their_type_is_checked(open_unit):
    unit = open_unit("feedforward")
    references = unit.references("mode")
    assert unit.fmu.getInteger(references) == [0]
    with unit.refuses(r"getReal failed: expected variables of type Real, got mode"):
        unit.fmu.getReal(references)
    mixed = [*references, *unit.references("Lambda")]
    for call in (unit.fmu.getReal, unit.fmu.getInteger):
        with unit.refuses(r"expected variables of type"):
            call(mixed)
    unit = open_unit("plant").start()
    assert unit.fmu.getReal([]) == unit.fmu.getInteger([]) == unit.fmu.getString([]) == []
    unit.fmu.setReal([], [])
    unit.fmu.setBoolean([], [])
    unit = open_unit("controller").start(K_p=[1.0, 2.0], K_v=[3.0, 4.0])
    p, v = unit.references("K_p"), unit.references("K_v")
    assert unit.fmu.getReal([v[1], p[0], p[0], v[0]]) == [4.0, 1.0, 1.0, 3.0]
    assert unit.fmu.getReal([p[0], p[0], v[0]]) == [1.0, 1.0, 3.0]
    unit.fmu.setReal([v[1], p[0]], [5.0, 6.0])
    assert unit.fmu.getReal([*p, *v]) == [6.0, 2.0, 3.0, 5.0]


def test_outputs_have_no_value_before_the_initialization(open_unit, unit_name):
    """Anything returned would be wrong; inputs and parameters have their start values."""
    unit = open_unit(unit_name)
    with_start = [v for v in unit.description.modelVariables if v.causality != "output" and v.type == "Real"]
    assert unit.fmu.getReal([v.valueReference for v in with_start]) == [float(v.start) for v in with_start]
    output = next(v for v in unit.description.modelVariables if v.causality == "output")
    with unit.refuses(r"unit: getReal failed: \w+\[1\] is an output: it has no value before enterInitializationMode\."):
        unit.fmu.getReal([output.valueReference])
    assert np.all(np.isfinite(unit.start().outputs()))


BEFORE = "it is allowed only before enterInitializationMode"
AFTER = "it is allowed only after exitInitializationMode and before terminate"
BETWEEN = "it is allowed only between enterInitializationMode and exitInitializationMode"


@pytest.mark.parametrize(("call", "words"), [
    (lambda unit: unit.fmu.doStep(0.0, 1e-3), f"doStep failed: {AFTER}"),
    (lambda unit: unit.fmu.exitInitializationMode(), f"exitInitializationMode failed: {BETWEEN}"),
    (lambda unit: unit.fmu.terminate(), f"terminate failed: {AFTER}"),
    (lambda unit: initializing(unit).fmu.doStep(0.0, 1e-3), f"doStep failed: {AFTER}"),
    (lambda unit: initializing(unit).setup(), f"setupExperiment failed: {BEFORE}"),
    (lambda unit: initializing(unit).fmu.enterInitializationMode(), f"enterInitializationMode failed: {BEFORE}"),
    (lambda unit: unit.start().setup(), f"setupExperiment at t = 0 s failed: {BEFORE}"),
    (lambda unit: unit.start().fmu.enterInitializationMode(), f"Mode at t = 0 s failed: {BEFORE}"),
    (lambda unit: unit.start().fmu.exitInitializationMode(), f"Mode at t = 0 s failed: {BETWEEN}"),
])  # fmt: skip
@BOTH
def test_a_call_in_the_wrong_phase_is_refused(open_unit, unit_name, call, words):
    unit = open_unit(unit_name)
    with unit.refuses(f"unit: .*{words}"):
        call(unit)


@BOTH
def test_after_the_end_values_can_be_read_but_nothing_moves(open_unit):
    unit = open_unit("plant").start()
    last = unit.step().outputs()
    unit.fmu.terminate()
    assert np.array_equal(unit.outputs(), last)
    for call in (lambda: unit.fmu.doStep(1e-3, 1e-3), lambda: unit.set(tau=0.0), lambda: unit.set(mass=1.0)):
        with unit.refuses(r"unit: \w+ failed: it is allowed only "):
            call()
    with unit.refuses("terminate failed: it is allowed only"):
        unit.fmu.terminate()
    assert np.array_equal(unit.outputs(), last)


@pytest.mark.parametrize(("point", "size", "words"), [
    *((1e-3, size, rf"a finite positive communication step, got {size} s\.")
      for size in (0.0, -1e-3, NAN, INF, -INF)),
    *((point, 1e-3, rf"the communication point t = 0.001 s, where the last step ended, got t = {point!r} s\.")
      for point in (0.0, 2e-3, 1e-3 + 2e-9, -1e-3, NAN, INF)),
])  # fmt: skip
def test_a_step_of_no_length_or_from_elsewhere_is_refused(open_unit, unit_name, point, size, words):
    unit = open_unit(unit_name).start()
    before = unit.step().outputs()
    with unit.refuses(f"unit: doStep at t = 0.001 s failed: expected {words}"):
        unit.fmu.doStep(point, size)
    assert np.array_equal(unit.outputs(), before)
    unit.step()


@BOTH
def test_rounding_of_the_communication_point_is_no_error(open_unit):
    """Importers add steps up or multiply them."""
    # After 2e4 steps of 1e-4 s the two differ by less than 2e4 * 1.1e-16 * 2 s = 5e-12 s, 5e-8 of a step.
    unit = open_unit("trajectory").start()
    added = 0.0
    for k in range(20_000):
        unit.fmu.doStep(added if k % 2 else k * 1e-4, 1e-4)
        added += 1e-4
    assert added != 20_000 * 1e-4


@pytest.mark.parametrize(("experiment", "words"), [
    *(({"time": x}, rf"start time, got {x} s\.") for x in (NAN, INF)),
    *(({"tolerance": x}, rf"positive tolerance, got {x}\.") for x in (0.0, -1e-6, NAN, INF)),
])  # fmt: skip
def test_a_start_time_and_a_tolerance_that_make_no_sense_are_refused(open_unit, unit_name, experiment, words):
    unit = open_unit(unit_name)
    with unit.refuses(f"unit: setupExperiment failed: expected a finite {words}"):
        unit.setup(**experiment)


@pytest.mark.parametrize("torque", [1e12, 1e300])
def test_a_torque_that_the_solver_cannot_follow_is_named_with_time_and_state(open_unit, torque):
    unit = open_unit("plant").start()
    before = unit.step().outputs()
    with unit.refuses(
        r"unit: doStep at t = 0.001 s failed: at t = 0\.00\d+ s .*state \w+\[\d\] .*"
        r"Check its inputs and the gains behind them, its start and its parameters, or loosen the tolerance\."
    ):
        unit.step(tau=[torque, -torque])
    assert np.array_equal(unit.outputs(), before)


def test_a_tolerance_of_the_experiment_is_within_the_limits_of_the_parameter(open_unit):
    """Below it the solver would crawl at rounding; units without a solver take any."""
    unit = open_unit("plant")
    with unit.refuses(r"unit: setupExperiment failed: tolerance: expected at least 1e-12, got 1e-17\."):
        unit.setup(tolerance=1e-17)
    open_unit("controller").start(tolerance=1e-17)


def test_an_error_is_one_message_of_status_fatal_whatever_the_name_of_the_instance_holds(open_unit):
    """Also where the same call had something else to say."""
    unit = open_unit("plant").start()
    assert (unit.messages, unit.statuses) == (["unit: starts at t = 0 s"], [0])
    with unit.refuses("doStep"):
        unit.fmu.doStep(0.0, -1.0)
    assert unit.statuses[1:] == [4]
    head, words = unit.messages[-1].splitlines()
    assert head == "Fatal py exception encountered: [doStep] PyObject_CallMethod"
    assert words.startswith("unit: doStep at t = 0 s failed: expected a finite positive communication step")
    # A percent sign must not reach the importer, whose printf would read arguments that are not there.
    unit = open_unit("plant", instance="arm 100%s %n 'a' \u00e4").start()
    assert unit.messages == ["arm 100 percents  percentn 'a' \u00e4: starts at t = 0 s"]
    with unit.refuses("^Fatal .*\narm 100 percents  percentn 'a' \u00e4: doStep at t = 0 s failed"):
        unit.fmu.doStep(0.0, -1.0)


def test_the_words_reach_a_user_who_left_fmi_logging_off(open_unit, caplog):
    unit = open_unit("plant")
    unit.fmu.setDebugLogging(False, [])
    unit.setup().start()
    with pytest.raises(Exception, match="fmi2DoStep failed with status 4"):
        unit.fmu.doStep(0.0, -1.0)
    assert unit.messages == []
    assert [r.getMessage() for r in caplog.records] == [
        "unit: doStep at t = 0 s failed: expected a finite positive communication step, got -1.0 s."
    ]
