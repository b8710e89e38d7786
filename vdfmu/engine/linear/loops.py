"""The loops of a system, opened one by one: the margins of each, and the modes that grow.

Loop i is opened while all others stay closed. Closed, the states change by ``x' = A x + B d``, and K x comes back to
the opened inputs. One eigendecomposition of A, with eigenvalues p_j, gives all loops, ``1 + L_i = 1 / S_i``:

    S_i = 1 + K_i (z - A)^-1 B_i = 1 + sum_j r_ij / (z - p_j)

on the unit circle, or, in continuous time, on the imaginary axis.

A relative change k of the gain of loop i moves the eigenvalue p_j by k r_ij: r_ij is the influence of the loop on the
growth of the mode. A mode is slow for a loop if it grows by up to `SLOW`, the loop moves it by less than `SLOW`, and a
change of its gain by 100 % decides its growth. The margins of this loop leave it out: near such a mode they would be 0
for any gains, as for a vibration of links without damping by motors or friction. Growth is reported separately.
"""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from functools import cached_property, lru_cache
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt

from vdfmu.base.arrays import Floats, distinct
from vdfmu.base.errors import UsageError
from vdfmu.base.state_space import Linear, StateSpace
from vdfmu.engine.linear.system import LinearSystem

Complex = npt.NDArray[np.complex128]

SLOW = 2.0
"""Largest rate [1/s] of a slow mode: a disturbance then needs half a second to grow e-fold."""
_STILL = 1e-3
"""Growth rate [1/s] that may be rounding: a double eigenvalue 1 is exact to 3e-8, or 3e-4 1/s over 0.1 ms."""
_GRID, _COARSE = 400, 60
"""Frequencies at which loops are calculated in addition to those around poles: for all margins, for the modulus."""
_AROUND = np.array([-6.0, -2.5, -1.0, -0.4, 0.0, 0.4, 1.0, 2.5, 6.0])
"""Distances to the frequency of a pole, as shares of its decay rate."""
_BETWEEN = np.linspace(-1.0, 1.0, 11)[1:-1]
"""Places for a second calculation, between the neighbours of the frequency with the least modulus."""
_SLOWEST = 1e-4
"""Lowest frequency, as a share of half the sampling frequency."""
_FAST, _DELAY = 0.05, 1e-6
"""Eigenvalues up to the first size are not separated if their eigenvectors are ill-conditioned, as of delays in a row;
up to the second they never are. Their part of S is a power series in 1 / z."""
_TERMS, _LEAST = 12, 1e-15
"""Most terms of it, with the first omitted term at 1e-15 of the first; and states that count as 0."""
_NUDGE = 1e-11
"""Relative change of the closed loop's numbers, so that it has as many eigenvectors as states: of a mass that nothing
holds, position and speed have one. Margins are exact to the same share, rates to 1e-8 1/s over 1 ms."""
_APART = 1e7
"""Largest condition of the eigenvectors for an inverse exact to 1e-9."""
_NONE = 1e-300
"""Smallest pole that has a logarithm."""


class Margins(NamedTuple):
    """Margins of each loop, (n,) each."""

    modulus: Floats
    """Smallest distance of the loop to -1, min |1 + L|; 0, as phase and delay, if a mode grows that is not slow."""
    gain: Floats
    """Smallest factor above 1 of the loop's gain that destabilises it."""
    phase: Floats
    """Smallest lag [rad] that does."""
    delay: Floats
    """Smallest further delay [s] that does."""
    rate: float
    """Rate [1/s] of the mode that grows most, or decays least; -inf without any."""


class _LoopModes(NamedTuple):
    """Modes of closed loops: of n loops, k modes."""

    poles: Complex
    """Eigenvalues, (k,), without the small ones of :func:`_separated`."""
    s: Complex
    """The same in continuous time [1/s]."""
    parts: Complex
    """r, (n, k)."""
    slow: npt.NDArray[np.bool_]
    """Whether a mode is slow for a loop, (n, k)."""
    grows: npt.NDArray[np.bool_]
    """Whether a mode grows, (k,)."""
    rest: Floats
    """The terms of the power series in 1 / z, (t, n)."""


