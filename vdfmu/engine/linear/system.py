"""A system of FMUs linearised at a time of its run: its components side by side, and their connections.

The directional derivatives of a component give ``x_dot = A x + B u``, ``y = C x + D u``; the matrices of all
components together are block diagonal. A connected input is ``u = L y + d``: the outputs connected to it, ``L y``, and
a disturbance d.

In continuous time ``y = (1 - D L)^-1 (C x + D d)``. Sampled, as in the master's steps, inputs are held over a step h
and x is solved exactly, ``x[k+1] = Phi x[k] + Gamma u[k]``; outputs at its end are ``y[k+1] = C x[k+1] + D u[k]``. An
input is ``u[k] = L y[k] + d[k]``, which delays feedthrough by a sample, or ``u[k] = L y[k+1] + d[k]`` if an ordered
algorithm passes on fresh values. The step h is one of the algorithm's substeps.

Sampled states s change at the start of the step, ``s[k+1] = F (x[k], u[k], s[k])``, and are held over it, so they act
on x and y like inputs. If a component samples only at every n-th communication point, the system is sampled at the
common period of all samples; see :func:`_over_period`.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt

from vdfmu.base.arrays import Floats
from vdfmu.base.errors import UsageError
from vdfmu.base.state_space import Linear, Signal, StateSpace, held
from vdfmu.engine.algorithms import ALGORITHMS, Algorithm

_MOST_STEPS = 2000
"""Largest number of steps in a common period: the products of this many matrices take 0.1 s for six joints, at each
pose."""
_BEGINS = 8
"""Number of starts of the period tried for opened inputs, because each unit on the path of a sample delays it by a
step."""
_ROUNDING = 1e-9
"""Rounding of a product of matrices, relative to the product of their sizes: 1e-16 for each of up to 1e6 additions."""

Places = tuple[npt.NDArray[np.intp], npt.NDArray[np.intp], npt.NDArray[np.intp], npt.NDArray[np.intp]]


class Samples(NamedTuple):
    """Sampled states of all components: their signals, and how they act on the rest."""

    signals: Sequence[Signal]
    E: Floats
    """Derivatives of the continuous states with respect to them, (n_x, n_s)."""
    G: Floats
    """Derivatives of the outputs with respect to them, (n_y, n_s)."""
    F: Floats
    """Derivatives of the next sample with respect to continuous states, inputs and sampled states, (n_s, n_x + n_u +
    n_s)."""


@dataclass(frozen=True)
class LinearSystem:
    """The linear components of a system and their connections."""

    parts: StateSpace
    """The components side by side; names are ``component.variable``."""
    links: Floats
    """L, (n_u, n_y)."""
    fresh: npt.NDArray[np.bool_]
    """Whether each input gets the value of the same step, (n_u,)."""
    step: float
    """The communication step, or one of the algorithm's substeps [s]."""
    algorithm: str
    samples: Samples
    constant: tuple[str, ...] = ()
    """Connected signals that change only at communication points, with unknown derivatives."""
    every: Mapping[str, int] = field(default_factory=dict[str, int])
    """Communication steps between samples by component; 1 if a component is missing."""

    @property
    def period(self) -> float:
        """Common period [s] of all samples: a step of the sampled system."""
        return self.step * math.lcm(*self._intervals.tolist())

    @property
    def _intervals(self) -> npt.NDArray[np.intp]:
        """Communication steps between samples, by sampled state."""
        owners = (name.partition(".")[0] for name, _, _ in self.samples.signals)
        return np.array([self.every.get(owner, 1) for owner in owners], np.intp)

    @property
    def how(self) -> Algorithm:
        """The algorithm as a row of `ALGORITHMS`."""
        return ALGORITHMS[self.algorithm]

    def places(self, inputs: Sequence[str]) -> list[int]:
        """Return the places of connected inputs, ``component.variable``, with or without an index; UsageError else."""
        connected = {self.parts.inputs[i]: i for i in np.flatnonzero(self.links.any(axis=1)).tolist()}
        places = [[i for name, i in connected.items() if wanted in (name, name.split("[")[0])] for wanted in inputs]
        if missing := [name for name, each in zip(inputs, places, strict=True) if not each]:
            groups = ", ".join(dict.fromkeys(name.split("[")[0] for name in connected)) or "none"
            raise UsageError(f"{', '.join(missing)}: expected connected continuous inputs. There are: {groups}.")
        return list(dict.fromkeys(i for each in places for i in each))

    def around(self, opened: Sequence[str]) -> LinearSystem:
        """Return the part on paths from the opened inputs back to them, which decides the stability of these loops.

        UsageError for unknown inputs.
        """
        return self.part(self.on(opened))

    def on(self, opened: Sequence[str]) -> Places:
        """Return the places of :meth:`around`."""
        (n, m), r = self.parts.B.shape, len(self.parts.C)
        ends, acts = np.cumsum([n, m, r]), self.acts
        cut = n + np.array(self.places(opened), np.intp)
        on = reached(acts, cut) & reached(acts.T, cut)
        on[cut] = True
        on[n + m + np.flatnonzero(self.links[cut - n].any(axis=0))] = True  # even if nothing is fed back at this time
        x, u, y, s = (np.flatnonzero(part) for part in np.split(on, ends))
        return x, u, y, s

    @property
    def acts(self) -> npt.NDArray[np.bool_]:
        """Return whether columns act on rows: states, inputs, outputs and sampled states."""
        p, samples = self.parts, self.samples
        (n, m), r, k = p.B.shape, len(p.C), len(samples.signals)
        acts = np.zeros((n + m + r + k,) * 2, bool)
        knows = np.r_[: n + m, n + m + r : n + m + r + k]
        acts[np.ix_(range(n), knows)] = np.hstack([p.A, p.B, samples.E]) != 0.0
        acts[np.ix_(range(n + m, n + m + r), knows)] = np.hstack([p.C, p.D, samples.G]) != 0.0
        acts[n + m + r :, knows] = samples.F != 0.0
        acts[n : n + m, n + m : n + m + r] = self.links != 0.0
        return acts

    def part(self, places: Places) -> LinearSystem:
        """Return a part of the system: some of its states, inputs, outputs and sampled states."""
        p, samples, (x, u, y, s) = self.parts, self.samples, places
        n, m = p.B.shape
        whole = np.block([[p.A[np.ix_(x, x)], p.B[np.ix_(x, u)]], [p.C[np.ix_(y, x)], p.D[np.ix_(y, u)]]])
        kinds = (
            (p.states, p.state_units, p.x, x),
            (p.inputs, p.input_units, p.u, u),
            (p.outputs, p.output_units, p.y, y),
        )
        signals = ([(names[i], units[i], float(values[i])) for i in at] for names, units, values, at in kinds)
        kept = Samples(
            [samples.signals[i] for i in s.tolist()],
            samples.E[np.ix_(x, s)],
            samples.G[np.ix_(y, s)],
            samples.F[np.ix_(s, np.concatenate([x, n + u, n + m + s]))],
        )
        return replace(
            self,
            parts=replace(StateSpace.of(whole, *signals), notes=p.notes),
            links=self.links[np.ix_(u, y)],
            fresh=self.fresh[u],
            samples=kept,
        )

    @property
    def whole(self) -> Floats:
        """All matrices as one: rates, outputs and samples by states, inputs and sampled states."""
        p, (_, E, G, F) = self.parts, self.samples
        return np.vstack([np.hstack([p.A, p.B, E]), np.hstack([p.C, p.D, G]), F])

    def with_whole(self, M: Floats) -> LinearSystem:
        """Return the system with the matrices in `M`, see `whole`."""
        (n, m), p = self.parts.B.shape, len(self.parts.C)
        parts = replace(self.parts, A=M[:n, :n], B=M[:n, n : n + m], C=M[n : n + p, :n], D=M[n : n + p, n : n + m])
        samples = self.samples._replace(E=M[:n, n + m :], G=M[n : n + p, n + m :], F=M[n + p :])
        return replace(self, parts=parts, samples=samples)

    def in_whole(self, places: Places) -> Any:
        """Return the index of a part in `whole`."""
        (n, m), p, (x, u, y, s) = self.parts.B.shape, len(self.parts.C), places
        return np.ix_(np.concatenate([x, n + y, n + p + s]), np.concatenate([x, n + u, n + m + s]))

    def continuous(self, opened: Sequence[str] = ()) -> StateSpace:
        """Return the system in continuous time; the connections of `opened` inputs are cut.

        Opened inputs get only d, and the signals at their connections become the last outputs. UsageError for unknown
        inputs, or for an algebraic loop without a solution.
        """
        A, B, C, D = (getattr(self.parts, name) for name in "ABCD")
        cut = self.places(opened)
        fed = self.links.copy()
        fed[cut] = 0.0
        inner = np.eye(len(fed)) - fed @ D
        try:
            U: Any = np.linalg.solve(inner, np.hstack([fed @ C, np.eye(len(fed))]))  # u = U (x, d)
        except np.linalg.LinAlgError:
            raise UsageError("linearize: a feedthrough loop has gain 1, so there is no solution.") from None
        x = np.hstack([A, np.zeros_like(B)]) + B @ U
        y = np.hstack([C, np.zeros_like(D)]) + D @ U
        system = self._named(x, np.vstack([y, (self.links @ y)[cut]]), cut, None)
        held = [*self.constant, *(name for name, _, _ in self.samples.signals)]
        notes = [f"treated as constant, because it changes only at communication points: {name}" for name in held]
        return replace(system, notes=(*system.notes, *notes))

    def sampled(self, opened: Sequence[str] = ()) -> StateSpace:
        """Return the system from one communication point to the next, or over the common period of its samples.

        States are the components' states, sampled states last, then the values L y that wait at the components' inputs.
        Outputs are ``C x + D u``. For `opened` see :meth:`continuous`.

        UsageError for unknown inputs, for unknown changes of signals at communication points, and for opened inputs
        whose signal changes more than once in the common period.
        """
        if not (self.how.continuous or self.how.substeps):
            text = f"the algorithm {self.algorithm} declares neither substeps nor continuous, so its loop is not known."
            raise UsageError(f"{text} Declare one of them in its Algorithm.")
        if self.constant:
            raise UsageError(
                f"{', '.join(self.constant)}: the sampled loop cannot be linearised, because these change at "
                "communication points and their derivatives are not known. FMUs built by vdfmu declare sampled states."
            )
        if (self._intervals != 1).any():
            return _over_period(self, opened)
        A, B, C, D = (getattr(self.parts, name) for name in "ABCD")
        (n_x, m), n_s, cut = B.shape, len(self.samples.signals), self.places(opened)
        _, E, G, F = self.samples
        Phi, Gamma = held(Linear(A, np.hstack([B, E])), self.step)
        by_s, keeps = np.vstack([Gamma[:, m:], np.eye(n_s)]), np.zeros((n_x + n_s, n_x + n_s))
        keeps[:n_x, :n_x] = Phi
        # sampling comes first in the step: F returns the s that is held for x and y during the step
        Phi = keeps + by_s @ np.hstack([F[:, :n_x], F[:, n_x + m :]])
        Gamma = np.vstack([Gamma[:, :m], np.zeros((n_s, m))]) + by_s @ F[:, n_x : n_x + m]
        C, n = np.hstack([C, G]), n_x + n_s
        ends = np.hstack([self.links @ C @ Phi, np.zeros((m, m))])  # L y at the end of the step, by (x, w)
        by_u = self.links @ (C @ Gamma + D)
        fresh = self.fresh[:, None].astype(float)
        late = np.hstack([np.zeros((m, n)), np.diag(1.0 - fresh[:, 0])])
        keep = np.ones((m, 1))
        keep[cut] = 0.0
        U: Any = np.linalg.solve(
            np.eye(m) - keep * fresh * by_u, np.hstack([keep * (fresh * ends + late), np.eye(m)])
        )  # u by (x, w, d)
        none = np.zeros((m, m))
        waits = np.hstack([ends, none]) + by_u @ U
        x = np.hstack([Phi, np.zeros((n, 2 * m))]) + Gamma @ U
        y = np.hstack([C, np.zeros((len(C), 2 * m))]) + D @ U
        back = fresh * waits + np.hstack([late, none])
        return self._named(np.vstack([x, waits]), np.vstack([y, back[cut]]), cut, self.step)

    def _named(self, motion: Floats, outputs: Floats, cut: list[int], step: float | None) -> StateSpace:
        """Return the state space of matrices with columns (states, d); signals at cut inputs are the last outputs."""
        p, size, value = self.parts, len(motion), self.links @ self.parts.y
        waiting, signals = (len(value), self.samples.signals) if step is not None else (0, ())
        return replace(
            p,
            A=motion[:, :size],
            B=motion[:, size:],
            C=outputs[:, :size],
            D=outputs[:, size:],
            step=step,
            states=(*p.states, *(name for name, _, _ in signals), *(f"at {name}" for name in p.inputs[:waiting])),
            state_units=(*p.state_units, *(unit for _, unit, _ in signals), *p.input_units[:waiting]),
            x=np.concatenate([p.x, [x for _, _, x in signals], value[:waiting]]),
            outputs=(*p.outputs, *(p.inputs[i] for i in cut)),
            output_units=(*p.output_units, *(p.input_units[i] for i in cut)),
            y=np.concatenate([p.y, value[cut]]),
        )


