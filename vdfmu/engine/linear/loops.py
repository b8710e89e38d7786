"""The sampled loops of a system: margins of each, and the mode that grows fastest.

Loop i is opened while all others stay closed: with the loop of all ``L(z) = -z^-d K (z - A)^-1 B``, d samples of delay,
and ``S = (1 + L)^-1`` it is ``L_i = 1 / S_ii - 1``.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt

from vdfmu.base.arrays import Floats
from vdfmu.base.errors import UsageError
from vdfmu.base.state_space import Linear, StateSpace, held
from vdfmu.engine.algorithms import choice, is_continuous
from vdfmu.engine.linear.system import LinearSystem

Complex = npt.NDArray[np.complex128]

_GRID = 400
"""Frequencies at which a loop is calculated by default."""
_COARSE = 100
"""Frequencies for the modulus margin alone: a hundred over 4 decades; poles have their own."""
_AROUND = np.concatenate([-np.geomspace(8.0, 0.25, 6), [0.0], np.geomspace(0.25, 8.0, 6)])
"""Distances to the frequency of a pole, as shares of its decay rate."""
_SLOWEST = 1e-4
"""Lowest frequency, as a share of half the sampling frequency."""
GROWTH = 2.0
"""Growth rate [1/s] that still counts as stable: a fast mode of links on springs, which friction holds."""
_NONE = 1e-300
"""Smallest pole that has a logarithm."""
_ROUNDING = 1e-9
"""Rounding of rates over a step, as a share of the state's largest."""


class Margins(NamedTuple):
    """Margins of each joint's loop, (n,) each."""

    modulus: Floats
    """Smallest distance of the loop to -1, min |1 + L|."""
    gain: Floats
    """Smallest factor above 1 of the loop's gain that destabilises it."""
    phase: Floats
    """Smallest lag [rad] that does."""
    delay: Floats
    """Smallest further delay [s] that does."""
    radius: float
    """Largest absolute eigenvalue of the closed loop, except for constants; unless it is below 1, or what the growth
    allows, modulus, phase and delay are 0."""


