"""Calls beyond plain steps that an FMU declares: inputs, event mode, FMU state, directional derivatives."""

from __future__ import annotations

from collections.abc import Callable
from ctypes import c_double, c_void_p
from pathlib import Path

import fmpy
import numpy as np

from vdfmu.base.arrays import Floats
from vdfmu.base.errors import CosimError
from vdfmu.engine.fmu.description import Description, inspect_description
from vdfmu.engine.fmu.instance import Instance
from vdfmu.engine.fmu.messages import MessageBox
from vdfmu.engine.fmu.variables import FmuVariable
from vdfmu.engine.fmu.versions import class_of
from vdfmu.engine.package.archive import Archive
from vdfmu.engine.rules import Findings

Attempt = Callable[[Instance, float, float], str]
"""Takes an instance after its initialization, start and step [s]; returns what is wrong."""
_MOST = 20
"""Directional derivatives are asked for of this many outputs, the first."""
_REPEATED = 1e-9
"""Relative difference between a step and its repetition: the same operations, each within 1e-16."""


def try_abilities(path: Path, start: float, step: float) -> Findings:
    """Make the calls that an FMU declares to support, each kind with its own instance; start and step [s]."""
    findings = Findings()
    description = described(path)
    if description is None or not description.identifier or description.once_per_process:
        return findings
    folder = Path(fmpy.extract(str(path)))
    simulated = not description.exchange
    attempts: dict[str, tuple[bool, Attempt]] = {
        "event mode (hasEventMode)": (description.event_mode, _event_mode),
        "inputs, set to their start values": (bool(_inputs(description)), _stepped),
        "FMU state (canGetAndSetFMUState)": (simulated and description.saves_state, _state),
        "FMU state (canSerializeFMUState)": (simulated and description.serializes_state, _serialized),
        "directional derivatives": (description.derives_unknowns, _derivatives),
    }
    for what, (declared, attempt) in attempts.items():
        if declared:
            try:
                problem = tried(description, folder, attempt, start, step)
            except CosimError as error:
                problem = str(error)
            if problem:
                findings.problem("RUN009", f"{what}: {problem}")
    return findings


def described(path: Path) -> Description | None:
    """Return the description of an FMU, None where it cannot be read."""
    with Archive(path, path.name) as archive:
        return inspect_description(archive, path.name)[0]


def tried(
    description: Description,
    folder: Path,
    attempt: Attempt,
    start: float,
    step: float,
    begin: Callable[[Instance], None] = lambda instance: None,
) -> str:
    """Take an instance through initialization and an attempt; return what is wrong, CosimError if a call fails.

    `begin` is called in initialization mode.
    """
    instance = class_of(description)("FMU", description, folder, MessageBox(lambda message: None), set())
    instance.event_mode = attempt is _event_mode
    instance.box.time = start
    try:
        instance.instantiate()
        instance.prepare(None, start, start + 10 * step, [])
        instance.enter_initialization()
        begin(instance)
        instance.exit_initialization()
        return attempt(instance, start, step)
    finally:
        instance.close()  # a failure would show in the plain run


def _inputs(description: Description) -> list[FmuVariable]:
    """Return the inputs that are set between steps."""
    return [v for v in description.named("input") if not v.clocks and v.clock is None]


def _event_mode(instance: Instance, start: float, step: float) -> str:
    instance.update(start)
    make_step(instance, start, step)
    return ""


def _stepped(instance: Instance, start: float, step: float) -> str:
    """Set the inputs and step, twice; they are set again once the instance has states."""
    for k in range(2):
        instance.set_all([(v, v.start) for v in _inputs(instance.description)])
        make_step(instance, start + k * step, step)
    return ""


def make_step(instance: Instance, time: float, step: float) -> None:
    """Do a step from a time [s]; for model exchange it begins and ends in event mode."""
    if not instance.description.exchange:
        instance.leave_event()
    instance.box.time = time
    instance.run([instance.step_call(c_double(time), c_double(step))])


def _outputs(instance: Instance) -> tuple[Floats, list[FmuVariable]]:
    """Return the real outputs that are got between steps, values and variables."""
    own = [v for v in instance.description.named("output") if v.kind == "Real" and not v.clocks]
    values = np.zeros(len(own))
    instance.run(instance.access("Get", own, values))
    return values, own


def _state(instance: Instance, start: float, step: float) -> str:
    """Step, step again from the saved state, and compare."""
    make_step(instance, start, step)
    state = instance.saved_state()
    return _repeated(instance, start + step, step, state)


def _serialized(instance: Instance, start: float, step: float) -> str:
    """Do the same with a state that was bytes in between."""
    make_step(instance, start, step)
    state = instance.saved_state()
    content = instance.fmu.serializeFMUState(state)
    instance.free_state(state)
    again = instance.fmu.deserializeFMUState(content)
    return _repeated(instance, start + step, step, again)


def _repeated(instance: Instance, time: float, step: float, state: c_void_p) -> str:
    """Step from the current state, and from the saved state, which should equal it; return how the outputs differ."""
    make_step(instance, time, step)
    first, outputs = _outputs(instance)
    instance.restore_state(state)
    make_step(instance, time, step)
    second, _ = _outputs(instance)
    instance.free_state(state)
    with np.errstate(invalid="ignore"):
        wrong = ~(np.abs(second - first) <= _REPEATED * (1.0 + np.abs(first))) & np.isfinite(first)
    if not wrong.any():
        return ""
    k = int(np.argmax(wrong))
    return (
        f"the step from t = {time:.9g} s, repeated from the saved state, gives {outputs[k].name} = {second[k]:.9g}; "
        f"the first time it gave {first[k]:.9g}"
    )


def _derivatives(instance: Instance, start: float, step: float) -> str:
    """Ask for the directional derivative of each output by the inputs on which it depends."""
    make_step(instance, start, step)
    description = instance.description

    def continuous(causality: str) -> list[FmuVariable]:
        return [
            v
            for v in description.named(causality)
            if v.kind == "Real" and v.variability == "continuous" and not v.index
        ]

    for unknown in continuous("output")[:_MOST]:
        needs = description.step_dependencies.get(unknown.name)
        knowns = [v for v in continuous("input") if needs is None or v.name in needs]
        seeds = np.ones((1, sum(v.length for v in knowns)))
        if knowns:
            value = instance.differentiate([unknown.reference], unknown.length, [v.reference for v in knowns], seeds)[0]
            if not np.isfinite(value).all():
                return f"{unknown.name} by {', '.join(v.name for v in knowns)} is {value[~np.isfinite(value)][0]}"
    return ""