@dataclass(frozen=True)
class Loop:
    """The loops of a system at one time, opened."""

    plant: Linear
    """From the opened inputs to the states: from one communication point to the next, or in continuous time."""
    K: Floats
    """Gains from the states back to the inputs, (n, n_x)."""
    step: float
    """Time [s] of a step."""
    sampled: bool = True
    slow: float = SLOW
    """Largest rate [1/s] of a slow mode."""

    @cached_property
    def _modes(self) -> _LoopModes:
        (A, B), K, n = self.plant, self.K, len(self.K)
        if not len(A):  # nothing comes back, as between an emergency stop and its brakes
            none, never = np.zeros((n, 0), complex), np.zeros((n, 0), bool)
            return _LoopModes(none[0], none[0], none, never, never[0], np.zeros((0, n)))
        closed = A + B @ K
        closed *= _nudges(len(closed))
        poles, right, left = _separated(closed, self.sampled)
        parts = (K @ right) * (left @ B).T
        rest: list[Floats] = []
        if len(poles) < len(A):
            complement = np.eye(len(A)) - (right @ left).real  # onto the states of the other eigenvalues
            power = complement @ B
            while len(rest) < _TERMS and np.abs(power).max() > _LEAST:
                rest.append((K * power.T).sum(axis=1))
                power = complement @ (closed @ power)
        s: Any = np.log(poles) / self.step if self.sampled else poles
        moved = np.abs(parts / poles) / self.step if self.sampled else np.abs(parts)
        slow = (moved <= self.slow) & (s.real <= self.slow) & (s.real > -moved)
        return _LoopModes(poles, s, parts, slow, s.real > _STILL, np.array(rest).reshape(-1, n))

    @property
    def rate(self) -> float:
        """Rate [1/s] of the mode that grows most, or decays least, except constant modes; -inf without any."""
        rates = self._modes.s.real
        return float(rates[np.abs(rates) > _STILL].max(initial=-np.inf))

    @property
    def fastest(self) -> int:
        """The loop that moves most the mode that grows most."""
        return int(np.abs(self._modes.parts[:, self._modes.s.real.argmax()]).argmax())

    def _inverse(self, w: Floats) -> Any:
        """``1 + L``, (m, n), at frequencies (m,) [rad/s], without slow modes."""
        modes = self._modes
        z = np.exp(1j * w * self.step) if self.sampled else 1j * w
        S = 1.0 + (1.0 / (z[:, None] - modes.poles)) @ np.where(modes.slow, 0.0, modes.parts).T
        series = np.zeros_like(S)
        for term in modes.rest[::-1]:
            series = (series + term) / z[:, None]
        return 1.0 / (S + series)

    def _grid(self, points: int) -> Floats:
        """Frequencies [rad/s] up to half the sampling frequency, denser around poles with their peaks."""
        spaced = _spaced(_SLOWEST * np.pi / self.step, np.pi / self.step, points)
        least, most = spaced[[0, -1]]
        s = self._modes.s
        s = s[s.imag > least]
        w = s.imag[:, None] + np.abs(s.real)[:, None] * _AROUND
        return distinct(spaced, w[(w > least) & (w < most)])

    @property
    def lost(self) -> Any:
        """Whether a loop lacks margins, since a mode grows that is not slow, (n,)."""
        return (self._modes.grows & ~self._modes.slow).any(axis=1)

    @cached_property
    def modulus(self) -> Floats:
        """The modulus margin of each loop, (n,)."""
        w = self._grid(_COARSE)
        size = np.abs(self._inverse(w))
        least = size.argmin(axis=0)
        low, high = w[np.maximum(least - 1, 0)], w[np.minimum(least + 1, len(w) - 1)]
        more = (low + high)[:, None] / 2.0 + (high - low)[:, None] / 2.0 * _BETWEEN
        again = np.abs(self._inverse(more.ravel()))
        return np.where(self.lost, 0.0, np.minimum(size.min(axis=0), again.min(axis=0)))

    @property
    def least(self) -> float:
        """The least modulus margin of all loops; 0 if a loop lacks it."""
        return 0.0 if self.lost.any() else float(self.modulus.min())

    def later(self) -> Loop:
        """Return the sampled loops with the feedback of all of them one sample later: the inputs are further states."""
        (A, B), (n, m) = self.plant, self.plant.B.shape
        waiting = Linear(np.vstack([np.hstack([A, B]), np.zeros((m, n + m))]), np.eye(n + m)[:, n:])
        return replace(self, plant=waiting, K=np.hstack([self.K, np.zeros((m, m))]))

    def margins(self) -> Margins:
        """Return all margins."""
        w, n = self._grid(_GRID), len(self.K)
        if self.lost.all():
            return Margins(np.zeros(n), np.ones(n), np.zeros(n), np.zeros(n), self.rate)
        gain, phase, delay = _margins(self._inverse(w) - 1.0, w, self.sampled)
        return Margins(
            self.modulus, np.where(self.lost, 1.0, gain), np.where(self.lost, 0.0, phase),
            np.where(self.lost, 0.0, delay), self.rate,
        )  # fmt: skip


