"""Values that are refused: of variables that do not exist, of another type or size, or not to be set then."""

from __future__ import annotations

import ctypes as ct
from collections.abc import Callable

import numpy as np
import pytest

from tests.compiler.native.binding import Instance, references, same_bits
from tests.compiler.native.test_every_call import CASES, bring

Native = Callable[..., Instance]


# ------------------------------------------------------------------ value references, types, sizes


def test_value_references_that_do_not_exist_are_refused_everywhere(native: Native, version: str) -> None:
    unit = native("plant", version).start()
    before = unit.complete()
    last = max(v.reference for v in unit.model.variables)
    wrong = [last + 1, 10_000, 2**31, 2**32 - 1]
    if version == "3.0":
        (array,) = unit.model.group("q")
        wrong.append(array.reference + 1)  # an element has no reference of its own
    room, size = (ct.c_double * 64)(), ct.c_size_t()
    (tau,) = unit.model.group("tau")[:1]
    for reference in wrong:
        one, good = references([reference]), references([tau.reference])
        both = references([tau.reference, reference])
        words = rf"there is no value reference {reference}[;,]?"
        names = ("Real", "Integer", "Boolean", "String") if version == "2.0" else (
            "Float32", "Float64", "Int8", "Int32", "UInt64", "Boolean", "String")  # fmt: skip
        with unit.refuses(words) as no:
            for name in names:
                tail = (room,) if version == "2.0" else (room, 1)
                no(f"Get{name}", one, 1, *tail)
                no(f"Set{name}", one, 1, *tail)
            real = f"Set{unit._type('Real')}"
            no(real, both, 2, *((room,) if version == "2.0" else (room, 3)))
            if version == "2.0":
                no("GetDirectionalDerivative", one, 1, good, 1, room, room)
                no("GetDirectionalDerivative", references([unit.model.group("q")[0].reference]), 1, one, 1, room, room)
                no("SetRealInputDerivatives", both, 2, (ct.c_int * 2)(1, 1), room)
            else:
                no("GetDirectionalDerivative", one, 1, good, 1, room, 2, room, 2)
                no("GetAdjointDerivative", one, 1, good, 1, room, 2, room, 2)
                no("GetNumberOfVariableDependencies", reference, ct.byref(size))
                no("GetClock", one, 1, room)
                no("SetClock", one, 1, room)
                no("GetIntervalDecimal", one, 1, room, room)
                no("GetBinary", one, 1, room, room, 1)
    assert unit.complete() == before


def test_a_function_of_another_type_is_refused(native: Native, version: str) -> None:
    unit = native("feedforward", version).start()
    before = unit.complete()
    room = (ct.c_double * 64)()
    two = version == "2.0"
    types = ("Real", "Integer", "Boolean", "String") if two else (
        "Float32", "Float64", "Int8", "UInt8", "Int16", "UInt16", "Int32", "UInt32", "Int64", "UInt64",
        "Boolean", "String",
    )  # fmt: skip
    for name, own in (("Lambda", unit._type("Real")), ("mode", unit._type("Integer"))):
        v = unit.model.group(name)[0]
        refs = references([v.reference])
        for kind in types:
            if kind == own:
                continue
            with unit.refuses(
                rf"expected variables of type {kind}, got {v.name.replace('[', chr(92) + '[')} .*of type {own}\."
            ) as no:
                for verb in ("Get", "Set"):
                    no(verb + kind, refs, 1, room, *(() if two else (len(v.names),)))
    assert unit.complete() == before


def test_arrays_of_the_wrong_size_are_refused(native: Native) -> None:
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
    for n in (0, 7, 9):
        with exchange.refuses(rf"expected 8 values, one a state, got {n}\.") as no:
            for name in (
                "SetContinuousStates",
                "GetContinuousStates",
                "GetContinuousStateDerivatives",
                "GetNominalsOfContinuousStates",
            ):
                no(name, room, n)
    with exchange.refuses(r"expected 0 values, as there are no event indicators, got 1\.") as no:
        no("GetEventIndicators", room, 1)
    assert list(room) == [7.0] * 16
    assert unit.complete() == before


def test_room_for_dependencies_of_the_wrong_size_is_refused(native: Native) -> None:
    unit = native("plant", "3.0").start()
    q, size = unit.model.group("q")[0], ct.c_size_t()
    unit.do("GetNumberOfVariableDependencies", q.reference, ct.byref(size))
    room = (ct.c_size_t * 64)()
    for n in (0, size.value - 1, size.value + 1):
        with unit.refuses(rf"expected room for {size.value} dependencies, got {n}\.") as no:
            no("GetVariableDependencies", q.reference, room, room, room, room, n)
    assert not any(room)


# ------------------------------------------------------------------ what cannot be set, in every phase


@pytest.mark.parametrize(("kind", "phase"), CASES)
def test_what_can_be_set_depends_on_role_and_phase(native: Native, version: str, kind: str, phase: str) -> None:
    unit = bring(native("plant", version, kind=kind), phase)
    early, running = phase in ("instantiated", "initialization"), phase in ("step", "event", "continuous")
    settable = {"mass": early, "tau": early or running, "q": phase == "continuous", "time": False, "der": False}
    for group, can in settable.items():
        if group == "time" and version == "2.0":
            continue
        variables = unit.model.of("local") if group == "der" else unit.model.group(group)
        arguments = unit.write_arguments(variables, 0.25)
        before = unit.complete()
        name = f"Set{unit._type('Real')}"
        if can:
            unit.do(name, *arguments)
            continue
        with unit.refuses(r"cannot be set\.|can be set only before|allowed only") as no:
            no(name, *arguments)
        assert unit.complete() == before, group


def test_a_tunable_parameter_is_set_between_steps(native: Native, version: str) -> None:
    unit = native("controller", version).start(q_d=0.1)
    before = unit.step().get("tau_e")
    unit.set(K_p=500.0)
    assert same_bits(unit.get("tau_e"), before)
    np.testing.assert_allclose(unit.step().get("tau_e"), 0.5 * before, rtol=1e-14)
