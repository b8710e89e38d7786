"""The stage equations of :mod:`vdfmu.compiler.functions.rodas` for a chain, part by part.

A balance of a chain is calculated outward, then inward, like the inverse dynamics of an arm. Linearised at the start of
a step, the values that a part passes inward follow from those that it receives outward: ``db = S da + s``. The
elimination makes one inward pass per step, for S. Each stage makes an inward pass for s, and an outward pass for the
increments of the states.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import cache
from typing import Any

import casadi as ca
import numpy as np

from vdfmu.compiler.functions.chain import LOCAL, ChainError, ChainPart, PartChain, Place, column_of
from vdfmu.compiler.functions.chain_calls import ChainCalls, called, read_of
from vdfmu.compiler.functions.operations import Operations
from vdfmu.compiler.functions.rodas import GAMMA, Stages, permuted, varying
from vdfmu.compiler.scalar.matrices import factorize, solve_factorized, sparse
from vdfmu.compiler.scalar.symbol import Symbol, from_sx, to_sx

OUTWARD, INWARD = 0, 1
"""Turns of the passes of a balance."""


class ChainStages:
    """The stage equations of the balance of a chain.

    `states` are the names of a part's states in the order of x, `order` the names in the order of elimination.
    """

    def __init__(self, balance: PartChain, states: Sequence[str], order: Sequence[str]) -> None:
        if not set(balance.first) <= {OUTWARD, INWARD}:
            raise ChainError("expected at most an outward and an inward pass over the chain, got more")
        self._chain, self._n = balance, len(balance.kinds)
        self._states = list(states)
        parts = [_LinearPart(part, self._states) for part in balance.parts]
        self._carried = [k for k in range(len(states)) if any(k in part.carried for part in parts)]
        self._explicit = [k for k in range(len(states)) if all(k in part.explicit for part in parts)]
        elimination = np.array([self._states.index(name) for name in order])
        sizes = [balance.first[turn].numel() if turn in balance.first else 0 for turn in (OUTWARD, INWARD)]
        self._kinds = [part.functions(k, self._carried, self._explicit, elimination) for k, part in enumerate(parts)]
        self._size = sizes[INWARD]

    @property
    def rows(self) -> list[int]:
        """Rows of the balance whose derivatives are passed from stage to stage."""
        return [k * self._n + i for k in self._carried for i in range(self._n)]

    def _factor(self, calls: ChainCalls, h: ca.MX) -> list[ca.MX]:
        """Return the factors of each part."""
        chain = self._chain
        factors: list[ca.MX] = [ca.MX(0, 1)] * self._n
        S = self._at_the_end(calls)
        for i in reversed(range(self._n)):
            before = {
                f"before_{turn}": calls.values[i][f"before_{turn}"][: column.numel()]
                for turn, column in chain.first.items()
            }
            made = calls.call(self._kinds[chain.kinds[i]].eliminate, i, S=S, h=h, **before)
            factors[i], S = made["factors"], made.get("S_new", S)
        return factors

    def _at_the_end(self, calls: ChainCalls) -> ca.MX:
        """Return the derivative of the first values of the inward pass by the last values of the outward pass."""
        chain = self._chain
        if not self._size or OUTWARD not in chain.first:
            return ca.MX(self._size, 1)
        slope = ca.densify(ca.vec(ca.jacobian(chain.first[INWARD], chain.last[OUTWARD])))
        return calls.of_ends("at_the_end", {"S": slope})["S"]

    def start(self, arguments: Mapping[str, ca.MX], x_dot: ca.MX, h: ca.MX, rates: Mapping[str, ca.MX]) -> ca.MX:
        """Return the factors of the chain, followed by the time derivative of the balance.

        `rates` are the rates of the arguments that change.
        """
        moving = chain_rates(self._chain, set(rates))
        arguments = {**arguments, "x_dot": x_dot, **{f"rate_{key}": rate for key, rate in rates.items()}}
        calls = ChainCalls(moving, arguments)
        return ca.vertcat(*self._factor(calls, h), *calls.results())

    def stages(self, name: str) -> Stages:
        """Return the equations of the stages, with the factors of :meth:`start`."""
        n, m, chain = self._n, len(self._states), self._chain
        kinds = [self._kinds[kind] for kind in chain.kinds]
        ends = np.cumsum([0, *(kind.eliminate.numel_out("factors") for kind in kinds)]).tolist()
        factors, right, delay = ca.MX.sym("factors", ends[-1] + n * m), ca.MX.sym("right", n * m), ca.MX.sym("delay")
        slope = ca.MX.sym("slope", len(self._carried) * n)

        def of_part(vector: ca.MX, i: int, prefix: str, count: int, begin: int = 0) -> dict[str, ca.MX]:
            return {f"{prefix}_{k}": vector[begin + k * n + i] for k in range(count)}

        own_factors = [factors[ends[i] : ends[i + 1]] for i in range(n)]
        s = ca.MX.zeros(self._size)
        alone: list[ca.MX] = [ca.MX(0, 1)] * n  # increments if the previous part is at rest
        for i in reversed(range(n)):
            more = of_part(right, i, "right", m) | of_part(factors, i, "along", m, ends[-1])
            more |= of_part(slope, i, "slope", len(self._carried)) | {"factors": own_factors[i], "s": s, "delay": delay}
            made = called(kinds[i].inward, more)
            alone[i], s = made["u"], made.get("s_new", s)
        moved = ca.MX.zeros(chain.first[OUTWARD].numel() if OUTWARD in chain.first else 0)
        u: list[list[ca.MX]] = [[] for _ in range(m)]
        for i in range(n):
            more = of_part(slope, i, "slope", len(self._carried))
            more |= {"factors": own_factors[i], "alone": alone[i], "moved": moved}
            made = called(kinds[i].outward, more)
            moved = made.get("moved_new", moved)
            for k in range(m):
                u[k].append(made[f"u_{k}"])
        arguments = {"factors": factors, "right": right} | ({"slope": slope} if self._carried else {})
        arguments["delay"] = delay
        made = [ca.vertcat(*(x for row in u for x in row))]
        solve = ca.Function(f"{name}_solve", list(arguments.values()), made, list(arguments), ["u"])
        explicit = np.zeros(n * m)
        for k in self._explicit:
            explicit[k * n : (k + 1) * n] = 1.0
        return Stages(factors, solve, ca.DM(explicit), self.rows)


def chain_rates(balance: PartChain, names: set[str]) -> PartChain:
    """Return the chain of a balance's time derivative, with arguments ``rate_<name>`` for those of `names`."""
    places = [
        {**each, **{f"rate_{group}": Place(f"rate_{place.name}", place.begin) for group, place in each.items()}}
        for each in balance.places
    ]

    def changing(inputs: Mapping[str, ca.SX], i: int) -> dict[str, ca.SX]:
        return {group: column for group, column in inputs.items() if balance.places[i][group].name in names}

    kinds = [list(balance.kinds).index(kind) for kind in range(len(balance.parts))]
    of_parts = [changing(part.inputs, i) for part, i in zip(balance.parts, kinds, strict=True)]
    common = changing(balance.common, -1)
    outward = [(balance.first.get(OUTWARD), common)]
    outward += [(part.after.get(OUTWARD), inputs) for part, inputs in zip(balance.parts, of_parts, strict=True)]
    turns = [turn for turn in balance.first if turn == INWARD or any(_depends(*each) for each in outward)]
    handed, ends = (
        {turn: ca.SX.sym(f"{name}_{turn}", balance.first[turn].numel()) for turn in turns}
        for name in ("d_before", "d_last")
    )

    def along(
        column: ca.SX, inputs: Mapping[str, ca.SX], carried: Mapping[int, ca.SX], changes: Mapping[int, ca.SX]
    ) -> ca.SX:
        at = ca.vertcat(*inputs.values(), *(carried[turn] for turn in turns))
        return ca.jtimes(column, at, ca.vertcat(*rates_of(inputs).values(), *changes.values()))

    parts: list[ChainPart] = []
    for part, inputs in zip(balance.parts, of_parts, strict=True):
        results = {group: along(column, inputs, part.before, handed) for group, column in part.results.items()}
        after = dict(part.after) | {
            turn: ca.vertcat(part.after[turn], along(part.after[turn], inputs, part.before, handed)) for turn in turns
        }
        before = dict(part.before) | {turn: ca.vertcat(part.before[turn], handed[turn]) for turn in turns}
        parts.append(ChainPart({**part.inputs, **rates_of(inputs)}, results, before, after))
    first = dict(balance.first) | {
        turn: ca.vertcat(balance.first[turn], along(balance.first[turn], common, balance.last, ends)) for turn in turns
    }
    last = dict(balance.last) | {turn: ca.vertcat(balance.last[turn], ends[turn]) for turn in turns}
    return balance._replace(
        parts=parts, places=places, first=first, last=last, common={**balance.common, **rates_of(common)}
    )


