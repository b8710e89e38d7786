"""The loops of a system, opened one by one: the margins of each, and the modes that grow.

Loop i is opened while all others stay closed. With all loops closed, ``x' = A x + B d``, and K x is fed back to the
opened inputs. One eigendecomposition of A, with eigenvalues p_j, yields all loops, ``1 + L_i = 1 / S_i``:

    S_i = 1 + K_i (z - A)^-1 B_i = 1 + sum_j r_ij / (z - p_j)

on the unit circle, or, in continuous time, on the imaginary axis.

A relative change k of the gain of loop i moves the eigenvalue p_j by k r_ij: r_ij is the influence of the loop on the
growth of the mode. A mode is slow for a loop if it grows at a rate of up to `SLOW`, the loop moves it by less than
`SLOW`, and changing the loop's gain by 100 % can decide whether it grows. It is excluded from the margins of this loop,
because with such a mode they would be 0 for any gains, for example with a vibration of links that neither motors nor
friction damp. Its growth is reported separately.
"""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from functools import cached_property, lru_cache
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt

from vdfmu.base.arrays import Floats
from vdfmu.base.errors import UsageError
from vdfmu.base.state_space import Linear, StateSpace
from vdfmu.engine.linear.system import LinearSystem

Complex = npt.NDArray[np.complex128]

SLOW = 2.0
"""Largest rate [1/s] of a slow mode, at which a disturbance takes half a second to grow by a factor of e."""
_STILL = 1e-3
"""Growth rate [1/s] that may be rounding: a double eigenvalue 1 is accurate to 3e-8, or 3e-4 1/s over 0.1 ms."""
_GRID = 60
"""Frequencies at which loops are calculated, 17 % apart, in addition to those around poles."""
_AROUND = np.array([-6.0, -2.5, -1.0, -0.4, 0.0, 0.4, 1.0, 2.5, 6.0])
"""Distances from the frequency of a pole, relative to its decay rate."""
_BETWEEN = np.linspace(-1.0, 1.0, 11)[1:-1]
"""Places for a second evaluation, between the neighbours of the frequency with the smallest modulus."""
_INSIDE, _ZOOMS = np.linspace(0.0, 1.0, 6)[1:-1], 3
"""Number of frequencies added between two with a crossing of gain 1 or lag 180 degrees, and how often this is repeated:
down to 1/125 of the interval, where linear interpolation is accurate to 1e-5 of it."""
_CLOSE = 0.5
"""Logarithm of the gain of peaks and dips that may cross 1 between two frequencies."""
_SWING = 4.0
"""Largest factor between the lags of a loop at a crossing and at the frequencies next to it."""
_SLOWEST = 1e-4
"""Lowest frequency, relative to half the sampling frequency."""
_FAST = 0.05
"""Eigenvalues up to this size are not separated if their eigenvectors are ill-conditioned, as for delays in series.
Their part of S is then a power series in 1 / z."""
_TERMS, _LEAST = 12, 1e-15
"""Largest number of terms of this series, and size below which its states are regarded as 0, so that the first omitted
term is 1e-15 of the first."""
_NUDGE = 1e-11
"""Relative perturbation of the closed loop's numbers, so that it has as many eigenvectors as states: the position and
speed of a free mass share one. Margins have the same relative accuracy, rates 1e-8 1/s over 1 ms."""
_APART = 1e7
"""Largest condition number of the eigenvectors for an inverse accurate to 1e-9."""
_TOGETHER = 20_000
"""Number of terms of a sum that are calculated together: more take twice as long, because they exceed the processor's
cache."""
_NONE = 1e-300
"""Smallest modulus of a pole whose logarithm is taken."""


class Margins(NamedTuple):
    """Margins of each loop, (n,) each."""

    modulus: Floats
    """Smallest distance of the loop to -1, min |1 + L|; 0, as phase and delay, if a mode grows that is not slow."""
    gain: Floats
    """Smallest factor above 1 of the loop's gain that destabilises it."""
    phase: Floats
    """Smallest phase lag [rad] that destabilises it."""
    delay: Floats
    """Smallest additional delay [s] that destabilises it."""
    rate: float
    """Rate [1/s] of the mode that grows most, or decays least; -inf without any."""


