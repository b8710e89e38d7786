"""Values that are refused: of variables that do not exist, of another type or size, or not to be set then."""

import ctypes as ct
import re

import numpy as np
import pytest

from tests.compiler.conftest import EACH
from tests.compiler.native.binding import references
from tests.compiler.native.calls import Calls
from tests.compiler.native.phases import CASES, bring

TYPES = {
    "2.0": ("Real", "Integer", "Boolean", "String"),
    "3.0": ("Float32", "Float64", "Int8", "UInt8", "Int16", "UInt16", "Int32", "UInt32", "Int64", "UInt64", "Boolean",
            "String"),
}  # fmt: skip


REFERRING = r"^Get(Real|Float64|Boolean)$|^SetBoolean$|(Directional|Adjoint)Derivative|VariableDependencies|InputDeriv"
"""Functions with value references of variables that a plant has."""


@EACH
def test_value_references_that_do_not_exist_are_refused_everywhere(native, version):
    unit = native("plant", version).start()
    before, (tau, *_), (q, *_) = unit.complete(), unit.model.group("tau"), unit.model.group("q")
    # in FMI 3 an element has no reference of its own
    wrong = [max(v.reference for v in unit.model.variables) + 1, *([q.reference + 1] if version == "3.0" else [])]
    wrong += [] if unit.model.is_python else [2**31, 2**32 - 1]  # whose library has references with a sign
    room = (ct.c_double * 64)()
    for reference in wrong:
        both = references([tau.reference, reference])
        named = {f"Set{unit._type('Real')}": (both, 2, room, *((len(tau.names) + 1,) if version == "3.0" else ()))}
        if unit.model.is_python:
            named["GetReal"] = references([reference]), 1, room
        else:
            calls = Calls(unit, reference)
            named |= {name: calls.all[name] for name in calls.all if re.search(REFERRING, name)}
        with unit.refuses(rf"there is no value reference {reference}[;,]?") as no:
            for name, arguments in named.items():
                no(name, *arguments)
    assert unit.complete() == before


@pytest.mark.parametrize(("name", "kind"), [("Lambda", "Real"), ("mode", "Integer")])
@EACH
def test_a_function_of_another_type_is_refused(native, version, name, kind):
    unit = native("feedforward", version).start()
    before = unit.complete()
    room, v, own_type = (ct.c_double * 64)(), unit.model.group(name)[0], unit._type(kind)
    texts = {"String"} if unit.model.is_python else set()  # pythonfmu's library reads them before the unit sees them
    for other in (other for other in TYPES[unit.model.version] if other not in (own_type, *texts)):
        with unit.refuses(rf"expected variables of type {other}, got {re.escape(v.name)} .*of type {own_type}\.") as no:
            for verb in ("Get", "Set"):
                no(
                    verb + other,
                    references([v.reference]),
                    1,
                    room,
                    *(() if unit.model.major == "2" else (len(v.names),)),
                )
    assert unit.complete() == before


def test_arrays_of_the_wrong_size_are_refused(native):
    """FMI 3 tells the number of values beside that of the references."""
    unit = native("plant", "3.0").start()
    before = unit.complete()
    refs = references([v.reference for v in (*unit.model.group("tau"), *unit.model.group("F_e"))])
    for n in (0, 1, 7, 9, 2**40):
        room = (ct.c_double * 16)(*[7.0] * 16)
        with unit.refuses(rf"expected 8 values, got {n}\.") as no:
            no("GetFloat64", refs, len(refs), room, n)
            no("SetFloat64", refs, len(refs), room, n)
        assert list(room)[min(n, 8) :] == [7.0] * (16 - min(n, 8))
    room = (ct.c_double * 16)(*[7.0] * 16)
    exchange = bring(native("plant", "3.0", kind="ModelExchange"), "continuous")
    states = ("ContinuousStates", "ContinuousStateDerivatives", "NominalsOfContinuousStates")
    for n in (0, 7, 9):
        with exchange.refuses(rf"expected 8 values, one a state, got {n}\.") as no:
            for name in ("SetContinuousStates", *(f"Get{name}" for name in states)):
                no(name, room, n)
    with exchange.refuses(r"expected 0 values, as there are no event indicators, got 1\.") as no:
        no("GetEventIndicators", room, 1)
    assert list(room) == [7.0] * 16
    assert unit.complete() == before


def test_room_for_dependencies_of_the_wrong_size_is_refused(native):
    unit = native("plant", "3.0").start()
    q, size = unit.model.group("q")[0], ct.c_size_t()
    unit.do("GetNumberOfVariableDependencies", q.reference, ct.byref(size))
    room = (ct.c_size_t * 64)()
    for n in (0, size.value - 1, size.value + 1):
        with unit.refuses(rf"expected room for {size.value} dependencies, got {n}\.") as no:
            no("GetVariableDependencies", q.reference, room, room, room, room, n)
    assert not any(room)


@pytest.mark.parametrize(
    ("version", "kind", "phase"),
    [(version, *case) for version in ("2.0", "3.0", "python") for case in CASES
     if version != "python" or case[0] == "CoSimulation"],
)  # fmt: skip
def test_what_can_be_set_depends_on_role_and_phase(native, version, kind, phase):
    unit = bring(native("plant", version, kind=kind), phase)
    early, running = phase in ("instantiated", "initialization"), phase in ("step", "event", "continuous")
    settable = {"mass": early, "tau": early or running, "q": phase == "continuous", "time": False, "der": False}
    for group, can in settable.items():
        if group == "time" and version != "3.0" or group == "der" and version == "python":
            continue
        variables = unit.model.of("local") if group == "der" else unit.model.group(group)
        call = (f"Set{unit._type('Real')}", *unit.write_arguments(variables, 0.25))
        if can:
            unit.do(*call)
            continue
        before = unit.complete()
        with unit.refuses(r"cannot be set\.|can be set only before|allowed only") as no:
            no(*call)
        assert unit.complete() == before, group


