"""Chains of parts, such as the joints of an arm, whose passes are built from traces of the kinds of parts.

The trace of a part has symbols for the values that the parts pass on (:mod:`vdfmu.compiler.scalar.passes`). Duplicates
and constants among them are removed. Passes in the same direction are merged where possible. :mod:`.chain_calls` writes
the calls.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from typing import Any, NamedTuple

import casadi as ca

from vdfmu.compiler.scalar.passes import HandedOn

LOCAL = "chain_"
"""Prefix in the names of functions that a chain's function calls; in C the function's name replaces it."""
_MOST_TURNS = 12
"""Largest number of passes of a function, because a pass that depends on itself would need infinitely many."""


class Place(NamedTuple):
    """Place, in an argument or a result of the whole chain, of the elements of one part's group."""

    name: str
    begin: int


class PartTrace(NamedTuple):
    """The trace of a part. Groups of elements are adjacent in an argument or a result of the chain."""

    inputs: Mapping[str, ca.SX]
    results: Mapping[str, ca.SX]
    shared: Mapping[str, ca.SX]
    """Results of the whole chain, as functions of the final values of its passes."""
    passes: Sequence[HandedOn]


class ChainPart(NamedTuple):
    """A part whose passes are numbered by turn, outward passes even, inward passes odd."""

    inputs: Mapping[str, ca.SX]
    results: Mapping[str, ca.SX]
    before: Mapping[int, ca.SX]
    after: Mapping[int, ca.SX]


class PartChain(NamedTuple):
    """A function of a chain before its calls are written; see :func:`.chain_calls.chain_function`."""

    name: str
    parts: Sequence[ChainPart]
    """Each kind of part once."""
    kinds: Sequence[int]
    """Kind of each part, from the base."""
    places: Sequence[Mapping[str, Place]]
    """Places of the groups of each part."""
    arguments: Mapping[str, int]
    """Sizes of the arguments of the chain."""
    outputs: Mapping[str, int]
    """Sizes of its results."""
    first: Mapping[int, ca.SX]
    """Initial values of each pass, as functions of shared inputs and of `last`."""
    last: Mapping[int, ca.SX]
    """Symbols of the final values of each pass."""
    shared: Mapping[str, ca.SX]
    common: Mapping[str, ca.SX]
    """Inputs of `first` and `shared` by their groups."""


class _Leaf(NamedTuple):
    """A value that is passed on, given by its pass and element."""

    number: int
    element: int


class ChainError(Exception):
    """The traces of the parts do not determine how the chain is calculated."""


def chain_of(
    name: str,
    traces: Sequence[PartTrace],
    kinds: Sequence[int],
    places: Sequence[Mapping[str, Place]],
    arguments: Mapping[str, int],
    outputs: Mapping[str, int],
) -> PartChain:
    """Return the chain of traces of its kinds of parts. ChainError if they do not fit together."""
    forms = [[(each.inward, each.first.numel()) for each in trace.passes] for trace in traces]
    if any(form != forms[0] for form in forms):
        raise ChainError("the parts pass on different values")
    merged = _Merged(traces, kinds)
    turns = merged.turns()
    by_turn: dict[int, list[_Leaf]] = {} if turns else {0: []}
    for leaf, turn in turns.items():
        by_turn.setdefault(turn, []).append(leaf)
    ends = traces[kinds[0]], traces[kinds[-1]]
    parts = [
        ChainPart(
            trace.inputs,
            dict(zip(trace.results, merged.substituted(trace, [*trace.results.values()]), strict=True)),
            {turn: column_of(trace.passes[p].before[e] for p, e in leaves) for turn, leaves in by_turn.items()},
            {
                turn: column_of(merged.substituted(trace, [trace.passes[p].after[e] for p, e in leaves]))
                for turn, leaves in by_turn.items()
            },
        )
        for trace in traces
    ]
    # the first and the last part have separate symbols: those of the last part replace those of the first
    outer = ends[1]
    varying = {group for group in outer.inputs if len({each.get(group) for each in places}) > 1}
    common = {group: symbols for group, symbols in outer.inputs.items() if group not in varying}
    same = [(ends[0].inputs[group], symbols) for group, symbols in common.items()]
    same += [(a.last, b.last) for a, b in zip(ends[0].passes, outer.passes, strict=True)]

    def begun(turn: int) -> ca.SX:
        column = column_of(ends[turn % 2].passes[p].first[e] for p, e in by_turn[turn])
        if same and turn % 2 == 0:
            (column,) = ca.substitute([column], [a for a, _ in same], [b for _, b in same])
        return merged.substituted(outer, [column])[0]

    first = {turn: begun(turn) for turn in by_turn}
    last = {turn: column_of(outer.passes[p].last[e] for p, e in leaves) for turn, leaves in by_turn.items()}
    shared = dict(zip(outer.shared, merged.substituted(outer, [*outer.shared.values()]), strict=True))
    used = symbols_of(column_of([*first.values(), *shared.values()]))
    allowed = elements_of([*common.values(), *last.values()])
    if not used <= allowed:
        raise ChainError("the initial values of a pass depend on a part")
    return PartChain(name, parts, kinds, places, arguments, outputs, first, last, shared, common)


def column_of(parts: Iterable[ca.SX]) -> ca.SX:
    """Return columns or elements as one column, which may be empty."""
    return ca.vertcat(ca.SX(0, 1), *map(ca.vec, parts))