@cache
def _rate(group: str, size: int) -> ca.SX:
    return ca.SX.sym(f"rate_{group}", size)


def rates_of(inputs: Mapping[str, ca.SX]) -> dict[str, ca.SX]:
    """Return the symbols of the rates of inputs."""
    return {f"rate_{group}": _rate(group, column.numel()) for group, column in inputs.items()}


def _depends(column: ca.SX | None, inputs: Mapping[str, ca.SX]) -> bool:
    return column is not None and ca.depends_on(column, column_of(inputs.values()))


class _LinearPart:
    """The linearised balance of one kind of part."""

    def __init__(self, part: ChainPart, states: Sequence[str]) -> None:
        self._part = part
        self._X = ca.vertcat(*(part.inputs.get(f"x_{name}", ca.SX.sym(name)) for name in states))
        self._Y = ca.vertcat(*(part.inputs.get(f"x_dot_{name}", ca.SX.sym(name)) for name in states))
        self._rows = ca.vertcat(*(part.results[f"made_{name}"] for name in states))
        if not self._X.numel() == self._Y.numel() == self._rows.numel() == len(states):
            raise ChainError("each part of a chain must have each state exactly once")
        empty = ca.SX(0, 1)
        self._handed = [part.before.get(turn, empty) for turn in (OUTWARD, INWARD)]
        self._hands = [part.after.get(turn, empty) for turn in (OUTWARD, INWARD)]
        self._moved = ca.SX.sym("moved", self._hands[0].numel())
        """Symbols, in the part's rows and in the values that it passes inward, of the values that it passes outward."""
        self._rows, self._inward = self._by_moved(list(states))
        R_y = ca.sparsify(ca.jacobian(self._rows, self._Y))
        beyond = [ca.jacobian(self._rows, handed) for handed in (*self._handed, self._moved)]
        through = [ca.jacobian(handed, self._Y) for handed in (self._hands[0], self._inward)]
        self.explicit = [
            k
            for k in range(len(states))
            if R_y[k, :].nnz() == 1 and R_y[k, k].is_minus_one() and not any(each[k, :].nnz() for each in beyond)
        ]
        self.carried = [
            k
            for k in range(len(states))
            if R_y[:, k].nnz() != 1 or k not in self.explicit or any(each[:, k].nnz() for each in through)
        ]

    def _by_moved(self, states: Sequence[str]) -> tuple[ca.SX, ca.SX]:
        """Return the rows and the values that the part passes inward, in terms of those that it passes outward."""
        inputs = [*self._part.inputs.values(), *self._handed]
        operations = Operations(ca.Function("part", inputs, [self._rows, *self._hands]))
        rows, outward, inward = operations.results
        values = operations.values(inputs, lambda k, _: self._moved[outward.index(k)] if k in outward else None)
        return column_of(values[k] for k in rows), column_of(values[k] for k in inward)

    def functions(
        self, kind: int, carried: Sequence[int], explicit: Sequence[int], order: np.ndarray
    ) -> _PartFunctions:
        """Return the functions of the elimination."""
        h = ca.SX.sym("h")
        a, b = self._handed
        (A_a, A_x, A_y), (B_a, B_x, B_y), (R_a, R_x, R_y) = (
            [ca.jacobian(each, by) for by in (a, self._X, self._Y)]
            for each in (self._hands[0], self._inward, self._rows)
        )
        (B_b, B_m), (R_b, R_m) = (
            [ca.jacobian(each, by) for by in (b, self._moved)] for each in (self._inward, self._rows)
        )
        per_step = 1.0 / (h * GAMMA)
        A_x, B_x, R_x = A_x + A_y * per_step, B_x + B_y * per_step, R_x + R_y * per_step
        S_column = ca.SX.sym("S", b.numel() * a.numel())
        S = ca.reshape(S_column, b.numel(), a.numel())
        B_m, R_m = B_m + B_b @ S, R_m + R_b @ S
        m = len(order)
        diagonal = ca.SX(m, m)
        for k in explicit:
            diagonal[k, k] = 1.0
        K = -(R_x + R_m @ A_x)
        L = ca.sparsify(R_a + R_m @ A_a)
        Q = (R_y + diagonal)[:, carried] + R_m @ A_y[:, carried]
        P, W = B_x + B_m @ A_x, B_y[:, carried] + B_m @ A_y[:, carried]
        LU = factorize(permuted(ca.sparsify(K), order))
        moving = sorted(set(L.sparsity().row()))
        answers = ca.SX(m, 0)
        for k in moving:
            unit = ca.SX(m, 1)
            unit[k] = 1.0
            answers = ca.horzcat(answers, _solved(LU, unit, order))
        S_new = B_a + B_m @ A_a + (P @ answers) @ L[moving, :]
        places = [(i, j) for i, row in enumerate(LU) for j in sorted(row)]
        parts = [
            to_sx([LU[i][j] for i, j in places]),
            answers,
            L[moving, :],
            Q,
            P,
            W,
            R_b,
            B_b,
            A_a,
            A_x,
            A_y[:, carried],
        ]
        parts = ca.substitute([*parts, S_new], [self._moved], [self._hands[0]])
        *parts, S_new = ca.cse([*map(ca.sparsify, parts[:-1]), ca.densify(ca.vec(parts[-1]))])
        factors, symbols, kept = varying(parts)
        inputs = dict(self._part.inputs)
        inputs |= {"before_0": a, "before_1": b, "S": S_column, "h": h}
        made = {"factors": factors} | ({"S_new": S_new} if S_new.numel() else {})
        read = read_of(inputs, made.values())
        eliminate = ca.Function(
            f"{LOCAL}eliminate_{kind}",
            list(read.values()),
            ca.cse(list(map(ca.densify, made.values()))),
            list(read),
            list(made),
        )
        return _PartFunctions(eliminate, kind, symbols, kept, places, order)