def rates_of(loops: Sequence[Loop]) -> list[float]:
    """Return the rate of each loop, see `Loop.rate`, faster than one by one."""
    rates = np.full(len(loops), -np.inf)
    for shape in {loop.K.shape for loop in loops}:
        alike = [k for k, loop in enumerate(loops) if loop.K.shape == shape]
        poles: Any = np.linalg.eigvals([loops[k].plant.A + loops[k].plant.B @ loops[k].K for k in alike])
        first = loops[alike[0]]
        s = np.log(np.maximum(np.abs(poles), _NONE)) / first.step if first.sampled else poles.real
        rates[alike] = np.where(np.abs(s) > _STILL, s, -np.inf).max(axis=1, initial=-np.inf)
    return rates.tolist()


def margins_of(loops: Sequence[Loop]) -> tuple[Floats, Floats, Floats]:
    """Return rates [1/s], (m,), and modulus and delay margins [s], (m, n) each, faster than one by one.

    Delay margins are from fewer frequencies than those of :meth:`Loop.margins`: they differ by some per cent.
    """
    rates, modulus, delay = np.empty(len(loops)), *np.empty((2, len(loops), len(loops[0].K)))
    for shape in {loop.K.shape for loop in loops}:
        alike = [k for k, loop in enumerate(loops) if loop.K.shape == shape]
        rates[alike], modulus[alike], delay[alike] = _stacked([loops[k] for k in alike])
    return rates, modulus, delay