def symbols_of(column: ca.SX) -> set[int]:
    """Return keys of the symbols in an expression."""
    return {x.element_hash() for x in ca.symvar(column)}


def elements_of(columns: Iterable[Any]) -> set[int]:
    """Return keys of the elements of columns of symbols."""
    return {x.element_hash() for column in columns for x in column.nonzeros()}


class _Merged:
    """The passed-on values that are equal or constant."""

    def __init__(self, traces: Sequence[PartTrace], kinds: Sequence[int]) -> None:
        self._traces = traces
        self._ends = traces[kinds[0]], traces[kinds[-1]]
        passes = traces[0].passes
        self._leaves = [_Leaf(p, e) for p, each in enumerate(passes) for e in range(each.first.numel())]
        self._inward = [each.inward for each in passes]
        keys: dict[_Leaf, Any] = {}
        for end in range(2):
            leaves = [leaf for leaf in self._leaves if self._inward[leaf.number] == bool(end)]
            firsts = [self._ends[end].passes[p].first[e] for p, e in leaves]
            for leaf, key in zip(leaves, _keys(firsts), strict=True):
                keys[leaf] = (end, key)
        self._representative: dict[_Leaf, _Leaf | float] = {}
        while True:
            self._represent(keys)
            finer = self._refined(keys)
            if len(set(finer.values())) == len(set(keys.values())) and self._constants(finer) == self._constants(keys):
                break
            keys = finer

    def _constants(self, keys: Mapping[_Leaf, Any]) -> set[_Leaf]:
        return {leaf for leaf, key in keys.items() if isinstance(key[1], float)}

    def _represent(self, keys: Mapping[_Leaf, Any]) -> None:
        first: dict[Any, _Leaf] = {}
        for leaf in self._leaves:
            key = keys[leaf]
            self._representative[leaf] = key[1] if isinstance(key[1], float) else first.setdefault(key, leaf)

    def _refined(self, keys: Mapping[_Leaf, Any]) -> dict[_Leaf, Any]:
        """Return keys that also distinguish the values that the parts pass on."""
        columns = [
            _keys(self.substituted(trace, [trace.passes[p].after[e] for p, e in self._leaves]))
            for trace in self._traces
        ]
        finer: dict[_Leaf, Any] = {}
        for k, leaf in enumerate(self._leaves):
            key, after = keys[leaf], tuple(column[k] for column in columns)
            is_constant = isinstance(key[1], float) and all(each == key[1] for each in after)
            finer[leaf] = key if is_constant else (key[0], (key[1], after))
        return finer

    def substituted(self, trace: PartTrace, expressions: list[ca.SX]) -> list[ca.SX]:
        """Return expressions in which equal passed-on values share one symbol."""
        old: list[ca.SX] = []
        new: list[ca.SX] = []
        for leaf, same in self._representative.items():
            if same != leaf:
                for columns in ([each.before for each in trace.passes], [each.last for each in trace.passes]):
                    old.append(columns[leaf.number][leaf.element])
                    new.append(columns[same.number][same.element] if isinstance(same, _Leaf) else ca.SX(same))
        return ca.substitute(expressions, old, new) if old else expressions

    def turns(self) -> dict[_Leaf, int]:
        """Return the turn of each passed-on value's pass: the first at which its inputs exist."""
        leaves = [leaf for leaf in self._leaves if self._representative[leaf] == leaf]
        if not leaves:
            return {}
        turns = {leaf: int(self._inward[leaf.number]) for leaf in leaves}
        needs = [_needs(self, trace, leaves) for trace in self._traces]
        for _ in range(_MOST_TURNS):
            later = dict(turns)
            for need in needs:
                for leaf in leaves:
                    for other, plus in need[leaf]:
                        later[leaf] = max(later[leaf], turns[other] + plus)
            for leaf in leaves:
                later[leaf] += (later[leaf] - int(self._inward[leaf.number])) % 2
            if later == turns:
                return turns
            turns = later
        raise ChainError("a pass depends on itself")


def _needs(merged: _Merged, trace: PartTrace, leaves: Sequence[_Leaf]) -> dict[_Leaf, list[tuple[_Leaf, int]]]:
    """Return the values on which each value depends, with 1 if their pass must have ended before, else 0."""
    before = ca.vertcat(*(trace.passes[p].before[e] for p, e in leaves))
    last = ca.vertcat(*(trace.passes[p].last[e] for p, e in leaves))
    results = merged.substituted(
        trace, [trace.passes[p].after[e] for p, e in leaves] + [trace.passes[p].first[e] for p, e in leaves]
    )
    needs: dict[_Leaf, list[tuple[_Leaf, int]]] = {leaf: [] for leaf in leaves}
    symbols = ca.symvar(ca.vertcat(*results, before, last))
    listed = elements_of([before, last])
    rest = ca.vertcat(*(x for x in symbols if x.element_hash() not in listed))
    function = ca.Function("needs", [before, last, rest], [ca.vertcat(*results)])
    for plus in (0, 1):
        rows, columns = function.jac_sparsity(0, plus).get_triplet()
        for row, column in zip(rows, columns, strict=True):
            needs[leaves[row % len(leaves)]].append((leaves[column], plus))
    return needs


def _keys(expressions: list[ca.SX]) -> list[Any]:
    """Return a key for each expression, the same for equal ones; the key of a constant is its value."""
    shared = ca.cse(expressions) if expressions else []
    return [float(x) if x.is_constant() else x.element_hash() for x in (ca.densify(x) for x in shared)]