@dataclass(frozen=True)
class Loop:
    """The loop at one time."""

    t: float
    """Time [s]."""
    plant: Linear
    """Continuous, with the motor torques as inputs."""
    K: Floats
    """Feedback (n, n_x): deviation of the motor torques by deviations of the plant's states."""
    step: float
    """Communication step [s]."""
    growth: float = 0.0
    """Growth rate [1/s] that still counts as stable: margins are taken on the circle ``|z| = exp(growth
    step)``."""
    discrete: bool = False
    """Whether the plant is given from one communication point to the next already."""
    points: int = _GRID
    """Frequencies at which it is calculated, in addition to those around its poles."""

    @cached_property
    def sampled(self) -> Linear:
        """The plant from one communication point to the next."""
        return self.plant if self.discrete else held(self.plant, self.step)

    @cached_property
    def constants(self) -> int:
        """Number of combinations of states that stay as they are whatever the inputs do.

        At rest, hysteresis and bristles are springs, parallel to the drives' springs: the states of such springs have
        a common rate. Their pole is 1, and no loop reaches it.
        """
        A, B = self.sampled
        rates = np.hstack([A - np.eye(len(A)), B])
        largest = np.abs(rates).max(axis=1, keepdims=True)
        rank = np.linalg.matrix_rank(rates / np.where(largest > 0.0, largest, 1.0), tol=_ROUNDING)
        return len(A) - int(rank)

    @cached_property
    def grid(self) -> tuple[Floats, Complex]:
        """Frequencies [rad/s], (m,), up to half the sampling frequency, and the response there."""
        w = np.geomspace(_SLOWEST, 1.0, self.points) * np.pi / self.step
        w = np.unique(np.concatenate([w, self.around(np.linalg.eigvals(self.sampled.A))]))
        return w, self.response(w)

    def around(self, poles: Any) -> Floats:
        """Frequencies [rad/s] at and around lightly damped poles, whose peaks a grid would miss."""
        s = np.log(poles[np.abs(poles) > 0.5].astype(complex)) / self.step
        s = s[(s.imag > _SLOWEST * np.pi / self.step)]
        w = s.imag[:, None] + np.abs(s.real - self.growth)[:, None] * _AROUND
        return np.unique(w[(w > 0.0) & (w < np.pi / self.step)])

    def response(self, w: Floats) -> Any:
        """Response of the sampled plant's states to the motor torques at frequencies (m,) [rad/s]: (m, n_x, n)."""
        A, B = self.sampled
        return np.linalg.solve(self.z(w)[:, None, None] * np.eye(len(A)) - A, B.astype(complex))

    def z(self, w: Floats) -> Complex:
        """Points of the circle on which the loop is calculated."""
        return np.exp((self.growth + 1j * w) * self.step)

    def closed(self, K: Floats | None = None, delay: int = 1) -> Floats:
        """Matrix of the closed loop's states from one communication point to the next; K instead of its own."""
        A, B = self.sampled
        K = self.K if K is None else K
        if not delay:
            return A + B @ K
        n, m = B.shape
        size = n + delay * m  # states, then the torques of the coming steps, the next one first
        whole = np.zeros((size, size))
        whole[:n, :n], whole[:n, n : n + m] = A, B
        whole[n : size - m, n + m :] = np.eye(size - m - n)
        whole[size - m :, :n] = K
        return whole

    def margins(self, K: Floats | None = None, delay: int = 1) -> Margins:
        """Margins with feedback K, by default its own."""
        K = self.K if K is None else K
        n = len(K)
        poles = np.linalg.eigvals(self.closed(K, delay))
        poles = poles[np.argsort(np.abs(poles - 1.0))[self.constants :]]
        radius = float(np.abs(poles).max())
        if not radius < np.exp(self.growth * self.step):
            return Margins(np.zeros(n), np.ones(n), np.zeros(n), np.zeros(n), radius)
        w, G = self.grid
        more = self.around(poles)
        more = more[~np.isin(more, w, assume_unique=True)]
        order = np.argsort(w := np.concatenate([w, more]))
        G = np.concatenate([G, self.response(more)])[order]
        late = self.z(w[order])[:, None, None] ** -delay
        S = np.linalg.inv(np.eye(n) - late * (K @ G))
        modulus, gain, phase, left = _margins(1.0 / np.diagonal(S, axis1=1, axis2=2) - 1.0, w[order])
        return Margins(modulus, gain, phase, left, radius)


def system_margins(system: LinearSystem, opened: Sequence[str], growth: float = 0.0, points: int = _GRID) -> Margins:
    """Margins of the sampled loops of any system; for parameters and errors see :func:`system_loop`."""
    loop = system_loop(system, opened, growth, points)
    if not len(loop.plant.A):  # nothing comes back, as between an emergency stop and its brakes
        none = np.full(len(loop.K), np.inf)
        return Margins(np.ones(len(loop.K)), none, none, none, 0.0)
    return loop.margins(delay=0)


def system_loop(system: LinearSystem, opened: Sequence[str], growth: float = 0.0, points: int = _GRID) -> Loop:
    """Return the sampled loops of any system, with the delays that its master gives them; their own is 0.

    Parameters
    ----------
    system : LinearSystem
    opened : sequence of str
        Connected inputs at which the loops are opened, ``plant.tau``: each while all others are closed.
    growth, points
        See :class:`Loop`.

    Raises
    ------
    UsageError
        For unknown inputs, and for a master that takes signals as continuous.
    """
    if is_continuous(system.algorithm):
        raise UsageError(
            f"margins: expected {choice(continuous=False)}, which sample the signals, got {system.algorithm}."
        )
    system = system.around(opened)
    loops, cut = system.sampled(opened), system.places(opened)
    returned = loops.C[len(loops.C) - len(cut) :]  # nothing comes back in the same step: no algebraic loop
    plant = Linear(loops.A, loops.B[:, cut])
    while not (seen := np.vstack([plant.A, returned]).any(axis=0)).all():  # places that wait for nothing
        plant, returned = Linear(plant.A[np.ix_(seen, seen)], plant.B[seen]), returned[:, seen]
    return Loop(0.0, plant, returned, system.step, growth, discrete=True, points=points)


def opened_at(system: LinearSystem, group: str) -> list[str]:
    """Return the connected inputs of a name, at any component."""
    connected = (system.parts.inputs[i].split("[")[0] for i in np.flatnonzero(system.links.any(axis=1)).tolist())
    return [name for name in dict.fromkeys(connected) if name.endswith(f".{group}")]