def _over_period(system: LinearSystem, opened: Sequence[str]) -> StateSpace:
    """Return a system over the common period of its samples; see :meth:`LinearSystem.sampled`.

    Sampled states are held until they are due. The matrices of the period are the products of its steps' matrices, with
    constant d. A loop can only be opened at a signal that is constant over the period, so several starts of the period
    are tried until the loop, closed again through this signal, equals the original loop.
    """
    n = round(system.period / system.step)
    if n > _MOST_STEPS:
        text = f"{', '.join(system.every)}: expected a common period of all samples of at most {_MOST_STEPS} steps"
        raise UsageError(f"{text}, got {n}. Choose periods with a common divisor.")
    steps = _steps_of(system, opened)
    if not opened:
        return replace(steps[0], **_product(steps), step=system.period)
    closed, m = _steps_of(system, ()), len(system.places(opened))
    for begin in range(min(n, _BEGINS)):
        turned, run = ([*each[begin:], *each[:begin]] for each in (steps, closed))
        product, first, before = _product(turned), turned[0], run[-1].A  # its range is all the loop can reach
        cut, returned = system.places(opened), first.C[len(first.C) - m :]
        size = np.abs(_product(run, np.abs)["A"]) + np.abs(product["B"][:, cut]) @ np.abs(returned)
        apart = (product["A"] + product["B"][:, cut] @ returned - _product(run)["A"]) @ before
        if (np.abs(apart) <= _ROUNDING * (size @ np.abs(before))).all():
            return replace(first, **product, step=system.period)
    raise UsageError(
        f"{', '.join(opened)}: expected a signal that changes once in {system.period:g} s, the common period of all "
        "samples. Margins need a single change."
    )


