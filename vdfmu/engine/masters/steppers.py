"""What steps the components of a run, for each algorithm of `vdfmu.engine.algorithms.ALGORITHMS`."""

from __future__ import annotations

from typing import NamedTuple

from vdfmu.engine.fmu.messages import MessageBox
from vdfmu.engine.masters.continuous import ContinuousStepper
from vdfmu.engine.masters.events import Events, EventStepper
from vdfmu.engine.masters.exchange import Exchange, SampledStepper
from vdfmu.engine.masters.multirate import MultirateStepper

CONVERGENCE = 1e-8
"""Default relative change at which repetitions end."""


class Coupling(NamedTuple):
    """What a stepper is made of; `convergence` and `error` as of :class:`ContinuousStepper`, None where not given."""

    exchange: Exchange
    box: MessageBox
    events: Events | None
    """Of components of FMI 3.0 in event mode."""
    convergence: float | None
    error: float | None
    span: float
    """Length of the run [s]."""


def held(coupling: Coupling) -> SampledStepper:
    """Return what steps components whose inputs hold over a step."""
    if coupling.exchange.checked.multiples:
        return MultirateStepper(coupling.exchange, coupling.span)
    if coupling.events is not None:
        return EventStepper(coupling.exchange, coupling.events)
    return SampledStepper(coupling.exchange)


def extrapolated(coupling: Coupling) -> ContinuousStepper:
    """Return what steps components whose inputs run to predicted outputs."""
    return _continuous(coupling, repeat=False)


def iterative(coupling: Coupling) -> ContinuousStepper:
    """Return what repeats steps until the predicted outputs come out."""
    return _continuous(coupling, repeat=True)


def _continuous(coupling: Coupling, repeat: bool) -> ContinuousStepper:
    error = coupling.error
    convergence = coupling.convergence or (CONVERGENCE if error is None else 0.01 * error)
    return ContinuousStepper(
        coupling.exchange,
        coupling.box,
        repeat=repeat,
        convergence=convergence,
        error=error,
        span=coupling.span,
    )
