"""Steppers of the components of a run, for each algorithm of `vdfmu.engine.algorithms.ALGORITHMS`."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import NamedTuple

from vdfmu.base.errors import UsageError
from vdfmu.engine.algorithms import choice
from vdfmu.engine.fmu.messages import MessageBox
from vdfmu.engine.masters.broyden import Broyden
from vdfmu.engine.masters.continuous import ContinuousStepper
from vdfmu.engine.masters.events import Events, EventStepper
from vdfmu.engine.masters.exchange import Exchange
from vdfmu.engine.masters.sampled import MultirateStepper, SampledStepper

CONVERGENCE = 1e-8
"""Default relative change at which repetitions end."""


class Coupling(NamedTuple):
    """Parts of a stepper; `convergence` and `error` of :class:`ContinuousStepper` may be None."""

    exchange: Exchange
    box: MessageBox
    events: Events | None
    """Events of components of FMI 3.0 in event mode."""
    convergence: float | None
    error: float | None
    span: float
    """Length of the run [s]."""


def held(coupling: Coupling) -> SampledStepper:
    """Return the stepper for inputs that hold over a step."""
    checked = coupling.exchange.checked
    if checked.schedule.groups and (checked.multiples or coupling.events is not None):
        raise UsageError(
            f"{', '.join(checked.schedule.groups[0])}: depend on each other within a step and are integrated together. "
            "Other components of the system must not have their own steps or events of co-simulation. Leave these out, "
            f"or use {choice(repeats=True)}"
        )
    if checked.multiples:
        return MultirateStepper(coupling.exchange, coupling.span)
    if coupling.events is not None:
        return EventStepper(coupling.exchange, coupling.events)
    return SampledStepper(coupling.exchange)


def continuous(coupling: Coupling, solver: Callable[[], Broyden] | None) -> ContinuousStepper:
    """Return the stepper for inputs that ramp over a step; for `solver` see :class:`ContinuousStepper`."""
    exchange, _, _, convergence, error, span = coupling
    convergence = convergence or (CONVERGENCE if error is None else 0.01 * error)
    return ContinuousStepper(exchange, solver=solver, convergence=convergence, error=error, span=span)


extrapolated = partial(continuous, solver=None)
"""Inputs ramp to predicted outputs."""
iterative = partial(continuous, solver=Broyden)
"""Steps are repeated until predicted and computed outputs agree."""
