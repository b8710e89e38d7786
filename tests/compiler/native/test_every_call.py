"""Every function in every phase, and with null pointers: done or refused with words, without a trace."""

import ctypes as ct

import numpy as np
import pytest

from tests.compiler.native.binding import DISCARD, ERROR, OK, doubles, references
from tests.compiler.native.fmi_types import signatures
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


def functions(version):
    excluded = ("GetTypesPlatform", "GetVersion", "FreeInstance", "Instantiate")
    return {name: types[1:] for name, (_, types) in signatures(version).items() if not name.startswith(excluded)}


class Calls:
    """Arguments after the instance of a call of every function, right in everything but perhaps the phase."""

    def __init__(self, unit, reference=None):
        """With a reference that stands for those of all variables."""
        version, n, S = unit.model.version, unit.model.n_states, unit._state
        (tau, *_), (q, *_) = unit.model.group("tau"), unit.model.group("q")
        t, o = (references([v.reference if reference is None else reference]) for v in (tau, q))
        data = unit.complete()
        self.state, self.new, self.size, self.orders = unit.save(), ct.c_void_p(), ct.c_size_t(len(data)), ct.c_int(1)
        self.room = room = (ct.c_double * 512)()
        new, at, two = ct.byref(self.new), ct.addressof(room), version == "2.0"
        k = () if two else (len(tau.names),)  # FMI 3 names the lengths
        mass = unit.write_arguments(unit.model.group("mass"), [2.0, 1.0])
        equilibrium = unit.write_arguments(unit.model.group("equilibrium"), True)
        into, derivative = (room, n), (o, 1, t, 1, room, *k, room, *k)
        by_name = {
            "SetDebugLogging": (0, 0, None),
            "SetupExperiment": (0, 0.0, 0.0, 0, 0.0),
            "EnterInitializationMode": () if two else (False, 0.0, unit.time, False, 0.0),
            "NewDiscreteStates": (room,),
            "UpdateDiscreteStates": (at, at + 1, at + 2, at + 3, at + 4, at + 8),
            "CompletedIntegratorStep": (1, at, at + 8),
            "SetTime": (unit.time,),
            "SetContinuousStates": (doubles(np.zeros(n)), n),
            "GetNumberOfContinuousStates": (room,),
            "GetNumberOfEventIndicators": (room,),
            "GetEventIndicators": (room, 0),
            "DoStep": unit.step_arguments(unit.time, 1e-3),
            f"Get{S}": (new,),
            f"Set{S}": (self.state,),
            f"Free{S}": (new,),
            f"Serialized{S}Size": (self.state, ct.byref(self.size)),
            f"Serialize{S}": (self.state, room, len(data)),
            unit.deserialize_name: (data, len(data), new),
            "SetRealInputDerivatives": (t, 1, ct.byref(self.orders), room),
            "GetRealOutputDerivatives": (o, 1, ct.byref(self.orders), room),
            "GetOutputDerivatives": (o, 1, room, room, *k),
            "GetNumberOfVariableDependencies": (o[0], room),
            "GetVariableDependencies": (t[0], None, None, None, None, 0),
            "ActivateModelPartition": (0, 0.0),
            **{f"Get{kind}Status": (0, room) for kind in ("", "Real", "Integer", "Boolean", "String")},
            **{f"Get{name}": into for name in ("ContinuousStates", "Derivatives", "ContinuousStateDerivatives")},
            "GetNominalsOfContinuousStates": into,
            **dict.fromkeys(("GetDirectionalDerivative", "GetAdjointDerivative"), derivative),
            **dict.fromkeys(("SetReal", "GetReal", "SetFloat64", "GetFloat64"), mass),
            **dict.fromkeys(("SetBoolean", "GetBoolean"), equilibrium),
        }
        if reference is not None:
            by_name |= dict.fromkeys(("SetReal", "GetReal", "SetFloat64", "GetFloat64"), (t, 1, room, *k))
            by_name |= dict.fromkeys(("SetBoolean", "GetBoolean"), (t, 1, room, *([] if two else [1])))
        self.all = {}
        for name, types in functions(version).items():
            numbered = len(types) > 2 and types[-1] is ct.c_size_t
            for_nothing = (o, 0, *[room] * (len(types) - 2 - numbered), *[0] * numbered)  # of types no variable has
            self.all[name] = by_name.get(name, for_nothing if types else ())


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
