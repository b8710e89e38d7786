"""Values between units and master, in one memory per type: initialization, the calls of a step, recording."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from ctypes import c_double, c_int, c_long
from itertools import groupby
from typing import Any

import numpy as np
from numpy.typing import NDArray

from vdfmu.base.arrays import Floats, distinct
from vdfmu.base.errors import CosimError, FailureKind, UsageError
from vdfmu.base.text import matching
from vdfmu.engine.fmu.access import DTYPES, KINDS, TEXTS, Call, Transfer, held
from vdfmu.engine.fmu.instance import Instance
from vdfmu.engine.fmu.messages import MessageBox
from vdfmu.engine.fmu.variables import FmuVariable
from vdfmu.engine.masters.broyden import Broyden, not_solved
from vdfmu.engine.package.system import Value
from vdfmu.engine.plan.check import Checked
from vdfmu.engine.plan.conversion import SOURCE, Link, Port
from vdfmu.engine.plan.inputs import Course
from vdfmu.engine.results.results import Signal

Gather = Callable[[], None]
"""Updates inputs."""


class Bank:
    """All outputs and connected inputs of one kind, in one array: ``[outputs | inputs]``.

    FMI calls of the same type use it in place, with a window for each unit's outputs and one for its inputs. In a
    window of inputs the fresh inputs (see `Schedule`) come first. If an FMU has no outputs, its local variables are
    used instead. An output of another kind that feeds inputs of this kind is here too and is read a second time; the
    transfer converts it.
    """

    def __init__(self, kind: str, checked: Checked, links: Mapping[Port, Link], words: Floats) -> None:
        self.kind = kind
        types = ("Integer", "Enumeration") if kind == "Integer" else (kind,)
        fresh = checked.schedule.fresh
        read = {link.start for link in links.values() if link.sink.kind == kind}
        outputs: list[tuple[str, FmuVariable]] = []
        inputs: list[tuple[str, FmuVariable]] = []
        self.output_windows: dict[str, slice] = {}
        self.input_windows: dict[str, slice] = {}
        self.fresh_windows: dict[str, slice] = {}
        for unit, description in checked.sources.items():
            first, start = len(outputs), len(inputs)
            outputs += [(unit, v) for v in description.recordable if v.type in types]
            unlike = (v for v in description.variables.values() if v.type not in types) if read else ()
            outputs += [(unit, v) for v in unlike if (unit, v.name) in read]
            fed = [v for v in description.named("input") if v.type in types and (unit, v.name) in links]
            fed.sort(key=lambda v, unit=unit: (unit, v.name) not in fresh)
            inputs += [(unit, v) for v in fed]
            self.output_windows[unit], self.input_windows[unit] = slice(first, len(outputs)), slice(start, len(inputs))
            self.fresh_windows[unit] = slice(start, start + sum((unit, v.name) in fresh for v in fed))
        self.variables = [*outputs, *inputs]
        if kind in TEXTS:  # not shared with other processes
            self.memory: NDArray[Any] = np.full(len(self.variables), b"", DTYPES[kind])
            self.words = 0
        else:
            self.memory = words.view(DTYPES[kind])[: len(self.variables)]
            self.words = -(-self.memory.nbytes // words.itemsize)
        self.outputs = self.memory[: len(outputs)]
        self.inputs = self.memory[len(outputs) :]
        self.position: dict[Port, int] = {(u, v.name): i for i, (u, v) in enumerate(self.variables)}
        self.names = {f"{u}.{v.name}": i for i, (u, v) in enumerate(self.variables) if u != SOURCE and v.type in types}
        self.links: list[Link] = [links[u, v.name] for u, v in inputs]
        self._transfers: dict[tuple[str, str], list[Transfer]] = {}

    def is_free(self, place: int) -> bool:
        """Return whether the value at a place is an output, or an input from a file or an array."""
        return place < self.outputs.size or self.links[place - self.outputs.size].is_given

    def inputs_of(self, name: str = "", fresh: bool = False) -> slice:
        """Return the window of all inputs, or of those of a unit, or of its `fresh` ones."""
        if not name:
            return slice(0, len(self.links))
        return (self.fresh_windows if fresh else self.input_windows)[name]

    def gather(self, window: slice) -> Gather | None:
        """Return the function that updates the inputs of a window, if it has any."""
        links = self.links[window]
        if not links:
            return None
        sources = np.array([self.position[link.start] for link in links], np.intp)
        target, take = self.inputs[window], self.outputs.take
        factor = np.array([link.conversion.factor for link in links])
        offset = np.array([link.conversion.offset for link in links])
        tables = [(i, link.conversion.table) for i, link in enumerate(links) if link.conversion.table is not None]

        def plain() -> None:
            take(sources, None, target, "clip")  # this mode needs no buffer; the indices are valid

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

    def calls(self, instance: Instance, verb: str, chosen: Callable[[FmuVariable], bool] | None = None) -> list[Call]:
        """Return the vectorised calls that ``Get`` or ``Set`` a unit's window, or its `chosen` variables.

        Default: variables that can be called between events.
        """
        if chosen is None:
            return instance.calls_of(self.transfers(instance, verb))
        return instance.access(verb, *self.window(instance, verb), chosen)

    def transfers(self, instance: Instance, verb: str) -> list[Transfer]:
        """Return the transfers of the default calls, the same each time unless they hold elements of arrays."""
        key = instance.name, verb
        if key not in self._transfers:
            made = instance.transfers(verb, *self.window(instance, verb), instance.between_events)
            if any(moved.partial for moved in made):
                return made
            self._transfers[key] = made
        return self._transfers[key]

    def window(self, instance: Instance, verb: str) -> tuple[list[FmuVariable], NDArray[Any]]:
        """Return the variables that are to ``Get`` or ``Set``, and their memory."""
        window = (self.output_windows if verb == "Get" else self.input_windows)[instance.name]
        shift = 0 if verb == "Get" else self.outputs.size
        variables = [v for _, v in self.variables[window.start + shift : window.stop + shift]]
        return variables, (self.outputs if verb == "Get" else self.inputs)[window]


_HEAD = 5
"""Words before the values: clock, size, running, pressed, row."""


def words_of(checked: Checked) -> int:
    """Return an upper limit of the number of 8-byte words of an exchange."""
    variables = sum(len(description.variables) for description in checked.sources.values())
    return _HEAD + variables + sum(link.source.kind != link.sink.kind for link in checked.links) + len(KINDS)


class Exchange:
    """The data flow of a run: initialization, the calls of a step, and recording.

    `instances` are empty if the components are in another process. `words`, (`words_of`,) zeros, is the memory of all
    values; by default new.
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
        """For processes that share the memory: what the components' process is doing, and whether to stop."""
        self.row = c_long.from_buffer(words, 8 * 4)  # pyright: ignore[reportArgumentType]
        """The last complete row of steps in C."""
        self.banks: list[Bank] = []
        taken = _HEAD
        links = {link.end: link for link in checked.links if link.stepped}
        for kind in KINDS:
            self.banks.append(Bank(kind, checked, links, words[taken:]))
            taken += self.banks[-1].words
        self._groups = _arrays(checked.schedule.initial.links)
        """Connections in the order of the initialization."""
        self.watched = np.zeros(0, np.intp)
        """Real outputs that must be finite."""
        self._reads: list[tuple[Instance, list[Call]]] = []
        """Calls that get the outputs."""
        self._fed: list[tuple[NDArray[Any], NDArray[np.intp], Course]] = []
        for kind, names, course in checked.feed.courses if checked.feed else ():
            bank = self._bank(kind)
            places = np.array([bank.position[SOURCE, name] for name in names], np.intp)
            self._fed.append((bank.memory, places, course))
        self.breaks = distinct([], *(course.breaks for *_, course in self._fed))
        """Times [s] at which an external signal jumps or bends."""
        self.close = max((course.tolerance for *_, course in self._fed), default=0.0)
        """Difference [s] within which a time equals one of them."""

    def _bank(self, kind: str) -> Bank:
        return next(bank for bank in self.banks if bank.kind == kind)

    def feed(self, time: float) -> None:
        """Set the external signals to their values at a time."""
        for memory, places, course in self._fed:
            memory[places] = course.at(time)

    def initialize(self, time: float, convergence: float) -> None:
        """Pass values over the connections in initialization mode, in the order of dependencies.

        Algebraic loops repeat until values agree to `convergence`, relative to their size or nominal value. CosimError
        if they do not.
        """
        self.feed(time)
        initial = self.checked.schedule.initial
        if not initial.torn:
            self._pass(self._groups)
            return
        texts = [link for link in initial.torn if link.sink.type in TEXTS]
        torn = [link for link in initial.torn if link.sink.type not in TEXTS]
        values = np.array(self._values(torn), np.float64)
        least = np.array([1.0 if link.discrete else link.sink.size for link in torn])

        def repeat(guess: Floats) -> Floats:
            new = iter(guess.tolist())
            for links in _arrays(torn):
                self._carry(links, [next(new) if link.sink.kind == "Real" else round(next(new)) for link in links])
            self._pass([*_arrays(texts), *self._groups])
            values[:] = self._values(torn)
            return values

        def size(residual: Floats) -> Floats:
            sizes = np.abs(residual) / np.maximum(np.abs(values), least)
            return np.where(np.isnan(sizes), np.inf, sizes)

        sizes, count = Broyden().solve(values.copy(), repeat, size, convergence)
        if not np.all(sizes <= convergence):
            worst = int(np.argmax(sizes))
            link = torn[worst]
            raise CosimError(
                link.start[0],
                "initialization",
                time,
                f"the values do not agree: {link} {not_solved(sizes[worst], count, convergence)}. Algebraic loop: "
                f"{initial.loops[initial.torn.index(link)]}. Give start values nearer to the solution, or break it",
                kind=FailureKind.COUPLING,
            )

    def _pass(self, groups: Sequence[Sequence[Link]]) -> None:
        """Pass values over connections, group by group."""
        for links in groups:
            self._carry(links, self._brought(links))

    def _values(self, links: Sequence[Link]) -> list[Any]:
        """Return the values that connections bring to their inputs."""
        return [value for group in _arrays(links) for value in self._brought(group)]

    def _brought(self, links: Sequence[Link]) -> list[Any]:
        """Return the values that connections from one unit bring to their inputs."""
        start, values = links[0].start[0], list[Any]()
        if start == SOURCE:
            for link in links:
                bank = self._bank(link.source.kind)
                values.append(bank.memory[bank.position[link.start]].item())
        else:
            values = self.instances[start].get_all([link.source for link in links])
        return [_converted(link, value) for link, value in zip(links, values, strict=True)]

    def _carry(self, links: Sequence[Link], values: Sequence[Value]) -> None:
        """Set the inputs at the ends of connections to one unit."""
        pairs = list(zip(links, values, strict=True))
        self.instances[links[0].end[0]].set_all([(link.sink, value) for link, value in pairs])
        banks = {bank.kind: bank for bank in self.banks}
        for link, value in pairs:
            if link.stepped:
                bank = banks[link.sink.kind]
                bank.memory[bank.position[link.end]] = held(bank.kind, value)

    def read_outputs(self) -> None:
        """Get all outputs."""
        if not self._reads:
            for instance in self.instances.values():
                calls = [call for bank in self.banks for call in bank.calls(instance, "Get")]
                self._reads.append((instance, calls))
        for instance, calls in self._reads:
            instance.run(calls)

    def gathers(self, name: str = "", fresh: bool = False) -> list[Gather]:
        """Return the functions that update the inputs of each bank; for the arguments see `Bank.inputs_of`."""
        gathers = (bank.gather(bank.inputs_of(name, fresh)) for bank in self.banks)
        return [gather for gather in gathers if gather is not None]

    def calls(self, name: str) -> list[Call]:
        """Return the calls of a unit in a step: set its inputs, step, get its outputs."""
        instance = self.instances[name]
        sets, gets = ([call for bank in self.banks for call in bank.calls(instance, verb)] for verb in ("Set", "Get"))
        return [*sets, instance.step_call(self.clock, self.size), *gets]

    def recorders(
        self, rows: int, record: Sequence[str] | None
    ) -> tuple[list[Signal], dict[str, NDArray[Any]], dict[str, list[int]], Callable[[int], None]]:
        """Return the recorded signals, their rows and places in the bank by kind, and the function that stores row k.

        Names may have ``*`` for any text. Default: outputs, and inputs from outside; other inputs follow from outputs.
        Signals come unit by unit in the order of the SSD, outputs first.
        """
        banks = [bank for bank in self.banks if bank.kind not in TEXTS]
        wanted: set[str] = set()
        for text in record or ():
            hits = [name for bank in banks for name in matching([*bank.names], [text])]
            if not hits:
                raise UsageError(f"record: no output or connected input matches {text!r}")
            wanted.update(hits)
        order = {unit: i for i, unit in enumerate(self.checked.descriptions)}
        signals: list[tuple[int, Signal]] = []
        data: dict[str, NDArray[Any]] = {}
        stores: list[Callable[[int], None]] = []
        columns: dict[str, list[int]] = {}
        for bank in banks:
            kind = bank.kind.lower()
            chosen = [i for name, i in bank.names.items() if (bank.is_free(i) if record is None else name in wanted)]
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
                signals.append((2 * order[unit] + int(i >= bank.outputs.size), signal))
            if bank is self.banks[0]:
                read = {bank.position[link.start] for link in bank.links}
                outputs = {i for i in chosen if bank.variables[i][1].causality == "output"}
                self.watched = np.array(sorted(read | outputs), np.intp)
            if chosen:
                columns[kind] = chosen
                stores.append(row_store(rec, bank.memory, chosen))
        signals.sort(key=lambda item: item[0])

        def store(k: int) -> None:
            for each in stores:
                each(k)

        return [signal for _, signal in signals], data, columns, stores[0] if len(stores) == 1 else store

    def reals(self, wanted: Iterable[str]) -> tuple[list[str], Floats, list[int]]:
        """Return the names of matching real signals, their memory, and the place of each in it."""
        bank = self.banks[0]
        names = matching(bank.names, wanted)
        return names, bank.memory, [bank.names[name] for name in names]

    def refuse_not_finite(self, call: str, time: float) -> None:
        """Raise CosimError if an output that is read or recorded is not finite at `time`."""
        bank = self.banks[0]
        values = bank.outputs.take(self.watched)
        if math.isfinite(values.dot(values)) or np.isfinite(values).all():  # squares of huge numbers overflow
            return
        order = {unit: i for i, unit in enumerate(self.checked.schedule.units)}
        wrong = [i for i in self.watched if not math.isfinite(bank.outputs[i])]
        first, *rest = sorted(wrong, key=lambda i: order[bank.variables[i][0]])
        unit, variable = bank.variables[first]
        names = [f"{owner}.{v.name}" for owner, v in (bank.variables[i] for i in rest)]
        also = f" (also {', '.join(names[:3])}{', ...' if names[3:] else ''})" if names else ""
        read = any((unit, variable.name) == link.start for link in bank.links)
        way = "" if read else ". No component reads it: do not record it (record, --record) to continue"
        raise CosimError(
            unit,
            call,
            self.box.time,
            f"{variable.name} is {bank.outputs[first]} at t = {time:.9g} s, expected a finite number{also}{way}",
            kind=FailureKind.NOT_FINITE,
        )


def _arrays(links: Iterable[Link]) -> list[list[Link]]:
    """Return connections in groups: neighbours from one unit to another, or from array to array of one unit.

    A group sets no input of the unit that it reads, so that all its values are known before the first is passed on.
    """

    def ends(link: Link) -> tuple[Any, ...]:
        units = link.start[0], link.end[0]
        return units if units[0] != units[1] else (*units, link.source.reference, link.sink.reference)

    return [list(group) for _, group in groupby(links, ends)]


def _converted(link: Link, value: Any) -> Any:
    """Return the value of a connection's output, converted for its input."""
    if link.conversion.table is not None:
        return link.conversion.table.get(int(value), int(value))
    return value if link.conversion.trivial else link.conversion.factor * value + link.conversion.offset


def row_store(rec: NDArray[Any], memory: NDArray[Any], picked: Sequence[int]) -> Callable[[int], None]:
    """Return the function that stores the chosen values in row k of `rec`."""
    columns = np.array(picked, np.intp)

    def store(k: int) -> None:
        memory.take(columns, None, rec[k], "clip")

    return store
