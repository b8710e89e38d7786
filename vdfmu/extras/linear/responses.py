"""Frequency responses of a linear system, with their resonances and anti-resonances."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt
from scipy.linalg import block_diag, eigvals

from vdfmu.arm.robot import Robot
from vdfmu.base.arrays import Floats
from vdfmu.base.errors import UsageError
from vdfmu.base.state_space import StateSpace
from vdfmu.engine.linear.loops import Complex
from vdfmu.study.analysis.arm_space import linearize

_POINTS = 2000
_SLOWEST = 1.0
"""Lowest frequency [Hz] at which resonances are marked."""
_DAMPED = 0.3
"""Largest damping ratio of marked resonances, beyond which there are no peaks."""


class Bode(NamedTuple):
    """Responses of outputs to one input: frequencies (m,) [Hz], responses (k, m), and marked frequencies."""

    frequency: Floats
    response: Complex
    resonance: Floats
    """Frequencies [Hz] of lightly damped poles."""
    antiresonance: tuple[Floats, ...]
    """Frequencies [Hz] of lightly damped zeros of each output's response."""


def bode(system: StateSpace, source: str, outputs: Sequence[str]) -> Bode:
    """Frequency responses of outputs to one input, from 0.1 times the lowest to 10 times the highest marked frequency.

    Parameters
    ----------
    system : StateSpace
        In continuous time.
    source : str
        Name of the input, ``tau[1]``.
    outputs : sequence of str

    Raises
    ------
    UsageError
        For unknown names, or a sampled system.
    """
    if source not in system.inputs or not set(outputs) <= set(system.outputs) or system.step is not None:
        raise UsageError(
            f"bode: expected a system in continuous time with {', '.join([source, *outputs])}; inputs are "
            f"{', '.join(system.inputs)}; outputs {', '.join(system.outputs)}."
        )
    j, rows = system.inputs.index(source), [system.outputs.index(name) for name in outputs]
    b, n = system.B[:, [j]], len(system.A)
    every: Any = np.linalg.eigvals(system.A)
    fastest = float(np.abs(every).max(initial=0.0))
    poles = _oscillating(every, fastest)
    zeros: list[Floats] = []
    for row in rows:
        pencil = np.block([[system.A, b], [system.C[[row]], system.D[[row]][:, [j]]]])
        zeros.append(_oscillating(eigvals(pencil, block_diag(np.eye(n), 0.0)), fastest))
    marked = np.concatenate([poles, *zeros, [] if len(poles) else [_SLOWEST]])
    frequency = np.geomspace(marked.min() / 10.0, marked.max() * 10.0, _POINTS)
    frequency = np.union1d(frequency, marked)
    response = system.response(2.0 * np.pi * frequency)[:, rows, j].T
    return Bode(frequency, response, poles, tuple(zeros))


def _oscillating(s: Any, fastest: float) -> Floats:
    """Frequencies [Hz] of lightly damped, finite poles or zeros, which are below 100 times the `fastest` [1/s]."""
    size = np.abs(s)
    chosen = (s.imag > 0.0) & (size > 2.0 * np.pi * _SLOWEST) & (size <= 100.0 * fastest)
    chosen &= np.abs(s.real) < _DAMPED * size
    return np.sort(size[chosen]) / (2.0 * np.pi)


def joint_bode(robot: Robot, q: npt.ArrayLike, joint: int, dry: bool = False) -> Bode:
    """Responses of the velocities of a joint's rotor and link to its motor torque at a pose; `joint` counts from 1."""
    system = linearize(robot, q, dry=dry)
    return bode(system, f"tau[{joint}]", (f"kappa_dot[{joint}]", f"q_dot[{joint}]"))
