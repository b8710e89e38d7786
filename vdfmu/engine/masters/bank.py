"""The memory that units and master share: values of all connected variables of a type, in place."""

from __future__ import annotations

from collections.abc import Callable
from itertools import pairwise
from typing import Any

import numpy as np
from numpy.typing import NDArray

from vdfmu.base.arrays import Floats
from vdfmu.engine.fmu.access import DTYPES, TEXTS, Call
from vdfmu.engine.fmu.instance import Instance
from vdfmu.engine.fmu.variables import FmuVariable
from vdfmu.engine.plan.check import Checked
from vdfmu.engine.plan.conversion import Link, Port

_RUNS = 6
"""Most copies of neighbours that are faster than one copy of single values."""


class Bank:
    """All outputs and connected inputs of one kind, in one array: ``[outputs | inputs]``.

    Local variables are the outputs of an FMU that has none.

    FMI calls fill it in place where they have the same type, one window for each unit's outputs and one
    for its inputs. In an input window the fresh inputs (see `Schedule`) come first.
    """

    def __init__(self, kind: str, checked: Checked, words: Floats) -> None:
        self.kind = kind
        self._fresh = fresh = checked.schedule.fresh
        links = {link.end: link for link in checked.links if link.stepped}
        outputs: list[tuple[str, FmuVariable]] = []
        inputs: list[tuple[str, FmuVariable]] = []
        self.output_windows: dict[str, slice] = {}
        self.input_windows: dict[str, slice] = {}
        for unit, description in checked.sources.items():
            own = [v for v in description.recordable if v.kind == kind]
            self.output_windows[unit] = slice(len(outputs), len(outputs) + len(own))
            outputs += [(unit, v) for v in own]
            fed = [
                v for v in description.named("input")
                if v.kind == kind and (unit, v.name) in links
            ]  # fmt: skip
            fed.sort(key=lambda v, unit=unit: (unit, v.name) not in fresh)
            self.input_windows[unit] = slice(len(inputs), len(inputs) + len(fed))
            inputs += [(unit, v) for v in fed]
        self.variables = [*outputs, *inputs]
        if kind in TEXTS:  # which other processes do not see
            self.memory: NDArray[Any] = np.full(len(self.variables), b"", DTYPES[kind])
            self.words = 0
        else:
            self.memory = words.view(DTYPES[kind])[: len(self.variables)]
            self.words = -(-self.memory.nbytes // words.itemsize)
        self.outputs = self.memory[: len(outputs)]
        self.inputs = self.memory[len(outputs) :]
        self.position: dict[Port, int] = {(u, v.name): i for i, (u, v) in enumerate(self.variables)}
        self.links: list[Link] = [links[u, v.name] for u, v in inputs]
        self.fresh_counts = {
            unit: sum((u, v.name) in fresh for u, v in inputs[window]) for unit, window in self.input_windows.items()
        }

    def is_free(self, place: int) -> bool:
        """Whether the value at a place is an output, or an input that no component feeds, here or elsewhere."""
        return place < self.outputs.size or self.links[place - self.outputs.size].is_given

    def gather(self, window: slice, late: bool = False) -> Callable[[], None] | None:
        """Return a function that brings the inputs of a window up to date; None for an empty window.

        With `late` it may leave out the fresh ones.
        """
        links = self.links[window]
        if not links:
            return None
        copies = self._copies(window, late)
        if copies is not None:

            def copied() -> None:
                for target, source in copies:
                    target[:] = source

            return copied if copies else None
        sources = np.array([self.position[link.start] for link in links], np.intp)
        target, take = self.inputs[window], self.outputs.take
        factor = np.array([link.conversion.factor for link in links])
        offset = np.array([link.conversion.offset for link in links])
        tables = [(i, link.conversion.table) for i, link in enumerate(links) if link.conversion.table is not None]

        def plain() -> None:
            take(sources, None, target, "clip")  # the mode that needs no buffer; the indices are valid

        def scaled() -> None:
            take(sources, None, target, "clip")
            np.multiply(target, factor, target)
            np.add(target, offset, target)

        def mapped() -> None:
            take(sources, None, target, "clip")
            for i, table in tables:
                target[i] = table.get(int(target[i]), int(target[i]))

        if tables:
            return mapped
        return plain if all(link.conversion.trivial for link in links) else scaled

    def _copies(self, window: slice, late: bool) -> list[tuple[memoryview, memoryview]] | None:
        """Return targets and sources of the inputs of a window, run by run; None where one `take` is faster."""
        if self.kind in TEXTS or not all(link.conversion.trivial for link in self.links[window]):
            return None
        pairs = [
            (self.position[link.end], self.position[link.start])
            for link in self.links[window]
            if not (late and link.end in self._fresh)
        ]
        begins = [k for k, (i, j) in enumerate(pairs) if k == 0 or (i - 1, j - 1) != pairs[k - 1]]
        if len(begins) > _RUNS:
            return None
        memory = self.memory.data
        return [
            (memory[i : i + n], memory[j : j + n])
            for begin, end in pairwise([*begins, len(pairs)])
            for (i, j), n in [(pairs[begin], end - begin)]
        ]

    def calls(self, instance: Instance, verb: str, chosen: Callable[[FmuVariable], bool] | None = None) -> list[Call]:
        """Return the vectorised calls that ``Get`` or ``Set`` a unit's window; none when it is empty.

        They are for the `chosen` variables; by default for those that the unit has between its events.
        """
        window = (self.output_windows if verb == "Get" else self.input_windows)[instance.name]
        shift = 0 if verb == "Get" else self.outputs.size
        variables = [v for _, v in self.variables[window.start + shift : window.stop + shift]]
        part = (self.outputs if verb == "Get" else self.inputs)[window]
        if chosen is None:
            chosen = instance.between_events
        return instance.access(verb, variables, part, chosen)