@dataclass(frozen=True)
class Loop:
    """The opened loops of a system at one time."""

    plant: Linear
    """From the opened inputs to the states, over a communication step or in continuous time."""
    K: Floats
    """Gains from the states back to the inputs, (n, n_x)."""
    step: float
    """Time [s] of a step."""
    sampled: bool = True
    slow: float = SLOW
    """Largest rate [1/s] of a slow mode."""

    @cached_property
    def _alone(self) -> _Stack:
        return _Stack([self])

    @property
    def rate(self) -> float:
        """Rate [1/s] of the mode that grows most, or decays least, except constant modes; -inf without any."""
        return float(self._alone.rates[0])

    @property
    def fastest(self) -> int:
        """The loop with the largest influence on the mode that grows most."""
        return int(np.abs(self._alone.parts[0, :, self._alone.s[0].real.argmax()]).argmax())

    @property
    def modulus(self) -> Floats:
        """The modulus margin of each loop, (n,)."""
        return self._alone.modulus[0]

    @property
    def least(self) -> float:
        """The smallest modulus margin of all loops; 0 if a loop has none."""
        return float(self.modulus.min())

    @property
    def delay(self) -> Floats:
        """The delay margin [s] of each loop, (n,)."""
        return self._alone.lags[1][0]

    def later(self) -> Loop:
        """Return the sampled loops with all feedback delayed by a sample, which makes the inputs additional states."""
        (A, B), (n, m) = self.plant, self.plant.B.shape
        waiting = Linear(np.vstack([np.hstack([A, B]), np.zeros((m, n + m))]), np.eye(n + m)[:, n:])
        return replace(self, plant=waiting, K=np.hstack([self.K, np.zeros((m, m))]))

    def margins(self) -> Margins:
        """Return all margins."""
        phase, delay = (each[0] for each in self._alone.lags)
        return Margins(self.modulus, self._alone.gain[0], phase, delay, self.rate)


