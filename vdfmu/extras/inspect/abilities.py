"""Calls in addition to plain steps that an FMU declares: inputs, event mode, FMU state, directional derivatives."""

from __future__ import annotations

from collections.abc import Callable
from ctypes import c_double
from functools import partial
from pathlib import Path

import fmpy
import numpy as np

from vdfmu.base.arrays import Floats
from vdfmu.base.errors import CosimError
from vdfmu.engine.fmu.description import Description, inspect_description
from vdfmu.engine.fmu.instance import Instance
from vdfmu.engine.fmu.library import Watch
from vdfmu.engine.fmu.messages import MessageBox
from vdfmu.engine.fmu.variables import FmuVariable
from vdfmu.engine.fmu.versions import class_of
from vdfmu.engine.package.archive import Archive
from vdfmu.engine.rules import Findings

Attempt = Callable[[Instance, float, float], str]
"""Function of an initialized instance, start and step [s] that returns a fault or ""."""
_MOST = 20
"""Most outputs for which directional derivatives are requested."""
_REPEATED = 1e-9
"""Relative difference allowed between a step and its repetition, which make the same operations, each within 1e-16."""


def try_abilities(path: Path, start: float, step: float, watch: Watch) -> Findings:
    """Make the calls that an FMU declares, each kind with a new instance; start and step [s]."""
    findings = Findings()
    description = described(path)
    if description is None or not description.identifier or description.once_per_process:
        return findings
    folder = Path(fmpy.extract(str(path)))
    simulated = not description.exchange
    attempts: list[tuple[str, object, Attempt]] = [
        ("numbers of states and event indicators", description.exchange, _initialized),
        ("event mode (hasEventMode)", description.event_mode, _event_mode),
        ("inputs, set to their start values", _inputs(description), _stepped),
        ("FMU state (canGetAndSetFMUState)", simulated and description.saves_state, _state),
        ("FMU state (canSerializeFMUState)", simulated and description.serializes_state, _serialized),
        ("directional derivatives", description.derives_unknowns, _derivatives),
    ]
    for ability, declared, attempt in attempts:
        try:
            problem = tried(description, folder, attempt, start, step, watch=watch) if declared else ""
        except CosimError as error:
            problem = str(error)
        if problem:
            findings.report("RUN009", f"{ability}: {problem}")
    return findings


def described(path: Path) -> Description | None:
    """Return the description of an FMU, or None if it cannot be read."""
    with Archive(path, path.name) as archive:
        return inspect_description(archive, path.name)[0]


def tried(
    description: Description,
    folder: Path,
    attempt: Attempt,
    start: float,
    step: float,
    begin: Callable[[Instance], None] = lambda instance: None,
    watch: Watch | None = None,
) -> str:
    """Initialize an instance, with `begin` in initialization mode, and return the result of an attempt."""
    instance = class_of(description.version.name)(
        "FMU", description, folder, MessageBox(lambda message: None), set(), watch
    )
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
        instance.close()  # the plain run reports a failure


def _inputs(description: Description) -> list[FmuVariable]:
    """Return the inputs for values between steps."""
    return [v for v in description.named("input") if not v.clocks and v.clock is None]


def _initialized(*_: object) -> str:
    """Do nothing beyond the initialization, which reads the numbers."""
    return ""


def _event_mode(instance: Instance, start: float, step: float) -> str:
    instance.update(start)
    make_step(instance, start, step)
    return ""


def _stepped(instance: Instance, start: float, step: float) -> str:
    """Set the inputs and step, twice, the second time with states."""
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
    """Return values and variables of the real outputs between steps."""
    outputs = [v for v in instance.description.named("output") if v.kind == "Real" and not v.clocks]
    values = np.zeros(len(outputs))
    instance.run(instance.access("Get", outputs, values))
    return values, outputs


def _state(instance: Instance, start: float, step: float, serialized: bool = False) -> str:
    """Step, save the state, `serialized` or not, and step twice from there; return the difference of outputs."""
    make_step(instance, start, step)
    state, time = instance.saved_state(), start + step
    if serialized:
        state = instance.copied_state(state)
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
    step_text = f"the step from t = {time:.9g} s, repeated from the saved state, gives"
    return f"{step_text} {outputs[k].name} = {float(second[k])}; the first time it gave {float(first[k])}"


_serialized = partial(_state, serialized=True)


def _derivatives(instance: Instance, start: float, step: float) -> str:
    """Get the directional derivative of each output with respect to the inputs in its dependencies."""
    make_step(instance, start, step)
    description = instance.description

    def continuous(causality: str) -> list[FmuVariable]:
        firsts = (v for v in description.named(causality) if not v.index)
        return [v for v in firsts if v.kind == "Real" and v.variability == "continuous"]

    for unknown in continuous("output")[:_MOST]:
        needs = description.step_dependencies.get(unknown.name)
        knowns = [v for v in continuous("input") if needs is None or v.name in needs]
        seeds = np.ones((1, sum(v.length for v in knowns)))
        if knowns:
            value = instance.derivative([unknown.reference], unknown.length, [v.reference for v in knowns], seeds)()[0]
            if not np.isfinite(value).all():
                return f"{unknown.name} by {', '.join(v.name for v in knowns)} is {value[~np.isfinite(value)][0]}"
    return ""
