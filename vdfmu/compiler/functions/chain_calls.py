"""Functions of a chain of parts: each pass calls a function of one part, part by part.

Each part stores the results of a pass that a later pass needs.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterable, Mapping, Sequence
from typing import Any

import casadi as ca

from vdfmu.compiler.functions.chain import LOCAL, ChainPart, PartChain, Place, column_of, elements_of, symbols_of
from vdfmu.compiler.functions.operations import Operations

BY_DIRECTIONS = {"jac_penalty": -1.0}
"""Option for derivatives along directions, because CasADi would use small Jacobians with their zeros."""


def chain_function(chain: PartChain) -> ca.Function:
    """Return the function of a chain."""
    arguments = {name: ca.MX.sym(name, size) for name, size in chain.arguments.items()}
    results = ChainCalls(chain, arguments).results()
    return ca.Function(chain.name, list(arguments.values()), results, list(arguments), list(chain.outputs))


def called(function: ca.Function, arguments: Mapping[str, ca.MX]) -> dict[str, ca.MX]:
    """Return the results of a function for arguments by name; additional ones are ignored."""
    made = function.call([arguments[name] for name in function.name_in()])
    return dict(zip(function.name_out(), made, strict=True))


class _Split:
    """The passes of one kind of part: the operations that each calculates, and what it stores for later passes."""

    def __init__(self, part: ChainPart, turns: Sequence[int]) -> None:
        self.part, self._turns = part, turns
        self.inputs = [*part.inputs, *(f"before_{turn}" for turn in turns)]
        self._columns = [*part.inputs.values(), *(part.before[turn] for turn in turns)]
        after = [part.after[turn] for turn in turns]
        function = ca.Function("part", self._columns, [*part.results.values(), *after])
        self.operations = Operations(function)
        self._set_turns()

    def _set_turns(self) -> None:
        """Choose the turn of each operation: the first at which its operands exist, or the turn of its first user."""
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
        stored = {t: ca.SX.sym(f"stored_{t}", len(self.stored[t])) for t in self._turns if t < turn}
        kept: dict[int, Any] = {}
        for t, symbols in stored.items():
            kept |= dict(zip(self.stored[t], symbols.elements(), strict=True))
        results = {name: self._elements(k) for k, (name, at) in enumerate(self.made.items()) if at == turn}
        results["after"] = self._elements(len(self.part.results) + self._turns.index(turn))
        results["stored"] = self.stored[turn]
        values = self.operations.values(self._columns, lambda k, _: kept.get(k))
        columns = {name: column_of(values[k] for k in elements) for name, elements in results.items() if elements}
        inputs = dict(zip(self.inputs, self._columns, strict=True))
        inputs |= {f"stored_{t}": symbols for t, symbols in stored.items()}
        read = read_of(inputs, columns.values())
        made = [ca.densify(column) for column in columns.values()]
        return ca.Function(name, list(read.values()), made, list(read), list(columns), BY_DIRECTIONS)

    def _elements(self, result: int) -> list[int]:
        return self.operations.results[result]


class ChainCalls:
    """The calls of a chain, for some arguments.

    `values` contains what each part has calculated: results by group, ``before_<turn>`` and ``stored_<turn>``. `last`
    has the final values of each pass.
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
        """Return what follows from shared inputs and the ends of earlier passes, through a function of this name."""
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
        """Return the results of a part's function of its groups, of what it has calculated, and of `more`."""
        values, places = {**self.values[part], **more}, self._chain.places[part]
        for k, name in enumerate(function.name_in()):
            if name not in values:
                values[name] = self.argument(places[name], function.numel_in(k))
        return called(function, values)

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
    free = symbols_of(column_of(results))
    return {name: column for name, column in inputs.items() if not free.isdisjoint(elements_of([column]))}
