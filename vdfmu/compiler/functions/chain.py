"""Functions of a chain of parts, such as the joints of an arm: each pass calls a function of one part, part by part.

The trace of a part has symbols for what the parts hand on (:mod:`vdfmu.compiler.scalar.passes`). Numbers that are
handed on twice, and constants, drop out. Passes in the same direction become one pass as far as they can. What a pass
calculates and a later pass needs is stored by the part.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import casadi as ca

from vdfmu.compiler.functions.operations import Operations
from vdfmu.compiler.scalar.passes import HandedOn

LOCAL = "chain_"
"""Prefix of the names of functions that the function of a chain calls; in C its own name replaces it."""
BY_DIRECTIONS = {"jac_penalty": -1.0}
"""Option of a function whose derivatives go along directions: CasADi would take small Jacobians, with their zeros."""
_MOST_TURNS = 12
"""Most passes of a function. A pass that waits for itself has no number of passes."""


class Place(NamedTuple):
    """Place of the elements of a group of one part in an argument or a result of the whole chain."""

    name: str
    begin: int


@dataclass(frozen=True)
class PartTrace:
    """The trace of a part. Groups of elements lie side by side in an argument or a result of the chain."""

    inputs: Mapping[str, ca.SX]
    results: Mapping[str, ca.SX]
    shared: Mapping[str, ca.SX]
    """Results of the whole chain, in terms of what its passes end with."""
    passes: Sequence[HandedOn]


@dataclass(frozen=True)
class ChainPart:
    """A part whose passes are numbered by their turn, outward passes even, inward passes odd."""

    inputs: Mapping[str, ca.SX]
    results: Mapping[str, ca.SX]
    before: Mapping[int, ca.SX]
    after: Mapping[int, ca.SX]


@dataclass(frozen=True)
class PartChain:
    """A function of a chain before its calls are written."""

    name: str
    parts: Sequence[ChainPart]
    """Each kind of part once."""
    kinds: Sequence[int]
    """Kind of each part, the first at the base."""
    places: Sequence[Mapping[str, Place]]
    """Places of the groups of each part."""
    arguments: Mapping[str, int]
    """Sizes of the arguments of the chain."""
    outputs: Mapping[str, int]
    """Sizes of its results."""
    first: Mapping[int, ca.SX]
    """What each pass begins with, in terms of shared inputs and of `last`."""
    last: Mapping[int, ca.SX]
    """Symbols of what each pass ends with."""
    shared: Mapping[str, ca.SX]
    common: Mapping[str, ca.SX]
    """Inputs of `first` and `shared` by their groups."""

    def function(self) -> ca.Function:
        """Return the function of the chain."""
        arguments = {name: ca.MX.sym(name, size) for name, size in self.arguments.items()}
        results = ChainCalls(self, arguments).results()
        return ca.Function(self.name, list(arguments.values()), results, list(arguments), list(self.outputs))


class _Leaf(NamedTuple):
    """A number that is handed on: pass and element."""

    number: int
    element: int


class ChainError(Exception):
    """The trace of a part does not say how the chain calculates."""


def chain_of(
    name: str, traces: Sequence[PartTrace], kinds: Sequence[int], places: Sequence[Mapping[str, Place]],
    arguments: Mapping[str, int], outputs: Mapping[str, int],
) -> PartChain:  # fmt: skip
    """Return the chain of traces of its kinds of parts. ChainError if they do not fit together."""
    forms = [[(each.inward, each.first.numel()) for each in trace.passes] for trace in traces]
    if any(form != forms[0] for form in forms):
        raise ChainError("the parts hand on different things")
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
            {turn: _column(trace.passes[p].before[e] for p, e in leaves) for turn, leaves in by_turn.items()},
            {
                turn: _column(merged.substituted(trace, [trace.passes[p].after[e] for p, e in leaves]))
                for turn, leaves in by_turn.items()
            },
        )
        for trace in traces
    ]
    # both ends of the chain have inputs and passes of their own: those of the last part replace those of the first
    outer = ends[1]
    varying = {group for group in outer.inputs if len({each.get(group) for each in places}) > 1}
    common = {group: symbols for group, symbols in outer.inputs.items() if group not in varying}
    same = [(ends[0].inputs[group], symbols) for group, symbols in common.items()]
    same += [(a.last, b.last) for a, b in zip(ends[0].passes, outer.passes, strict=True)]

    def begun(leaf: _Leaf) -> ca.SX:
        handed = outer.passes[leaf.number] if outer.passes[leaf.number].inward else ends[0].passes[leaf.number]
        expression = handed.first[leaf.element]
        if not handed.inward:
            (expression,) = ca.substitute([expression], [a for a, _ in same], [b for _, b in same])
        return merged.substituted(outer, [expression])[0]

    first = {turn: _column(map(begun, leaves)) for turn, leaves in by_turn.items()}
    last = {turn: _column(outer.passes[p].last[e] for p, e in leaves) for turn, leaves in by_turn.items()}
    shared = dict(zip(outer.shared, merged.substituted(outer, [*outer.shared.values()]), strict=True))
    used = _symbols_of(_joined([*first.values(), *shared.values()]))
    allowed = _elements_of([*common.values(), *last.values()])
    if not used <= allowed:
        raise ChainError("what a pass begins with depends on a part")
    return PartChain(name, parts, kinds, places, arguments, outputs, first, last, shared, common)


def _joined(columns: Iterable[ca.SX]) -> ca.SX:
    """Return columns as one; an empty column has its type too."""
    return ca.vertcat(ca.SX(0, 1), *map(ca.vec, columns))


def _symbols_of(column: ca.SX) -> set[int]:
    """Return keys of the symbols that an expression has."""
    return {x.element_hash() for x in ca.symvar(column)}


def _elements_of(columns: Iterable[Any]) -> set[int]:
    """Return keys of the elements of columns of symbols."""
    return {x.element_hash() for column in columns for x in column.nonzeros()}


def _column(elements: Iterable[Any]) -> ca.SX:
    return ca.vertcat(ca.SX(0, 1), *elements)


class _Merged:
    """Which numbers that are handed on are the same, or constant."""

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
        """Return keys that also tell apart what the parts hand on."""
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
        """Return expressions with one symbol for numbers that are the same."""
        old: list[ca.SX] = []
        new: list[ca.SX] = []
        for leaf, same in self._representative.items():
            if same != leaf:
                for columns in ([each.before for each in trace.passes], [each.last for each in trace.passes]):
                    old.append(columns[leaf.number][leaf.element])
                    new.append(columns[same.number][same.element] if isinstance(same, _Leaf) else ca.SX(same))
        return ca.substitute(expressions, old, new) if old else expressions

    def turns(self) -> dict[_Leaf, int]:
        """Return the turn of the pass of each number that is handed on: the first with all it depends on."""
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
        raise ChainError("a pass waits for itself")


def _needs(merged: _Merged, trace: PartTrace, leaves: Sequence[_Leaf]) -> dict[_Leaf, list[tuple[_Leaf, int]]]:
    """Return for each number the numbers that it depends on, with 1 if these passes must have ended."""
    before = ca.vertcat(*(trace.passes[p].before[e] for p, e in leaves))
    last = ca.vertcat(*(trace.passes[p].last[e] for p, e in leaves))
    results = merged.substituted(
        trace, [trace.passes[p].after[e] for p, e in leaves] + [trace.passes[p].first[e] for p, e in leaves]
    )
    needs: dict[_Leaf, list[tuple[_Leaf, int]]] = {leaf: [] for leaf in leaves}
    symbols = ca.symvar(ca.vertcat(*results, before, last))
    listed = _elements_of([before, last])
    rest = ca.vertcat(*(x for x in symbols if x.element_hash() not in listed))
    function = ca.Function("needs", [before, last, rest], [ca.vertcat(*results)])
    for plus in (0, 1):
        rows, columns = function.jac_sparsity(0, plus).get_triplet()
        for row, column in zip(rows, columns, strict=True):
            needs[leaves[row % len(leaves)]].append((leaves[column], plus))
    return needs


def _keys(expressions: list[ca.SX]) -> list[Any]:
    """Return a key for each expression, the same for equal ones; a constant is its value."""
    shared = ca.cse(expressions) if expressions else []
    return [float(x) if x.is_constant() else x.element_hash() for x in (ca.densify(x) for x in shared)]


class _Split:
    """The passes of one kind of part: which operations each calculates, and what it stores for later passes."""

    def __init__(self, part: ChainPart, turns: Sequence[int]) -> None:
        self.part, self._turns = part, turns
        self.inputs = [*part.inputs, *(f"before_{turn}" for turn in turns)]
        self._columns = [*part.inputs.values(), *(part.before[turn] for turn in turns)]
        after = [part.after[turn] for turn in turns]
        function = ca.Function("part", self._columns, [*part.results.values(), *after])
        self.operations = Operations(function)
        self._set_turns()

    def _set_turns(self) -> None:
        """Choose the turn of each operation: the first with its operands; without what is handed on, the first user."""
        listed, results = self.operations.listed, self.operations.results
        groups = len(self.part.inputs)
        self.at = [self._turns[0]] * len(listed)
        is_local = [True] * len(listed)
        for k, operation in enumerate(listed):
            if isinstance(operation.leaf, tuple) and operation.leaf[0] >= groups:
                self.at[k], is_local[k] = self._turns[operation.leaf[0] - groups], False
            elif operation.reads:
                self.at[k] = max(self.at[i] for i in operation.reads)
                is_local[k] = all(is_local[i] for i in operation.reads)
        used: dict[int, set[int]] = defaultdict(set)
        self.made: dict[str, int] = {}
        """Result to the turn of the pass that calculates it."""
        for name, elements in zip(self.part.results, results, strict=False):
            self.made[name] = max(self.at[k] for k in elements)
            for k in elements:
                used[k].add(self.made[name])
        for turn, elements in zip(self._turns, results[len(self.part.results) :], strict=True):
            for k in elements:
                used[k].add(turn)
        for k in reversed(range(len(listed))):
            if is_local[k]:
                self.at[k] = min(used[k], default=self.at[k])
            for i in listed[k].reads:
                used[i].add(self.at[k])
        self.stored: dict[int, list[int]] = {turn: [] for turn in self._turns}
        """Turn to the operations whose values later passes read."""
        for k, operation in enumerate(listed):
            if operation.leaf is None and any(turn > self.at[k] for turn in used[k]):
                self.stored[self.at[k]].append(k)

    def pass_function(self, turn: int, name: str) -> ca.Function:
        """Return the function of a pass, with inputs and results named as `inputs`, ``stored_<turn>``, ``after``."""
        listed = self.operations.listed
        stored = {t: ca.SX.sym(f"stored_{t}", len(self.stored[t])) for t in self._turns if t < turn}
        values: dict[int, Any] = {}
        for t, symbols in stored.items():
            values |= dict(zip(self.stored[t], symbols.elements(), strict=True))
        wanted = [name for name, at in self.made.items() if at == turn]
        results = {name: self._elements(list(self.part.results).index(name)) for name in wanted}
        results["after"] = self._elements(len(self.part.results) + self._turns.index(turn))
        results["stored"] = self.stored[turn]
        needed: set[int] = set()
        waiting = [k for elements in results.values() for k in elements]
        while waiting:
            k = waiting.pop()
            if k not in needed and k not in values:
                needed.add(k)
                waiting += listed[k].reads
        for k in sorted(needed):
            leaf = listed[k].leaf
            if isinstance(leaf, tuple):
                values[k] = self._columns[leaf[0]][leaf[1]]
            else:
                values[k] = self.operations.value(k, [values[i] for i in listed[k].reads])
        columns = {name: _column(values[k] for k in elements) for name, elements in results.items() if elements}
        inputs = dict(zip(self.inputs, self._columns, strict=True))
        inputs |= {f"stored_{t}": symbols for t, symbols in stored.items()}
        read = read_of(inputs, columns.values())
        made = [ca.densify(column) for column in columns.values()]
        return ca.Function(name, list(read.values()), made, list(read), list(columns), BY_DIRECTIONS)

    def _elements(self, result: int) -> list[int]:
        return self.operations.results[result]


class ChainCalls:
    """The calls of a chain, for some arguments.

    `values` has what each part has calculated: results by group, ``before_<turn>`` and ``stored_<turn>``; `last` what
    each pass ends with.
    """

    def __init__(self, chain: PartChain, arguments: Mapping[str, ca.MX]) -> None:
        self._chain, self._arguments, self._turns = chain, arguments, sorted(chain.first)
        splits = [_Split(part, self._turns) for part in chain.parts]
        self._functions: dict[tuple[int, int], ca.Function] = {}
        """Turn and kind to the function of a pass."""
        for turn in self._turns:
            texts: dict[str, ca.Function] = {}
            for kind, split in enumerate(splits):
                text = split.pass_function(turn, "pass").serialize()
                if text not in texts:
                    texts[text] = split.pass_function(turn, f"{LOCAL}pass_{turn}_{len(texts)}")
                self._functions[turn, kind] = texts[text]
        self.values: list[dict[str, ca.MX]] = [{} for _ in chain.kinds]
        self.last: dict[int, ca.MX] = {}
        for turn in self._turns:
            self._pass(turn)

    def results(self) -> list[ca.MX]:
        """Return the results of the chain."""
        chain = self._chain
        whole: dict[str, dict[int, ca.MX]] = defaultdict(dict)
        for places, values in zip(chain.places, self.values, strict=True):
            for group, value in values.items():
                if group in places:
                    whole[places[group].name][places[group].begin] = value
        shared = self.of_ends("shared", chain.shared)
        return [
            shared[name] if name in shared else ca.vertcat(*(value for _, value in sorted(whole[name].items())))
            for name in chain.outputs
        ]

    def of_ends(self, name: str, results: Mapping[Any, ca.SX]) -> dict[Any, ca.MX]:
        """Return what follows from shared inputs and from the ends of earlier passes, by a function of that name."""
        chain = self._chain
        columns = {key: ca.densify(ca.vec(value)) for key, value in results.items()}
        ends = {f"last_{turn}": symbols for turn, symbols in chain.last.items() if turn in self.last}
        read = read_of({**chain.common, **ends}, columns.values())
        if not read:
            return {key: ca.MX(ca.DM(ca.evalf(column))) for key, column in columns.items()}
        names = [f"result_{k}" for k in range(len(columns))]
        made = ca.cse([*columns.values()])
        function = ca.Function(f"{LOCAL}{name}", list(read.values()), made, list(read), names, BY_DIRECTIONS)
        arguments: list[ca.MX] = []
        for group, column in read.items():
            if group in ends:
                arguments.append(self.last[int(group.removeprefix("last_"))])
            else:
                arguments.append(self.argument(chain.places[-1][group], column.numel()))
        return dict(zip(columns, function.call(arguments), strict=True))

    def argument(self, place: Place, size: int) -> ca.MX:
        """Return a part of an argument of the chain."""
        column = self._arguments[place.name]
        return column if size == column.numel() else column[place.begin : place.begin + size]

    def call(self, function: ca.Function, part: int, **more: ca.MX) -> dict[str, ca.MX]:
        """Return the results of a function of a part: of its groups, of what it has calculated, and of `more`."""
        values, places = {**self.values[part], **more}, self._chain.places[part]
        arguments = [
            values[name] if name in values else self.argument(places[name], function.numel_in(k))
            for k, name in enumerate(function.name_in())
        ]
        return dict(zip(function.name_out(), function.call(arguments), strict=True))

    def _pass(self, turn: int) -> None:
        chain = self._chain
        n = len(chain.kinds)
        begins = {"first": chain.first[turn]} if chain.first[turn].numel() else {}
        carry = self.of_ends(f"first_{turn}", begins).get("first", ca.MX(0, 1))
        for i in reversed(range(n)) if turn % 2 else range(n):
            self.values[i][f"before_{turn}"] = carry
            made = self.call(self._functions[turn, chain.kinds[i]], i)
            carry = made.pop("after", carry)
            if "stored" in made:
                self.values[i][f"stored_{turn}"] = made.pop("stored")
            self.values[i] |= made
        self.last[turn] = carry


def read_of(inputs: Mapping[str, ca.SX], results: Iterable[ca.SX]) -> dict[str, ca.SX]:
    """Return the inputs that results depend on."""
    free = _symbols_of(_joined(results))
    return {name: column for name, column in inputs.items() if not free.isdisjoint(_elements_of([column]))}
