"""Every function in every phase, and with null pointers: done or refused with words, without a trace."""

import ctypes as ct

import numpy as np
import pytest

from tests.compiler.native.binding import DISCARD, ERROR, OK
from tests.compiler.native.calls import Calls, functions
from tests.compiler.native.phases import CASES, bring


def finish(instance, phase):
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


ANY = {"instantiated", "initialization", "step", "event", "continuous", "terminated"}
INITIALIZED = ANY - {"instantiated"}
EARLY = {"instantiated", "initialization"}
STATUSES = [f"Get{kind}Status" for kind in ("", "Real", "Integer", "Boolean", "String")]
# there are no structural parameters, no derivatives of outputs, no clocks, nothing asynchronous
NEVER = (
    "EnterStepMode", "EnterConfigurationMode", "ExitConfigurationMode", "GetRealOutputDerivatives",
    "GetOutputDerivatives", "CancelStep", "ActivateModelPartition", *STATUSES,
)  # fmt: skip
ALLOWED = {
    **dict.fromkeys(NEVER, set()),
    **dict.fromkeys(("SetupExperiment", "EnterInitializationMode"), {"instantiated"}),
    "ExitInitializationMode": {"initialization"},
    "Terminate": {"step", "event", "continuous"},
    "DoStep": {"step"},
    **dict.fromkeys(("EnterEventMode", "CompletedIntegratorStep", "SetContinuousStates"), {"continuous"}),
    **dict.fromkeys(("EnterContinuousTimeMode", "NewDiscreteStates", "UpdateDiscreteStates"), {"event"}),
    "EvaluateDiscreteStates": {"event"},
    "SetTime": {"event", "continuous"},
    **{f"Get{name}": INITIALIZED - {"step"} for name in ("ContinuousStates", "Derivatives", "EventIndicators")},
    "GetContinuousStateDerivatives": INITIALIZED - {"step"},
    **dict.fromkeys(("GetDirectionalDerivative", "GetAdjointDerivative"), INITIALIZED),
    "SetRealInputDerivatives": EARLY | {"step"},
    **dict.fromkeys(("SetReal", "SetFloat64", "SetBoolean"), EARLY),  # a fixed parameter
}
EXCHANGE = {
    "SetTime", "SetContinuousStates", "GetContinuousStates", "GetDerivatives", "GetContinuousStateDerivatives",
    "GetNominalsOfContinuousStates", "GetEventIndicators", "GetNumberOfContinuousStates",
    "GetNumberOfEventIndicators",
}  # fmt: skip


def allowed(name, kind, phase, version):
    if (name, phase, version) == ("EnterEventMode", "event", "2.0"):
        return True  # it changes nothing there
    if name in EXCHANGE and kind == "CoSimulation" or name == "SetRealInputDerivatives" and kind == "ModelExchange":
        return False
    return phase in ALLOWED.get(name, ANY)


@pytest.mark.parametrize(("kind", "phase"), CASES)
def test_every_function_in_every_phase_is_done_or_refused_without_a_trace(native, version, kind, phase):
    unit, twin = (bring(native("plant", version, kind=kind), phase) for _ in range(2))
    calls = Calls(unit)
    before = unit.complete()
    for name in sorted(calls.all):
        if allowed(name, kind, phase, version):
            other = bring(native("plant", version, kind=kind), phase)
            arguments_of = Calls(other)  # holds what the arguments point to
            arguments = arguments_of.all[name]
            if name.startswith("Free"):
                other.do(f"Get{other._state}", *arguments)
            assert other.call(name, *arguments) == OK, (name, other.messages)
            assert other.messages == []
            other.free()
            continue
        at = r" at t = 1(\.001)? s" if phase in ("step", "event", "continuous") else ""
        words = rf"^unit: {name[0].lower()}{name[1:]}{at} failed: \w+.*\.$"
        with unit.refuses(words, DISCARD if name in STATUSES else ERROR) as no:
            no(name, *calls.all[name])
        assert unit.complete() == before, name
    assert finish(unit, phase) == finish(twin, phase)


@pytest.mark.parametrize(("kind", "phase"), CASES)
def test_null_pointers_are_refused_by_every_function_in_every_phase(native, version, kind, phase):
    """Each pointer of a right call in turn, all of them, and the instance."""
    unit, twin = (bring(native("plant", version, kind=kind), phase) for _ in range(2))
    calls, before = Calls(unit), unit.complete()
    # an array for nothing, a state to free that is none, and the end of an allowed call may be null
    harmless = {"SetDebugLogging", "GetEventIndicators", "GetVariableDependencies", *STATUSES}
    for name, arguments in sorted(calls.all.items()):
        types = functions(version)[name]
        pointers = [i for i, type_ in enumerate(types) if type_ in (ct.c_void_p, ct.c_char_p)]
        function = unit.model.function(name)
        assert function(None, *arguments) == ERROR, name
        assert function(None, *[None if i in pointers else a for i, a in enumerate(arguments)]) == ERROR, name
        for_nothing = any(a == 0 for a, t in zip(arguments, types, strict=True) if t is ct.c_size_t)
        for null in [] if name in harmless or for_nothing else pointers:
            with unit.refuses(rf"^unit: {name[0].lower()}{name[1:]}.* failed: ") as no:
                no(name, *(None if i == null else a for i, a in enumerate(arguments)))
            assert unit.complete() == before, (name, null)
    assert finish(unit, phase) == finish(twin, phase)