class _Stack:
    """Modes and margins of m systems of n loops and k states with the same structure.

    `least`: phase and delay margins that cannot be the least of all are infinite.
    """

    def __init__(self, loops: Sequence[Loop], least: bool = False) -> None:
        self._least = least
        first, K, B = loops[0], np.array([loop.K for loop in loops]), np.array([loop.plant.B for loop in loops])
        self._step, self._sampled, self._all = first.step, first.sampled, np.indices(K.shape[:2])
        closed = (np.array([loop.plant.A for loop in loops]) + B @ K) * _nudges(K.shape[2])
        self._poles, right, left, rest = _separated(closed, self._sampled)
        self._series = list[Floats]()
        """Terms of a power series in 1 / z, (m, n) each."""
        power = rest @ B
        while len(self._series) < _TERMS and np.abs(power).max(initial=0.0) > _LEAST:
            self._series.append((K * power.swapaxes(1, 2)).sum(axis=2))
            power = rest @ (closed @ power)
        self.parts = (K @ right) * (left @ B).swapaxes(1, 2)
        """r, (m, n, k)."""
        self.s: Any = np.log(self._poles) / self._step if self._sampled else self._poles
        """Eigenvalues in continuous time [1/s], (m, k)."""
        moved = np.abs(self.parts / self._poles[:, None]) / self._step if self._sampled else np.abs(self.parts)
        rates = self.s.real[:, None]
        slow = (moved <= first.slow) & (rates <= first.slow) & (rates > -moved)
        self._acting = np.where(slow, 0.0, self.parts)
        self._lost = ((rates > _STILL) & ~slow).any(axis=2)
        self.rates: Floats = np.where(np.abs(rates) > _STILL, rates, -np.inf).max(axis=(1, 2), initial=-np.inf)
        """See `Loop.rate`, (m,)."""

    @cached_property
    def _grid(self) -> tuple[Floats, Any]:
        """Frequencies [rad/s] up to half the sampling frequency, denser around poles and their peaks, and ``1 + L``."""
        spaced = _spaced(_SLOWEST * np.pi / self._step, np.pi / self._step, _GRID)
        least, most = spaced[[0, -1]]
        swinging = (self.s.imag > least).sum(axis=1).max()
        s: Any = np.take_along_axis(self.s, np.argsort(-self.s.imag)[:, :swinging], axis=1)[:, :, None]
        near = np.clip(s.imag + np.abs(s.real) * _AROUND, least, most).reshape(len(s), -1)
        w = np.sort(np.hstack([np.tile(spaced, (len(s), 1)), near]))
        return w, self._inverse(w, *self._all)

    def _inverse(self, w: Floats, row: Any, loop: Any) -> Any:
        """``1 + L``, (c, p, l), at frequencies (c, p) [rad/s], of systems and their loops (c, l) without slow modes."""
        parts = np.array_split(np.arange(len(w)), 1 + w.size * self._poles.shape[1] // _TOGETHER)
        return np.concatenate([self._part_of_inverse(w[part], row[part], loop[part]) for part in parts])

    def _part_of_inverse(self, w: Floats, row: Any, loop: Any) -> Any:
        z: Any = np.exp(1j * w * self._step) if self._sampled else 1j * w
        z = z[:, :, None]
        S = 1.0 + (1.0 / (z - self._poles[row[:, :1]])) @ self._acting[row, loop].swapaxes(1, 2)
        series = np.zeros_like(S)
        for term in self._series[::-1]:
            series = (series + term[row, loop][:, None]) / z
        return 1.0 / (S + series)

    @cached_property
    def modulus(self) -> Floats:
        """Modulus margins, (m, n)."""
        w, inverse = self._grid
        size = np.abs(inverse)
        least = size.argmin(axis=1)
        low, high = (np.take_along_axis(w, np.clip(least + k, 0, w.shape[1] - 1), axis=1) for k in (-1, 1))
        more = (low + high)[:, :, None] / 2.0 + (high - low)[:, :, None] / 2.0 * _BETWEEN
        again = np.abs(self._inverse(more.reshape(len(w), -1), *self._all))
        return np.where(self._lost, 0.0, np.minimum(size.min(axis=1), again.min(axis=1)))

    @cached_property
    def gain(self) -> Floats:
        """Gain margins, (m, n)."""
        gain = np.full(self._lost.shape, np.inf)
        place, _, of_loop = self._crossings(lag=True)
        np.minimum.at(gain, place, np.where(of_loop.real < 0.0, np.exp(np.maximum(-of_loop.real, 0.0)), np.inf))
        return np.where(self._lost, 1.0, gain)

    @cached_property
    def lags(self) -> tuple[Floats, Floats]:
        """Phase margins [rad] and delay margins [s], (m, n) each."""
        phase, delay = np.full((2, *self._lost.shape), np.inf)
        place, w, of_loop = self._crossings(lag=False)
        left = np.mod(of_loop.imag, 2.0 * np.pi)
        np.minimum.at(phase, place, left)
        np.minimum.at(delay, place, left / w)
        return np.where(self._lost, 0.0, phase), np.where(self._lost, 0.0, delay)

    def _crossings(self, *, lag: bool) -> tuple[tuple[Any, Any], Floats, Any]:
        """Return loops, frequencies [rad/s] and ``log -L``, (c,) each, where a lag is 180 degrees or a gain is 1."""
        w, inverse = self._grid
        L = inverse - 1.0
        log: Any = _log_of(L) if lag else np.log(np.maximum(np.abs(L), _NONE))  # the phase takes ten times as long
        # at half the sampling frequency a loop is real
        (log if lag else L)[:, -1].imag[self._sampled & (L[:, -1].real < 0.0)] = 0.0
        row, k, loop = np.nonzero(_crosses(log, lag) | (False if lag else _may_cross(log)))
        at = row[:, None], np.stack([k, k + 1], axis=1), loop[:, None]
        w, log = w[at[:2]], log[at] if lag else _log_of(L[at])
        if self._least and not lag:
            delay, turned = np.mod(log.imag, 2.0 * np.pi) / w, np.abs(np.diff(log.imag, axis=1)[:, 0]) > np.pi
            limit = delay.max(axis=1)[_crosses(log, lag)[:, 0]].min(initial=np.inf)
            may = turned | (delay.min(axis=1) < _SWING * limit)
            row, loop, w, log = (each[may] for each in (row, loop, w, log))
        for _ in range(_ZOOMS):
            inside = w[:, :1] + (w[:, 1:] - w[:, :1]) * _INSIDE
            log = np.hstack(
                [log[:, :1], _log_of(self._inverse(inside, row[:, None], loop[:, None])[:, :, 0] - 1.0), log[:, 1:]]
            )
            w = np.hstack([w[:, :1], inside, w[:, 1:]])
            which, k = np.nonzero(_crosses(log, lag))
            row, loop = row[which], loop[which]
            w, log = (np.stack([each[which, k], each[which, k + 1]], axis=1) for each in (w, log))
        change = np.diff(log, axis=1)[:, 0]
        change.imag -= 2.0 * np.pi * np.rint(change.imag / (2.0 * np.pi))
        share = np.clip(-log[:, 0].imag / change.imag if lag else -log[:, 0].real / change.real, 0.0, 1.0)
        return (row, loop), w[:, 0] + share * (w[:, 1] - w[:, 0]), log[:, 0] + share * change


def _log_of(L: Any) -> Any:
    """Return ``log -L``: the logarithm of a loop's gain, -691 for a gain of 0, and its remaining lag until -1."""
    return np.log(np.where(np.abs(L) > _NONE, -L, _NONE))


def _crosses(log: Any, lag: bool) -> Any:
    """Return whether a lag crosses 180 degrees, or a gain 1, before the next frequency, along axis 1."""
    part = log.imag if lag else log.real
    before, after = part[:, :-1], part[:, 1:]
    crosses = (before * after <= 0.0) & (before != after)
    return crosses & (np.abs(before) < np.pi / 2.0) if lag else crosses


def _may_cross(size: Floats) -> Any:
    """Return whether the log gain has a peak or dip close to 0 at a frequency or the next, along axis 1."""
    apart = np.abs(size)
    closest = (apart[:, 1:-1] <= apart[:, :-2]) & (apart[:, 1:-1] <= apart[:, 2:]) & (apart[:, 1:-1] < _CLOSE)
    near = np.zeros(size[:, 1:].shape, bool)
    near[:, :-1] = closest
    near[:, 1:] |= closest
    return near


def rates_of(loops: Sequence[Loop]) -> list[float]:
    """Return the rate of each loop, see `Loop.rate`, all at once, which is faster."""
    rates = np.full(len(loops), -np.inf)
    for shape in {loop.K.shape for loop in loops}:
        alike = [k for k, loop in enumerate(loops) if loop.K.shape == shape]
        poles: Any = np.linalg.eigvals([loops[k].plant.A + loops[k].plant.B @ loops[k].K for k in alike])
        first = loops[alike[0]]
        s = np.log(np.maximum(np.abs(poles), _NONE)) / first.step if first.sampled else poles.real
        rates[alike] = np.where(np.abs(s) > _STILL, s, -np.inf).max(axis=1, initial=-np.inf)
    return rates.tolist()


def margins_of(loops: Sequence[Loop], least: bool = False) -> tuple[Floats, Floats, Floats]:
    """Return rates [1/s], (m,), and modulus and delay margins [s], (m, n) each, all at once, which is faster.

    `least`: delay margins that cannot be the least of loops with as many states are infinite.
    """
    rates, modulus, delay = np.empty(len(loops)), *np.empty((2, len(loops), len(loops[0].K)))
    for shape in {loop.K.shape for loop in loops}:
        alike = [k for k, loop in enumerate(loops) if loop.K.shape == shape]
        stack = _Stack([loops[k] for k in alike], least)
        rates[alike], modulus[alike], delay[alike] = stack.rates, stack.modulus, stack.lags[1]
    return rates, modulus, delay


_spaced = lru_cache(np.geomspace)


@lru_cache
def _nudges(n: int) -> Floats:
    return 1.0 + _NUDGE * np.sin(np.arange(n * n) ** 2.0).reshape(n, n)  # numpy.random takes long to import


def loop_of_part(system: LinearSystem, opened: Sequence[str]) -> Loop:
    """Return the loops of a part, see `LinearSystem.around`, with the master's delays.

    Each is opened at one of the connected inputs `opened`, such as ``plant.tau``, while all others are closed.
    UsageError for unknown inputs, and for continuous-time loops without a state.
    """
    loops, cut = moving(system, opened), system.places(opened)
    returned, at_once = (each[len(loops.C) - len(cut) :] for each in (loops.C, loops.D))
    if loops.step is None and at_once[:, cut].any():  # sampled, nothing comes back in the same step
        raise UsageError(f"{', '.join(opened)}: expected loops with a state, got feed-through all around.")
    plant = Linear(loops.A, loops.B[:, cut])
    if loops.step is not None:  # a waiting output without feedthrough is C x and G s, so it is not a separate state
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
    """Return the largest rate [1/s] of a mode and the state with the largest participation in it.

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
    """Return the loops with their master's delays, opened at some inputs."""
    return system.continuous(opened) if system.how.continuous else system.sampled(opened)


class Tied(NamedTuple):
    """Groups of a component: states that are functions of outputs, and states that are rates of these outputs.

    An example is the torque of a spring, the position of its rotor and the rotor's speed.
    """

    state: str
    output: str
    rate: str


def _separated(A: Floats, sampled: bool) -> tuple[Any, Any, Any, Floats]:
    """Return eigenvalues (m, k) of matrices, right eigenvectors, left ones as rows, and the part that is not separated.

    Pairs of eigenvectors have product 1. In a sampled system, small eigenvalues with ill-conditioned eigenvectors are
    not separated: they get eigenvectors of 0, and the projections onto their states are returned, (m, k, k).
    LinAlgError if the others are ill-conditioned too.
    """
    poles, right = np.linalg.eig(A)
    poles, right = poles.astype(complex) + _NONE, right.astype(complex)
    left, rest = np.zeros_like(right), np.zeros_like(A)
    for row, vectors in enumerate(right):
        with suppress(np.linalg.LinAlgError):
            left[row] = np.linalg.inv(vectors)
            if np.linalg.norm(vectors) * np.linalg.norm(left[row]) < _APART:
                continue
        small = np.abs(poles[row]) <= (_FAST if sampled else -1.0)
        same, vectors_of_same = np.linalg.eig(A[row].T)  # delays in series share one eigenvector
        kept = vectors_of_same[:, np.argsort(-np.abs(same))[: np.count_nonzero(~small)]].T
        left[row, ~small] = np.linalg.solve(kept @ vectors[:, ~small], kept)
        left[row, small] = right[row][:, small] = 0.0
        rest[row] = np.eye(len(small)) - (right[row] @ left[row]).real if small.any() else 0.0
    return poles, right, left, rest
