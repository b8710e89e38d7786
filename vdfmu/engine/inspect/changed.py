"""Components linearised with other parameters, at the states and inputs that a run had."""

from __future__ import annotations

from collections.abc import Generator, Mapping
from contextlib import contextmanager
from ctypes import c_double
from dataclasses import replace
from typing import cast

import numpy as np

from vdfmu.engine.fmu.classes import class_of
from vdfmu.engine.fmu.instance import Instance, Steps
from vdfmu.engine.inspect.linear import LinearSystem
from vdfmu.engine.masters.components import Components
from vdfmu.engine.masters.interface import jacobian_of
from vdfmu.engine.package.system import Value


def can_change(components: Components, name: str) -> bool:
    """Whether :func:`changed` can be called for a component: it has derivatives, and no sampled states."""
    description = components.instances[name].description
    return description.derives_unknowns and not description.sandboxed and not description.sampled


@contextmanager
def changed(components: Components, name: str, values: Mapping[str, Value]) -> Generator[Instance]:
    """Yield another instance of a component, with other values of some of its parameters.

    It is for model exchange, where states can be set, if it has states.
    """
    checked = components.checked
    description = checked.descriptions[name]
    description = replace(description, exchange=bool(description.states), event_mode=False)
    instance = class_of(description)(name, description, components.folders[description.source], components.box, set())
    starts = {v.name: (v, value) for v, value in checked.starts.get(name, ())}
    starts |= {each: (description.variables[each], value) for each, value in values.items()}
    try:
        instance.instantiate()
        instance.prepare(None, 0.0, 1.0, list(starts.values()))
        instance.enter_initialization()
        instance.exit_initialization(lambda *_: cast("Steps", None))  # it is not stepped
        if description.exchange:
            instance.fmu.enterContinuousTimeMode()
        yield instance
    finally:
        instance.close()


def with_part(system: LinearSystem, instance: Instance, time: float) -> LinearSystem:
    """Return a system in which a component is this instance, at the states and inputs that it was linearised at."""
    name, parts, variables = instance.name, system.parts, instance.description.variables
    x, u, y = (
        np.flatnonzero([each.partition(".")[0] == name for each in names])
        for names in (parts.states, parts.inputs, parts.outputs)
    )
    inputs, outputs = (
        [variables[names[i].partition(".")[2]] for i in places]
        for names, places in ((parts.inputs, u), (parts.outputs, y))
    )
    if instance.description.exchange:
        instance.call("SetTime", c_double(time))
        instance.transfer("SetContinuousStates", np.ascontiguousarray(parts.x[x]))
    instance.set_all(list(zip(inputs, parts.u[u].tolist(), strict=True)))
    J, n = jacobian_of(instance, inputs, outputs)(), len(x)
    A, B, C, D = (each.copy() for each in (parts.A, parts.B, parts.C, parts.D))
    A[np.ix_(x, x)], B[np.ix_(x, u)], C[np.ix_(y, x)], D[np.ix_(y, u)] = J[:n, :n], J[:n, n:], J[n:, :n], J[n:, n:]
    return replace(system, parts=replace(parts, A=A, B=B, C=C, D=D))
