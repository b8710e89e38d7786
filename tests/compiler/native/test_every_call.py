"""Every function in every phase, and with null pointers: done or refused with words, without a trace."""

from __future__ import annotations

import ctypes as ct
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from tests.compiler.native.binding import DISCARD, ERROR, OK, Instance, doubles, references
from tests.compiler.native.fmi_types import EventInfo, signatures

Native = Callable[..., Instance]
H = 1e-3

PHASES = {
    "CoSimulation": ("instantiated", "initialization", "step", "terminated"),
    "ModelExchange": ("instantiated", "initialization", "event", "continuous", "terminated"),
}
CASES = [(kind, phase) for kind, phases in PHASES.items() for phase in phases]


def bring(instance: Instance, phase: str) -> Instance:
    """Take a new instance to a phase."""
    instance.set(q_0=[0.3, -0.2])
    if phase == "instantiated":
        return instance.setup(1.0)
    instance.setup(1.0).enter()
    if phase == "initialization":
        return instance
    instance.do("ExitInitializationMode")
    if phase == "step":
        instance.step(tau=0.1)
    elif phase == "continuous":
        instance.continuous()
    elif phase == "terminated":
        instance.do("Terminate")
    return instance


def finish(instance: Instance, phase: str) -> bytes:
    """Use an instance from a phase on, and return all that comes of it."""
    n = instance.model.n_states
    if phase == "instantiated":
        instance.enter()
    if phase in ("instantiated", "initialization"):
        instance.do("ExitInitializationMode")
        phase = "event"
    rows = [instance.outputs()]
    if instance.kind == "CoSimulation" and phase != "terminated":
        rows += [instance.step(tau=0.2).outputs() for _ in range(3)]
    elif phase in ("event", "continuous"):
        if phase == "event":
            instance.continuous()
        instance.states(instance.get_states() + 0.01 * np.arange(n))
        rows += [instance.derivatives(), instance.outputs()]
    return np.concatenate(rows).tobytes() + instance.complete()


# ------------------------------------------------------------------ a right call of every function