class _PartFunctions:
    """The functions of one kind of part: `eliminate`, and `inward` and `outward` for a stage."""

    def __init__(
        self,
        eliminate: ca.Function,
        kind: int,
        factors: ca.SX,
        kept: Sequence[ca.SX],
        places: Sequence[tuple[int, int]],
        order: np.ndarray,
    ) -> None:
        self.eliminate = eliminate
        elements, answers, L, Q, P, W, R_b, B_b, A_a, A_x, A_y = kept
        m = len(order)
        LU = sparse(m, [(i, j, Symbol(x)) for (i, j), x in zip(places, ca.densify(elements).nonzeros(), strict=True)])
        right, along = ([ca.SX.sym(f"{name}_{k}") for k in range(m)] for name in ("right", "along"))
        slope = [ca.SX.sym(f"slope_{k}") for k in range(Q.shape[1])]
        s, delay, alone = ca.SX.sym("s", R_b.shape[1]), ca.SX.sym("delay"), ca.SX.sym("alone", m)
        slopes = column_of(slope)
        moved = ca.SX.sym("moved", A_a.shape[1])
        inputs: dict[str, ca.SX] = {"factors": factors, "s": s, "delay": delay, "alone": alone, "moved": moved}
        inputs |= {x.name(): x for x in (*right, *along, *slope)}
        u = _solved(LU, ca.vertcat(*right) + delay * ca.vertcat(*along) + R_b @ s - Q @ slopes, order)
        self.inward = _named(f"inward_{kind}", inputs, {"u": u, "s_new": P @ u + B_b @ s - W @ slopes})
        u = alone + answers @ (L @ moved)
        made = {f"u_{k}": u[k] for k in range(m)} | {"moved_new": A_a @ moved + A_x @ u - A_y @ slopes}
        self.outward = _named(f"outward_{kind}", inputs, made)


def _named(name: str, inputs: Mapping[str, ca.SX], results: Mapping[str, ca.SX]) -> ca.Function:
    made = {key: column for key, column in results.items() if column.numel()}
    columns = ca.cse(list(map(ca.densify, made.values())))
    read = read_of(inputs, columns)
    return ca.Function(f"{LOCAL}{name}", list(read.values()), columns, list(read), list(made))


def _solved(LU: Any, right: ca.SX, order: np.ndarray) -> ca.SX:
    u = np.empty(len(order), dtype=object)
    u[order] = solve_factorized(LU, from_sx(ca.densify(right))[order])
    return to_sx(u)