def _steps_of(system: LinearSystem, opened: Sequence[str]) -> list[StateSpace]:
    """Return the system over each step of the common period of its samples; all are due at the first."""
    every, samples, made = system._intervals, system.samples, dict[bytes, StateSpace]()  # pyright: ignore[reportPrivateUsage]
    held_rows = np.eye(len(every), samples.F.shape[1], samples.F.shape[1] - len(every))
    steps: list[StateSpace] = []
    for k in range(math.lcm(*every.tolist())):
        due = k % every == 0
        if due.tobytes() not in made:
            now = samples._replace(F=np.where(due[:, None], samples.F, held_rows))
            made[due.tobytes()] = replace(system, samples=now, every={}).sampled(opened)
        steps.append(made[due.tobytes()])
    return steps


def _product(steps: Sequence[StateSpace], of: Any = np.asarray) -> dict[str, Floats]:
    """Return the matrices A and B of several steps, the first one first, with the same d; `of` is applied to each."""
    A, B = of(steps[0].A), of(steps[0].B)
    for step in steps[1:]:
        A, B = of(step.A) @ A, of(step.A) @ B + of(step.B)
    return {"A": A, "B": B}


def cut(system: LinearSystem) -> list[str]:
    """Return a small set of connected inputs, as whole vectors, whose opening cuts all loops of a system.

    The choice is greedy: each input is the one that leaves the fewest inputs on loops and, among equals, has the fewest
    elements.
    """
    n, names, acts = len(system.parts.A), system.parts.inputs, system.acts.copy()
    groups: dict[str, list[int]] = {}
    for i in np.flatnonzero(system.links.any(axis=1)).tolist():
        groups.setdefault(names[i].partition("[")[0], []).append(n + i)

    def on_loops(acts: npt.NDArray[np.bool_]) -> list[str]:
        return [name for name, places in groups.items() if any(reached(acts, np.array([i]))[i] for i in places)]

    def without(name: str) -> npt.NDArray[np.bool_]:
        left = acts.copy()
        left[groups[name]] = False
        return left

    opened: list[str] = []
    while looped := on_loops(acts):
        opened.append(min(looped, key=lambda name: (len(on_loops(without(name))), len(groups[name]))))
        acts = without(opened[-1])
    return opened


def reached(acts: npt.NDArray[np.bool_], begins: npt.NDArray[np.intp]) -> npt.NDArray[np.bool_]:
    """Return whether each place is affected by some of them in any number of steps."""
    affected = np.zeros(len(acts), bool)
    new = np.zeros(len(acts), bool)
    new[begins] = True
    while new.any():
        new = acts[:, new].any(axis=1) & ~affected
        affected |= new
    return affected