class Calls:
    """Arguments after the instance of a call of every function, right in everything but perhaps the phase."""

    def __init__(self, unit: Instance) -> None:
        self.two = unit.model.major == "2"
        self.room = (ct.c_double * 512)()
        self.keep: list[Any] = []
        n = unit.model.n_states
        (tau, *_), (q, *_) = unit.model.group("tau"), unit.model.group("q")
        self.state, self.new = unit.save(), ct.c_void_p()
        data = unit.complete()
        k = len(tau.names)
        t, o = references([tau.reference]), references([q.reference])
        flag = self.room
        self.keep += [t, o, data]
        mass = unit.write_arguments(unit.model.group("mass"), [2.0, 1.0])
        vector = (doubles(np.zeros(n)), n)
        into = (self.room, n)
        size = ct.c_size_t(len(data))
        common: dict[str, tuple[Any, ...]] = {
            "SetDebugLogging": (0, 0, None),
            "ExitInitializationMode": (),
            "Terminate": (),
            "EnterEventMode": (),
            "EnterContinuousTimeMode": (),
            "CompletedIntegratorStep": (1, flag, ct.addressof(flag) + 8),
            "SetTime": (unit.time,),
            "SetContinuousStates": vector,
            "GetContinuousStates": into,
            "GetNominalsOfContinuousStates": into,
            "GetEventIndicators": (self.room, 0),
            "DoStep": unit.step_arguments(unit.time, H),
            "Reset": (),
        }
        S = unit._state
        common |= {
            f"Get{S}": (ct.byref(self.new),),
            f"Set{S}": (self.state,),
            f"Free{S}": (ct.byref(self.new),),
            f"Serialized{S}Size": (self.state, ct.byref(size)),
            f"Serialize{S}": (self.state, self.room, len(data)),
            unit.deserialize_name: (data, len(data), ct.byref(self.new)),
        }
        self.keep += [size]
        if self.two:
            info, orders = EventInfo(), (ct.c_int * 1)(1)
            self.keep += [info, orders]
            self.all = common | {
                "SetupExperiment": (0, 0.0, 0.0, 0, 0.0),
                "EnterInitializationMode": (),
                "NewDiscreteStates": (ct.byref(info),),
                "GetDerivatives": into,
                "GetDirectionalDerivative": (o, 1, t, 1, self.room, self.room),
                "SetRealInputDerivatives": (t, 1, orders, self.room),
                "GetRealOutputDerivatives": (o, 1, orders, self.room),
                "CancelStep": (),
                "GetStatus": (0, self.room),
                "GetRealStatus": (2, self.room),
                "GetIntegerStatus": (0, self.room),
                "GetBooleanStatus": (3, self.room),
                "GetStringStatus": (1, self.room),
                "SetReal": mass,
                "GetReal": mass,
                "SetInteger": (o, 0, self.room),
                "GetInteger": (o, 0, self.room),
                "SetBoolean": unit.write_arguments(unit.model.group("equilibrium"), True),
                "GetBoolean": unit.write_arguments(unit.model.group("equilibrium"), True),
                "SetString": (o, 0, self.room),
                "GetString": (o, 0, self.room),
            }
            return
        flags = (ct.c_bool * 8)()
        self.keep += [flags]
        at = ct.addressof(flags)
        self.all = common | {
            "EnterInitializationMode": (False, 0.0, unit.time, False, 0.0),
            "EnterConfigurationMode": (),
            "ExitConfigurationMode": (),
            "EnterStepMode": (),
            "EvaluateDiscreteStates": (),
            "UpdateDiscreteStates": (at, at + 1, at + 2, at + 3, at + 4, self.room),
            "CompletedIntegratorStep": (True, at, at + 1),
            "GetContinuousStateDerivatives": into,
            "GetNumberOfContinuousStates": (self.room,),
            "GetNumberOfEventIndicators": (self.room,),
            "GetDirectionalDerivative": (o, 1, t, 1, self.room, k, self.room, k),
            "GetAdjointDerivative": (o, 1, t, 1, self.room, k, self.room, k),
            "GetOutputDerivatives": (o, 1, self.room, self.room, k),
            "GetNumberOfVariableDependencies": (q.reference, self.room),
            "GetVariableDependencies": (tau.reference, None, None, None, None, 0),
            "ActivateModelPartition": (0, 0.0),
            "SetFloat64": mass,
            "GetFloat64": mass,
            "SetBoolean": unit.write_arguments(unit.model.group("equilibrium"), True),
            "GetBoolean": unit.write_arguments(unit.model.group("equilibrium"), True),
        }
        for name, (_, types) in signatures("3.0").items():
            if name in functions("3.0") and name not in self.all:  # of types that no variable has: for nothing
                self.all[name] = (o, 0, *[self.room] * (len(types) - 4), 0) if types[-1] is ct.c_size_t else (
                    o, 0, *[self.room] * (len(types) - 3))  # fmt: skip


NO_INSTANCE = {"GetTypesPlatform", "GetVersion", "FreeInstance"}


def functions(version: str) -> set[str]:
    """All functions with an instance that return a status."""
    return {name for name in signatures(version) if name not in NO_INSTANCE and not name.startswith("Instantiate")}


ANY = {"instantiated", "initialization", "step", "event", "continuous", "terminated"}
INITIALIZED = ANY - {"instantiated"}
ALLOWED: dict[str, set[str]] = {
    "SetupExperiment": {"instantiated"},
    "EnterInitializationMode": {"instantiated"},
    "ExitInitializationMode": {"initialization"},
    "Terminate": {"step", "event", "continuous"},
    "DoStep": {"step"},
    "EnterStepMode": set(),
    "EnterEventMode": {"continuous"},
    "EnterContinuousTimeMode": {"event"},
    "NewDiscreteStates": {"event"},
    "UpdateDiscreteStates": {"event"},
    "EvaluateDiscreteStates": {"event"},
    "CompletedIntegratorStep": {"continuous"},
    "SetTime": {"event", "continuous"},
    "SetContinuousStates": {"continuous"},
    "GetContinuousStates": INITIALIZED - {"step"},
    "GetDerivatives": INITIALIZED - {"step"},
    "GetContinuousStateDerivatives": INITIALIZED - {"step"},
    "GetEventIndicators": INITIALIZED - {"step"},
    "GetDirectionalDerivative": INITIALIZED,
    "GetAdjointDerivative": INITIALIZED,
    "SetRealInputDerivatives": {"instantiated", "initialization", "step"},
    "SetReal": {"instantiated", "initialization"},  # a fixed parameter
    "SetFloat64": {"instantiated", "initialization"},
    "SetBoolean": {"instantiated", "initialization"},
    # never: there are no structural parameters, no derivatives of outputs, no clocks, nothing asynchronous
    "EnterConfigurationMode": set(),
    "ExitConfigurationMode": set(),
    "GetRealOutputDerivatives": set(),
    "GetOutputDerivatives": set(),
    "CancelStep": set(),
    "ActivateModelPartition": set(),
    **{f"Get{kind}Status": set() for kind in ("", "Real", "Integer", "Boolean", "String")},
}
EXCHANGE = {
    "SetTime", "SetContinuousStates", "GetContinuousStates", "GetDerivatives", "GetContinuousStateDerivatives",
    "GetNominalsOfContinuousStates", "GetEventIndicators", "GetNumberOfContinuousStates",
    "GetNumberOfEventIndicators",
}  # fmt: skip
DISCARDED = {"GetStatus", "GetRealStatus", "GetIntegerStatus", "GetBooleanStatus", "GetStringStatus"}