NAN, INF = float("nan"), float("inf")


@pytest.mark.parametrize(("name", "variable", "value", "words"), [
    ("plant", "mass[2]", -1.0, r"mass\[2\]: expected a number above 0, got -1 kg\."),
    ("plant", "mass[1]", NAN, r"mass\[1\]: expected a finite number, got nan kg\."),
    ("plant", "ell[1]", 0.5, r"ell\[1\]: expected at least 1, got 0.5\."),
    ("plant", "c_w[1]", 0.0, r"c_w\[1\]: expected a number above 0, got 0 1/\(N.m\)\."),
    ("plant", "f_v[1]", -0.1, r"f_v\[1\]: expected at least 0 N.m.s/rad, got -0.1 N.m.s/rad\."),
    ("plant", "tolerance", 0.5, r"tolerance: expected at most 0.1, got 0.5\."),
    ("plant", "tolerance", 0.0, r"tolerance: expected a number above 0, got 0\."),
    ("plant", "gravity[3]", INF, r"gravity\[3\]: expected a finite number, got inf m/s2\."),
    ("plant", "F_e[6]", -INF, r"F_e\[6\]: expected a finite number, got -inf N.m\."),
    ("feedforward", "q_d_ddddot[1]", INF, r"q_d_ddddot\[1\]: expected a finite number, got inf rad/s4\."),
    ("feedforward", "mode", 2, r"mode: expected 0 \(inverse\) or 1 \(vdc\), got 2\."),
    ("controller", "velocity", 7, r"velocity: expected 0 \(kappa_dot\) or 1 \(q_dot\) or 2 \(mixed\), got 7\."),
    ("trajectory", "T", 0.0, r"T: expected at least 1e-06 s, got 0 s\."),
])  # fmt: skip
@EACH
def test_a_value_out_of_bounds_is_refused_where_it_is_set(native, version, name, variable, value, words):
    unit = native(name, version)
    owner, index = unit.model.references[variable]
    before = unit.complete()
    values = np.atleast_1d(unit.read([owner]))
    values[index] = value
    call = f"Set{unit._type(owner.type)}"
    with unit.refuses(rf"^unit: s{call[1:]} failed: {words}$") as no:
        no(call, *unit.write_arguments([owner], values))
    assert unit.complete() == before


@EACH
def test_a_call_sets_all_of_its_values_or_none_and_reads_what_it_names_in_any_order(native, version):
    """Sums that overflow or cancel are seen, and a fixed parameter may be set again after a reset."""
    unit = native("plant", version).start(tau=[0.1, 0.2])
    tau, mass = unit.model.group("tau"), unit.model.group("mass")
    for values in ([0.3, NAN], [INF, -INF]):
        with unit.refuses(r"at t = 0 s failed: tau\[\d\]: expected a finite number") as no:
            no(f"Set{unit._type('Real')}", *unit.write_arguments(tau, values))
    assert unit.get("tau").tolist() == [0.1, 0.2]
    for _ in range(2):  # a refusal is not remembered as a permission
        with unit.refuses(
            r"mass(\[1\])? is a fixed parameter and can be set only before exitInit.*\. Reset the unit"
        ) as no:
            no(f"Set{unit._type('Real')}", *unit.write_arguments(mass, 3.0))
    assert unit.do("Reset").start(mass=3.0).get("mass").tolist() == [3.0, 3.0]
    unit = native("controller", version).start(K_p=[1.0, 2.0], K_v=[3.0, 4.0], q_d=[1e308, 1e308])
    assert unit.get("q_d").tolist() == [1e308, 1e308]
    p, v = unit.model.group("K_p"), unit.model.group("K_v")
    unit.write([*v, *p], [5.0, 6.0, 7.0, 8.0])
    assert unit.read([*p, *v, *p]).tolist() == [7.0, 8.0, 5.0, 6.0, 7.0, 8.0]
    assert unit.read([]).tolist() == []


@pytest.mark.parametrize(("name", "variable", "inputs", "effect"), [
    ("controller", "K_p", {"q_d": 0.1}, "tau_e"), ("controller", "K_v", {"kappa_dot_d": 0.1}, "tau_e"),
    ("controller", "tau_max", {"q_d": 0.1}, "tau"), ("feedforward", "Lambda", {"q_d": 0.1}, "tau_m"),
    *(("feedforward", gain, {"q_d_dot": 0.1}, "tau_m") for gain in ("K_V", "k_vq", "k_vkappa")),
])  # fmt: skip
@EACH
def test_a_tunable_parameter_takes_effect_at_the_next_step(native, version, name, variable, inputs, effect):
    unit = native(name, version)
    if name == "feedforward":
        unit.set(mode=1)
    before = unit.start(**inputs).step().get(effect)
    unit.set(**{variable: 0.125})
    assert unit.get(variable).tolist() == [0.125, 0.125]
    assert np.array_equal(unit.get(effect), before)
    assert np.all(unit.step().get(effect) != before)


@EACH
def test_rounding_of_the_communication_point_is_no_error(native, version):
    """Importers add steps up or multiply them."""
    # After 2e4 steps of 1e-4 s the two differ by less than 2e4 * 1.1e-16 * 2 s = 5e-12 s, 5e-8 of a step.
    unit, added = native("trajectory", version).start(), 0.0
    for k in range(20_000):
        unit.do("DoStep", *unit.step_arguments(added if k % 2 else k * 1e-4, 1e-4))
        added += 1e-4
    assert added != 20_000 * 1e-4