def _stacked(loops: Sequence[Loop]) -> tuple[Any, Any, Any]:
    """Return the margins of loops with as many states, by stacked matrices as :class:`Loop` has them."""
    first, K, B = loops[0], np.array([loop.K for loop in loops]), np.array([loop.plant.B for loop in loops])
    closed = (np.array([loop.plant.A for loop in loops]) + B @ K) * _nudges(K.shape[2])
    modes = _well_separated(closed) if closed.size else None
    if modes is None:
        alone = [loop.margins() for loop in loops]
        return [each.rate for each in alone], [each.modulus for each in alone], [each.delay for each in alone]
    poles, right, left = modes
    poles = poles.astype(complex) + _NONE
    parts = (K @ right) * (left @ B).swapaxes(1, 2)
    s = np.log(poles) / first.step if first.sampled else poles
    moved = np.abs(parts / poles[:, None]) / first.step if first.sampled else np.abs(parts)
    rates = s.real[:, None]
    slow = (moved <= first.slow) & (rates <= first.slow) & (rates > -moved)
    lost = ((rates > _STILL) & ~slow).any(axis=2)
    parts = np.where(slow, 0.0, parts).swapaxes(1, 2)

    def inverse(w: Floats) -> Any:
        z = np.exp(1j * w * first.step) if first.sampled else 1j * w
        return 1.0 / (1.0 + (1.0 / (z[:, :, None] - poles[:, None])) @ parts)

    spaced = _spaced(_SLOWEST * np.pi / first.step, np.pi / first.step, _COARSE)
    swinging: Any = np.take_along_axis(s, np.argsort(-s.imag)[:, : (s.shape[1] + 1) // 2], axis=1)[:, :, None]
    near = swinging.imag + np.abs(swinging.real) * _AROUND
    w = np.hstack([np.tile(spaced, (len(s), 1)), near.reshape(len(s), -1)])
    w = np.sort(np.clip(w, *spaced[[0, -1]]))
    there = inverse(w)
    size = np.abs(there)
    least = size.argmin(axis=1)
    low, high = (np.take_along_axis(w, np.clip(least + k, 0, w.shape[1] - 1), axis=1) for k in (-1, 1))
    more = (low + high)[:, :, None] / 2.0 + (high - low)[:, :, None] / 2.0 * _BETWEEN
    again = np.abs(inverse(more.reshape(len(s), -1)))
    modulus = np.minimum(size.min(axis=1), again.min(axis=1))
    delay = np.where(lost, 0.0, _delays(there - 1.0, w))
    return np.where(np.abs(rates) > _STILL, rates, -np.inf).max(axis=(1, 2)), np.where(lost, 0.0, modulus), delay


def _well_separated(A: Floats) -> tuple[Any, Any, Any] | None:
    """Return eigenvalues, right eigenvectors and left ones of stacked matrices; None if some are ill-conditioned."""
    try:
        poles, right = np.linalg.eig(A)
        left = np.linalg.inv(right)
    except np.linalg.LinAlgError:
        return None
    condition = np.linalg.norm(right, axis=(1, 2)) * np.linalg.norm(left, axis=(1, 2))
    return (poles, right, left) if condition.max() < _APART else None


def _delays(L: Any, w: Floats) -> Floats:
    """Return the delay margins [s], (m, n), of stacked loops L, (m, k, n), at frequencies w, (m, k): see _margins."""
    size = np.log(np.maximum(np.abs(L), _NONE))
    row, k, loop = np.nonzero((size[:, 1:] * size[:, :-1] <= 0.0) & (size[:, 1:] != size[:, :-1]))
    before, after = L[row, k, loop], L[row, k + 1, loop]
    share = size[row, k, loop] / (size[row, k, loop] - size[row, k + 1, loop])
    lag = np.mod(np.angle(-before) + share * np.angle(after * before.conj()), 2.0 * np.pi)
    delays = np.full((len(L), L.shape[2]), np.inf)
    np.minimum.at(delays, (row, loop), lag / (w[row, k] + share * (w[row, k + 1] - w[row, k])))
    return delays


_spaced = lru_cache(np.geomspace)


@lru_cache
def _nudges(n: int) -> Floats:
    return 1.0 + _NUDGE * np.sin(np.arange(n * n) ** 2.0).reshape(n, n)  # numpy.random takes long to import


def loop_of_part(system: LinearSystem, opened: Sequence[str]) -> Loop:
    """Return the loops of a part, see `LinearSystem.around`, with the delays of its master.

    Each is opened at one of the connected inputs `opened`, such as ``plant.tau``, while all others are closed.
    UsageError for unknown inputs, and for loops in continuous time with feedthrough all around.
    """
    loops, cut = moving(system, opened), system.places(opened)
    returned, at_once = (each[len(loops.C) - len(cut) :] for each in (loops.C, loops.D))
    if loops.step is None and at_once[:, cut].any():  # sampled, nothing comes back in the same step
        raise UsageError(f"{', '.join(opened)}: expected loops with a state, got feed-through all around.")
    plant = Linear(loops.A, loops.B[:, cut])
    if loops.step is not None:  # a waiting output without feedthrough is C x and G s, and no state by itself
        follows = np.flatnonzero(~(system.links @ system.parts.D).any(axis=1))
        n = len(loops.A) - len(system.links)
        whole = np.eye(len(loops.A))
        whole[n + follows, :n] = system.links[follows] @ np.hstack([system.parts.C, system.samples.G])
        kept = np.delete(np.arange(len(whole)), n + follows)
        whole = whole[:, kept]
        plant, returned = Linear(plant.A[kept] @ whole, plant.B[kept]), returned @ whole
    while not (seen := np.vstack([plant.A, returned]).any(axis=0)).all():  # states without effect
        plant, returned = Linear(plant.A[np.ix_(seen, seen)], plant.B[seen]), returned[:, seen]
    return Loop(plant, returned, loops.step or system.step, loops.step is not None)


def opened_at(system: LinearSystem, group: str) -> list[str]:
    """Return the connected inputs of a name, at any component."""
    connected = (system.parts.inputs[i].split("[")[0] for i in np.flatnonzero(system.links.any(axis=1)).tolist())
    return [name for name in dict.fromkeys(connected) if name.endswith(f".{group}")]


def fastest_mode(system: LinearSystem) -> tuple[float, str]:
    """Return the largest rate [1/s] of a mode, and the state with the largest participation in it.

    Participation is the product of the mode's two eigenvectors, a number without unit.
    """
    loops = moving(system)
    poles, right = np.linalg.eig(loops.A)
    same, left = np.linalg.eig(loops.A.T)
    rates: Any = np.real(poles) if loops.step is None else np.log(np.maximum(np.abs(poles), _NONE)) / loops.step
    mode = int(rates.argmax())
    part = np.abs(left[:, np.abs(same - poles[mode]).argmin()] * right[:, mode])
    return float(rates[mode]), loops.states[int(part.argmax())]


def moving(system: LinearSystem, opened: Sequence[str] = ()) -> StateSpace:
    """Return the loops with the delays of their master, some opened."""
    return system.continuous(opened) if system.how.continuous else system.sampled(opened)


class Tied(NamedTuple):
    """Groups of a component: states as functions of outputs, and states as rates of these outputs.

    An example is the torque of a spring, the position of its rotor and the rotor's speed.
    """

    state: str
    output: str
    rate: str


def _separated(A: Floats, sampled: bool) -> tuple[Any, Any, Any]:
    """Return the eigenvalues of a matrix, right eigenvectors, and left ones as rows: pairs have product 1.

    Of a sampled system without small ones. LinAlgError if there are not as many eigenvectors.
    """
    poles, right = np.linalg.eig(A)
    sizes = np.abs(poles)
    with suppress(np.linalg.LinAlgError):
        inverse = np.linalg.inv(right)
        if np.linalg.norm(right) * np.linalg.norm(inverse) < _APART:
            kept = np.flatnonzero(sizes > (_DELAY if sampled else -1.0))
            return poles[kept].astype(complex), right[:, kept], inverse[kept]
    kept = np.flatnonzero(sizes > (_FAST if sampled else -1.0))
    same, left = np.linalg.eig(A.T)  # delays in a row have one eigenvector
    left, right = left[:, np.argsort(-np.abs(same))[: len(kept)]].T, right[:, kept]
    return poles[kept].astype(complex), right, np.linalg.solve(left @ right, left)


def _margins(L: Any, w: Floats, sampled: bool) -> Floats:
    """Gain, phase and delay margin of loops L (m, n) at frequencies w (m,): (3, n).

    Between frequencies the logarithm of a loop is taken as linear.
    """
    margins = np.full((3, L.shape[1]), np.inf)
    for i, loop in enumerate(L.T):
        if not loop.any():  # nothing comes back
            continue
        size = np.log(np.maximum(np.abs(loop), np.finfo(float).tiny))  # of none the log is -708
        left = np.angle(-loop)  # the lag left until -1
        if sampled and loop[-1].real < 0.0:  # at half the sampling frequency a loop is real
            left[-1] = 0.0
        change = np.angle(loop[1:] * loop[:-1].conj())
        turn = np.flatnonzero((left[1:] * left[:-1] <= 0.0) & (np.abs(left[:-1]) < np.pi / 2.0) & (change != 0.0))
        share = np.clip(-left[turn] / change[turn], 0.0, 1.0)
        gains = -(size[turn] + share * (size[turn + 1] - size[turn]))
        margins[0, i] = np.exp(gains[gains > 0.0].min(initial=np.inf))
        cross = np.flatnonzero(size[1:] * size[:-1] <= 0.0)
        share = size[cross] / (size[cross] - size[cross + 1])
        lag = np.mod(left[cross] + share * change[cross], 2.0 * np.pi)
        margins[1, i] = lag.min(initial=np.inf)
        margins[2, i] = (lag / (w[cross] + share * (w[cross + 1] - w[cross]))).min(initial=np.inf)
    return margins