def allowed(name: str, kind: str, phase: str, version: str) -> bool:
    if (name, phase, version) == ("EnterEventMode", "event", "2.0"):
        return True  # it changes nothing there
    if name in EXCHANGE and kind == "CoSimulation":
        return False
    if name == "SetRealInputDerivatives" and kind == "ModelExchange":
        return False
    return phase in ALLOWED.get(name, ANY)


def test_the_table_names_every_function(native: Native, version: str) -> None:
    assert set(Calls(native("plant", version)).all) == functions(version)


@pytest.mark.parametrize(("kind", "phase"), CASES)
def test_every_function_in_every_phase_is_done_or_refused_without_a_trace(
    native: Native, version: str, kind: str, phase: str
) -> None:
    unit, twin = (bring(native("plant", version, kind=kind), phase) for _ in range(2))
    calls = Calls(unit)
    before = unit.complete()
    for name in sorted(calls.all):
        if allowed(name, kind, phase, version):
            other = bring(native("plant", version, kind=kind), phase)
            arguments = Calls(other).all[name]
            if name.startswith("Free"):
                other.do(f"Get{other._state}", *arguments)
            assert other.call(name, *arguments) == OK, (name, other.messages)
            assert other.messages == []
            other.free()
            continue
        status = DISCARD if name in DISCARDED else ERROR
        at = r" at t = 1(\.001)? s" if phase in ("step", "event", "continuous") else ""
        with unit.refuses(rf"^unit: {name[0].lower()}{name[1:]}{at} failed: \w+.*\.$", status) as no:
            no(name, *calls.all[name])
        assert unit.complete() == before, name
    assert finish(unit, phase) == finish(twin, phase)


@pytest.mark.parametrize(("kind", "phase"), CASES)
def test_null_pointers_are_refused_by_every_function_in_every_phase(
    native: Native, version: str, kind: str, phase: str
) -> None:
    """Each pointer of a right call in turn, all of them, and the instance."""
    unit, twin = (bring(native("plant", version, kind=kind), phase) for _ in range(2))
    calls = Calls(unit)
    before = unit.complete()
    for name, arguments in sorted(calls.all.items()):
        types = signatures(version)[name][1][1:]
        pointers = [i for i, kind_ in enumerate(types) if kind_ in (ct.c_void_p, ct.c_char_p)]
        function = unit.model.function(name)
        assert function(None, *arguments) == ERROR, name
        assert function(None, *[None if i in pointers else a for i, a in enumerate(arguments)]) == ERROR, name
        # an array for nothing, a state to free that is none, and the end of an allowed call may be null
        harmless = {"SetDebugLogging", "GetEventIndicators", "GetVariableDependencies"}
        for_nothing = any(a == 0 for a, t in zip(arguments, types, strict=True) if t is ct.c_size_t)
        for nulls in ([i] for i in pointers) if len(pointers) > 1 else [pointers]:
            if name in harmless or for_nothing or not pointers:
                continue
            if calls.two and name.startswith("Get") and name.endswith("Status"):
                continue  # discarded whatever the arguments
            given = [None if i in nulls else a for i, a in enumerate(arguments)]
            with unit.refuses(rf"^unit: {name[0].lower()}{name[1:]}.* failed: ") as no:
                no(name, *given)
            assert unit.complete() == before, (name, nulls)
    assert finish(unit, phase) == finish(twin, phase)