def fastest_mode(system: LinearSystem) -> tuple[float, str]:
    """Return the largest rate [1/s] of a mode, and the state with the largest part in it.

    The part is the product of the mode's two eigenvectors, which has no unit of measurement.
    """
    found = moving(system)
    poles, right = np.linalg.eig(found.A)
    same, left = np.linalg.eig(found.A.T)
    rates = rates_of(poles, found.step)
    mode = int(rates.argmax())
    part = np.abs(left[:, np.abs(same - poles[mode]).argmin()] * right[:, mode])
    return float(rates[mode]), found.states[int(part.argmax())]


def moving(system: LinearSystem) -> StateSpace:
    """Return the closed loops as their master has them."""
    return system.continuous() if is_continuous(system.algorithm) else system.sampled()


def rates_of(poles: Any, step: float | None) -> Floats:
    """Return the growth rates [1/s] of poles, in continuous time or over a step."""
    return poles.real if step is None else np.log(np.maximum(np.abs(poles), _NONE)) / step


def of_positions(parts: StateSpace) -> StateSpace:
    """Return the system with rates of the springs' torques that follow from the rotors' positions.

    The torque of a spring that stiffens, ``tau_s_dot = K(tau_s) (kappa_dot - q_dot)``, depends on itself by its scale
    alone: while it is loaded at some speed the pole is above 0, whatever the arm does. The position kappa, of which
    tau_s is a function, has the rate kappa_dot.
    """
    A = parts.A.copy()
    for name in (name for name in parts.states if name.endswith("tau_s[1]")):
        plant = name.removesuffix("tau_s[1]")  # "plant." in a system, nothing for a unit by itself
        torques = [i for i, name in enumerate(parts.states) if name.startswith(f"{plant}tau_s[")]
        kappa = [i for i, name in enumerate(parts.outputs) if name.startswith(f"{plant}kappa[")]
        slopes = parts.C[kappa][:, torques]
        if f"{plant}kappa_dot[1]" in parts.states and len(kappa) == len(torques) and np.diag(slopes).all():
            rest = [i for i in range(len(A)) if i not in torques]
            own = -np.linalg.solve(slopes, parts.C[kappa][:, rest] @ A[rest][:, torques])
            for i, row in zip(torques, own, strict=True):
                A[i, torques] = row
    return replace(parts, A=A)


def modulus_margins(system: LinearSystem, opened: Sequence[str]) -> Floats:
    """Return the modulus margin of each loop, by which a run and its sliders are judged."""
    return system_margins(system, opened, GROWTH, _COARSE).modulus


def _margins(L: Any, w: Floats) -> Floats:
    """Modulus, gain, phase and delay margin of loops L (m, n) at frequencies w (m,): (4, n).

    Between frequencies the logarithm of a loop is taken as linear.
    """
    found = np.full((4, L.shape[1]), np.inf)
    found[0] = np.abs(1.0 + L).min(axis=0)
    for i, loop in enumerate(L.T):
        if not loop.any():  # nothing comes back
            continue
        size = np.log(np.maximum(np.abs(loop), np.finfo(float).tiny))  # of none the log is -708
        left = np.angle(-loop)  # the lag left until -1
        if loop[-1].real < 0.0:  # at half the sampling frequency a loop is real
            left[-1] = 0.0
        change = np.angle(loop[1:] * loop[:-1].conj())
        turn = np.flatnonzero((left[1:] * left[:-1] <= 0.0) & (np.abs(left[:-1]) < np.pi / 2.0) & (change != 0.0))
        share = np.clip(-left[turn] / change[turn], 0.0, 1.0)
        gains = -(size[turn] + share * (size[turn + 1] - size[turn]))
        found[1, i] = np.exp(gains[gains > 0.0].min(initial=np.inf))
        cross = np.flatnonzero(size[1:] * size[:-1] <= 0.0)
        share = size[cross] / (size[cross] - size[cross + 1])
        lag = np.mod(left[cross] + share * change[cross], 2.0 * np.pi)
        found[2, i] = lag.min(initial=np.inf)
        found[3, i] = (lag / (w[cross] + share * (w[cross + 1] - w[cross]))).min(initial=np.inf)
    return found
