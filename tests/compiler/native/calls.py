"""Calls of every function of the standards, with arguments that are right."""

import ctypes as ct

import numpy as np

from tests.compiler.native.binding import doubles, references
from tests.compiler.native.fmi_types import signatures


def functions(version):
    excluded = ("GetTypesPlatform", "GetVersion", "FreeInstance", "Instantiate")
    return {name: types[1:] for name, (_, types) in signatures(version).items() if not name.startswith(excluded)}


class Calls:
    """Arguments after the instance of a call of every function, right in everything but perhaps the phase."""

    def __init__(self, unit, reference=None):
        """Use `reference`, if given, in place of the references of all variables."""
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
