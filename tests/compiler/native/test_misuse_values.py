"""Values that are refused: of variables that do not exist, of another type or size, or not to be set then."""

import ctypes as ct
import re

import pytest

from tests.compiler.native.binding import references
from tests.compiler.native.phases import CASES, bring

TYPES = {
    "2.0": ("Real", "Integer", "Boolean", "String"),
    "3.0": ("Float32", "Float64", "Int8", "UInt8", "Int16", "UInt16", "Int32", "UInt32", "Int64", "UInt64", "Boolean",
            "String"),
}  # fmt: skip


def test_value_references_that_do_not_exist_are_refused_everywhere(native, version):
    unit = native("plant", version).start()
    before = unit.complete()
    (tau, *_), (q, *_), two = unit.model.group("tau"), unit.model.group("q"), version == "2.0"
    # in FMI 3 an element has no reference of its own
    last = max(v.reference for v in unit.model.variables)
    wrong = [last + 1, 10_000, 2**31, 2**32 - 1, *([] if two else [q.reference + 1])]
    room, size = (ct.c_double * 64)(), ct.c_size_t()
    seed = (room, room) if two else (room, 2, room, 2)
    good, state = references([tau.reference]), references([q.reference])
    for reference in wrong:
        bad, both = references([reference]), references([tau.reference, reference])
        calls = [
            (verb + name, bad, 1, room, *(() if two else (1,))) for name in TYPES[version] for verb in ("Get", "Set")
        ]
        calls += [
            (f"Set{unit._type('Real')}", both, 2, room, *(() if two else (3,))),
            ("GetDirectionalDerivative", bad, 1, good, 1, *seed),
            ("GetDirectionalDerivative", state, 1, bad, 1, *seed),
        ]
        calls += [("SetRealInputDerivatives", both, 2, (ct.c_int * 2)(1, 1), room)] if two else [
            ("GetAdjointDerivative", bad, 1, good, 1, *seed),
            ("GetNumberOfVariableDependencies", reference, ct.byref(size)),
            ("GetClock", bad, 1, room), ("SetClock", bad, 1, room), ("GetIntervalDecimal", bad, 1, room, room),
            ("GetBinary", bad, 1, room, room, 1),
        ]  # fmt: skip
        with unit.refuses(rf"there is no value reference {reference}[;,]?") as no:
            for name, *arguments in calls:
                no(name, *arguments)
    assert unit.complete() == before


@pytest.mark.parametrize(("name", "kind"), [("Lambda", "Real"), ("mode", "Integer")])
def test_a_function_of_another_type_is_refused(native, version, name, kind):
    unit = native("feedforward", version).start()
    before = unit.complete()
    room, v, own_type = (ct.c_double * 64)(), unit.model.group(name)[0], unit._type(kind)
    for other in (other for other in TYPES[version] if other != own_type):
        with unit.refuses(rf"expected variables of type {other}, got {re.escape(v.name)} .*of type {own_type}\.") as no:
            for verb in ("Get", "Set"):
                no(verb + other, references([v.reference]), 1, room, *(() if version == "2.0" else (len(v.names),)))
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


@pytest.mark.parametrize(("kind", "phase"), CASES)
def test_what_can_be_set_depends_on_role_and_phase(native, version, kind, phase):
    unit = bring(native("plant", version, kind=kind), phase)
    early, running = phase in ("instantiated", "initialization"), phase in ("step", "event", "continuous")
    settable = {"mass": early, "tau": early or running, "q": phase == "continuous", "time": False, "der": False}
    for group, can in settable.items():
        if group == "time" and version == "2.0":
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
