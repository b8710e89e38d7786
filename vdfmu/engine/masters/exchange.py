"""Exchange between units and master: initialization, the calls of a step, recording."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from ctypes import c_double, c_int
from typing import Any

import numpy as np
from numpy.typing import NDArray

from vdfmu.base.arrays import Floats
from vdfmu.base.errors import CosimError, UsageError
from vdfmu.base.text import matching
from vdfmu.engine.fmu.access import KINDS, TEXTS, Call, held
from vdfmu.engine.fmu.instance import Instance
from vdfmu.engine.fmu.messages import MessageBox
from vdfmu.engine.masters.bank import Bank
from vdfmu.engine.masters.broyden import Broyden, not_solved
from vdfmu.engine.package.system import Value
from vdfmu.engine.plan.check import Checked
from vdfmu.engine.plan.conversion import SOURCE, Link
from vdfmu.engine.plan.inputs import Course
from vdfmu.engine.results.recorded import Signal

_HEAD = 4
"""Words before the values: clock, size, running, pressed."""


def words_of(checked: Checked) -> int:
    """Return the number of 8-byte words that an exchange needs at most."""
    return _HEAD + sum(len(description.variables) for description in checked.sources.values()) + len(KINDS)


class Exchange:
    """Plans the data flow of a run: initialization, the stages of a step and the recording.

    Parameters
    ----------
    checked : Checked
    instances : mapping of str to Instance
        Empty where only the values are read, of components in another process.
    box : MessageBox
    words : (`words_of`,) array, optional
        The memory for all values, zeros; default one of its own.
    """

    def __init__(
        self, checked: Checked, instances: Mapping[str, Instance], box: MessageBox, words: Floats | None = None
    ) -> None:
        self.checked = checked
        self.instances = instances
        self.box = box
        words = np.zeros(words_of(checked)) if words is None else words
        self.clock, self.size = (c_double.from_buffer(words, 8 * i) for i in (0, 1))  # pyright: ignore[reportArgumentType]
        """Arguments currentCommunicationPoint and communicationStepSize of every doStep."""
        self.running, self.pressed = (c_int.from_buffer(words, 8 * i) for i in (2, 3))  # pyright: ignore[reportArgumentType]
        """For two processes that share the memory: activity of the components' process, and whether to stop."""
        self.banks: list[Bank] = []
        taken = _HEAD
        for kind in KINDS:
            self.banks.append(Bank(kind, checked, words[taken:]))
            taken += self.banks[-1].words
        self._watched = np.zeros(0, np.intp)
        self._all_finite: Callable[[], bool] = lambda: True
        self._fed: list[tuple[NDArray[Any], NDArray[np.intp], Course]] = []
        for kind, names, course in checked.feed.courses if checked.feed else ():
            bank = self._bank(kind)
            places = np.array([bank.position[SOURCE, name] for name in names], np.intp)
            self._fed.append((bank.memory, places, course))
        self.breaks = np.unique(np.concatenate([np.zeros(0), *(course.breaks for *_, course in self._fed)]))
        """Times [s] at which a signal from outside jumps or bends."""
        self.close = max((course.tolerance for *_, course in self._fed), default=0.0)
        """Difference [s] within which a time is one of them."""

    def _bank(self, kind: str) -> Bank:
        return next(bank for bank in self.banks if bank.kind == kind)

    def feed(self, time: float) -> None:
        """Give the signals from outside their values at a time."""
        for memory, places, course in self._fed:
            memory[places] = course.at(time)

    def initialize(self, time: float, convergence: float) -> None:
        """Carry the values over the connections in initialization mode, in the order of dependencies.

        Where they depend on themselves, until they agree: to `convergence`, relative to their size and at least to
        their nominal value. CosimError if they do not.
        """
        self.feed(time)
        initial = self.checked.schedule.initial
        if not initial.torn:
            self._pass(initial.links)
            return
        texts = [link for link in initial.torn if link.sink.type in TEXTS]
        torn = [link for link in initial.torn if link.sink.type not in TEXTS]
        values = np.array([self._value(link) for link in torn], np.float64)
        least = np.array([1.0 if link.discrete else link.sink.size for link in torn])

        def repeat(guess: Floats) -> Floats:
            for link, value in zip(torn, guess.tolist(), strict=True):
                self._carry(link, value if link.sink.kind == "Real" else round(value))
            self._pass(initial.links, texts)
            values[:] = [self._value(link) for link in torn]
            return values

        def size(residual: Floats) -> Floats:
            sizes = np.abs(residual) / np.maximum(np.abs(values), least)
            return np.where(np.isnan(sizes), np.inf, sizes)

        sizes, count = Broyden().solve(values.copy(), repeat, size, convergence)
        if not np.all(sizes <= convergence):
            worst = int(np.argmax(sizes))
            link = torn[worst]
            raise CosimError(
                link.start[0], "initialization", time,
                f"the values do not agree: {link} {not_solved(sizes[worst], count, convergence)}. Algebraic loop: "
                f"{initial.loops[initial.torn.index(link)]}. Give start values nearer to the solution, or break it",
            )  # fmt: skip

    def _pass(self, links: Sequence[Link], torn: Sequence[Link] = ()) -> None:
        """Carry values over connections, first over `torn` ones."""
        for link in (*torn, *links):
            self._carry(link, self._value(link))

    def _value(self, link: Link) -> Any:
        """Return the value that a connection carries now."""
        value: Any = self._source(link)
        if link.conversion.table is not None:
            return link.conversion.table.get(int(value), int(value))
        return value if link.conversion.trivial else link.conversion.factor * value + link.conversion.offset

    def _source(self, link: Link) -> Any:
        """Return the value at the start of a connection."""
        if link.start[0] == SOURCE:
            bank = self._bank(link.source.kind)
            return bank.memory[bank.position[link.start]].item()
        return self.instances[link.start[0]].get(link.source)

    def _carry(self, link: Link, value: Value) -> None:
        self.instances[link.end[0]].set_all([(link.sink, value)])
        if link.stepped:
            bank = self._bank(link.sink.kind)
            bank.memory[bank.position[link.end]] = held(bank.kind, value)

    def read_outputs(self) -> None:
        """Get all outputs."""
        for instance in self.instances.values():
            instance.run([call for bank in self.banks for call in bank.calls(instance, "Get")])

    def calls(self, name: str) -> list[Call]:
        """Return the calls of a unit in a step: set its inputs, step, get its outputs."""
        instance = self.instances[name]
        sets, gets = ([call for bank in self.banks for call in bank.calls(instance, verb)] for verb in ("Set", "Get"))
        return [*sets, instance.step_call(self.clock, self.size), *gets]

    def recorders(
        self, rows: int, record: Sequence[str] | None
    ) -> tuple[list[Signal], dict[str, NDArray[Any]], Callable[[int], None]]:
        """Return the recorded signals, their arrays, and the function that stores row k.

        Names may have ``*`` for any text. Without names they are the outputs, and the inputs that are fed from outside:
        other inputs follow from outputs. Signals come unit by unit in the order of the SSD, outputs first.
        """
        wanted = None if record is None else self._match(record)
        order = {unit: i for i, unit in enumerate(self.checked.descriptions)}
        found: list[tuple[int, Signal]] = []
        data: dict[str, NDArray[Any]] = {}
        stores: list[Callable[[int], None]] = []
        for bank in (each for each in self.banks if each.kind not in TEXTS):
            kind = bank.kind.lower()
            chosen = [
                i for i, (unit, v) in enumerate(bank.variables)
                if unit != SOURCE and (bank.is_free(i) if wanted is None else f"{unit}.{v.name}" in wanted)
            ]  # fmt: skip
            try:
                rec = np.empty((rows, len(chosen)), bank.memory.dtype)
            except (MemoryError, ValueError):
                raise UsageError(
                    f"{rows} rows of {len(chosen)} signals do not fit into memory; record fewer signals"
                ) from None
            data[kind] = rec
            for column, i in enumerate(chosen):
                unit, v = bank.variables[i]
                signal = Signal(f"{unit}.{v.name}", kind, v.unit.name if v.unit else "", column)
                found.append((2 * order[unit] + int(i >= bank.outputs.size), signal))
            if bank is self.banks[0]:
                read = {bank.position[link.start] for link in bank.links}
                outputs = {i for i in chosen if bank.variables[i][1].causality == "output"}
                self._watched = np.array(sorted(read | outputs), np.intp)
                self._all_finite = _finite(bank.outputs, self._watched)
            if chosen:
                stores.append(_store(rec, bank.memory, chosen))
        found.sort(key=lambda item: item[0])

        def store(k: int) -> None:
            for each in stores:
                each(k)

        return [signal for _, signal in found], data, stores[0] if len(stores) == 1 else store

    def reals(self, wanted: Iterable[str]) -> tuple[list[str], Floats, list[int]]:
        """Return names of real signals that match, their memory, and the place of each in it."""
        bank = self.banks[0]
        names = {f"{unit}.{v.name}": i for i, (unit, v) in enumerate(bank.variables) if unit != SOURCE}
        found = sorted(matching(list(names), list(wanted)), key=names.__getitem__)
        return found, bank.memory, [names[name] for name in found]

    def finite(self) -> bool:
        """Whether all real outputs that are read or recorded are finite numbers."""
        return self._all_finite()

    def refuse_not_finite(self, call: str, time: float) -> None:
        """Raise CosimError if an output that is read or recorded is not finite at `time`."""
        bank = self.banks[0]
        order = {unit: i for i, unit in enumerate(self.checked.schedule.units)}
        found = sorted(
            (i for i in self._watched if not math.isfinite(bank.outputs[i])), key=lambda i: order[bank.variables[i][0]]
        )
        if not found:
            return
        unit, variable = bank.variables[found[0]]
        others = [".".join((owner, v.name)) for owner, v in (bank.variables[i] for i in found[1:])]
        also = f" (also {', '.join(others[:3])}{', ...' if others[3:] else ''})" if others else ""
        read = any((unit, variable.name) == link.start for link in bank.links)
        way = "" if read else ". No component reads it: run on without it by what you record (record, --record)"
        raise CosimError(
            unit, call, self.box.time,
            f"{variable.name} is {bank.outputs[found[0]]} at t = {time:.9g} s, expected a finite number{also}{way}",
        )  # fmt: skip

    def _match(self, record: Iterable[str]) -> set[str]:
        variables = [
            each for bank in self.banks if bank.kind not in TEXTS for each in bank.variables if each[0] != SOURCE
        ]
        names = [f"{unit}.{v.name}" for unit, v in variables]
        wanted: set[str] = set()
        for text in record:
            hits = matching(names, [text])
            if not hits:
                raise UsageError(f"record: no output or connected input matches {text!r}")
            wanted.update(hits)
        return wanted


def _finite(outputs: Floats, watched: NDArray[np.intp]) -> Callable[[], bool]:
    """Return a function that tells whether the watched outputs are finite: zero times any other number is NaN."""
    whole, zeros, product = watched.size == outputs.size, np.zeros(watched.size), np.zeros(())
    values = outputs if whole else np.zeros(watched.size)
    found = c_double.from_buffer(product)  # pyright: ignore[reportArgumentType]

    def finite() -> bool:
        if not whole:
            outputs.take(watched, None, values, "clip")
        values.dot(zeros, product)
        return found.value == 0.0

    return finite


def _store(rec: NDArray[Any], memory: NDArray[Any], picked: list[int]) -> Callable[[int], None]:
    n = len(picked)
    if picked == list(range(picked[0], picked[0] + n)):
        rows, row = rec.reshape(-1).data, memory[picked[0] : picked[0] + n].data

        def whole(k: int) -> None:
            rows[n * k : n * (k + 1)] = row

        return whole
    columns = np.array(picked, np.intp)

    def part(k: int) -> None:
        memory.take(columns, None, rec[k], "clip")

    return part
