"""The components of one run in a separate process, where they may crash, end, or never return.

Master and process share the memory of the `Exchange`, so a step is one message to the process and one back for any
number of components. In this memory the process also marks the component that it calls, so that the master can name it.
What FMUs print goes to the error output, with control characters escaped.
"""

from __future__ import annotations

import math
import mmap
import pickle
from collections.abc import Mapping, Sequence
from contextlib import suppress
from pathlib import Path
from time import monotonic
from typing import Any, Self

import numpy as np
from numpy.typing import NDArray

from vdfmu.base.arrays import Floats
from vdfmu.base.errors import CosimError, FailureKind, VdfmuError
from vdfmu.base.files import storing
from vdfmu.base.process import Child, ending
from vdfmu.engine.fmu.access import DTYPES
from vdfmu.engine.fmu.messages import LogMessage, MessageBox
from vdfmu.engine.masters.exchange import Exchange, words_of
from vdfmu.engine.masters.loop import NO_COMPILER, library
from vdfmu.engine.masters.sampled import Stepper
from vdfmu.engine.options import Limits
from vdfmu.engine.package.system import Value
from vdfmu.engine.plan.check import Checked
from vdfmu.engine.plan.grid import Grid
from vdfmu.engine.results.recorder import RowsInMemory

_WORDS = 2**17
"""Words of memory for the rows of steps in C, see `windows`, or more if one row needs more."""
CALLS = "calls"
"""File next to the memory: a line for each function of a component, written before its first call. The word `running`
of the exchange is the number of the line, from 1, during a call, and its negative afterwards."""
_START = 60.0
"""Additional time for the start of the process [s]."""
_PATIENCE = 0.5
"""Longest time [s] that a step may take after Ctrl-C."""


def _asked(name: str) -> Any:
    """Return the method of `Isolated` that calls the method of this name in the process."""

    def asked(self: Isolated, *arguments: Any) -> Any:
        return self._ask(name, *arguments)  # pyright: ignore[reportPrivateUsage]

    return asked


class LostProcessError(CosimError):
    """The components' process has ended, or did not answer in time."""


class Isolated(Stepper):
    """`Components` and their stepper, in a process that runs `vdfmu.engine.run.isolated_server`."""

    def __init__(
        self, checked: Checked, folders: Mapping[str, Path], box: MessageBox, folder: Path, limits: Limits
    ) -> None:
        self.box, self.limits = box, limits
        self._names = list(checked.descriptions)
        self._memory = folder / "memory"
        with storing(self._memory):
            self._memory.write_bytes(bytes(8 * words_of(checked)))
        self.exchange = Exchange(checked, {}, box, mapped(self._memory))
        self._content = pickle.dumps((checked, dict(folders)))
        self._child: Child | None = None
        self._plans = 0
        self._pressed_at, self._cut_off, self._late, self._stepping = math.inf, False, False, False

    def load(self) -> None:
        """Start the process, load the libraries and create the instances."""
        self._child = Child(
            "vdfmu.engine.run.isolated_server",
            str(self._memory),
            str(self.limits.memory),
            limit=self.limits.time,
            show=True,
            stop=self._stop,
        )
        self._child.since += _START
        self._take()
        self._ask("load", self._content)

    def initialize(self, *arguments: Any) -> None:
        """See `Components.initialize`."""
        self.box.time = arguments[0]
        self._ask("initialize", *arguments)

    def couple(self, *arguments: Any) -> Self:
        """See `Components.couple`."""
        self._ask("couple", *arguments)
        self._stepping = True
        return self

    def advance(self, time: float, step: float, stop: float) -> None:
        """Step all components."""
        self._ask("advance", time, step, stop)

    def compiled(self, grid: Grid, keepers: Sequence[RowsInMemory]) -> IsolatedSteps | str:
        """See `Components.compiled`."""
        columns = [dict(keeper.columns) for keeper in keepers]
        width = sum(len(places) for each in columns for places in each.values())
        size = min(grid.n, max(1, _WORDS // max(width, 1)))
        self._plans += 1
        rows = self._memory.with_name(f"rows_{self._plans}")  # both processes may still have the one of an earlier run
        with storing(rows):
            rows.write_bytes(bytes(8 * max(size * width, 1)))
        why = NO_COMPILER if library() is None else self._ask("compile", tuple(grid), columns, size, rows)
        return why or IsolatedSteps(self, grid, keepers, windows(mapped(rows), columns, size))

    def do_steps(self, end: int) -> None:
        """Make steps in C up to row `end`."""
        self._ask("do_steps", end)

    def facts(self) -> dict[str, Any]:
        """Return the summary's entries on the steps, if the process is alive."""
        return {} if self._child is None else self._ask("facts")

    def notes(self) -> list[str]:
        """Return notes on the run."""
        return self._ask("notes")

    bring_inputs, put, between_events, keep_start, to_start, derive = map(
        _asked, ("bring_inputs", "put", "between_events", "keep_start", "to_start", "derive")
    )
    """See `Components`; for `derive` see `Server.derive`."""

    def value(self, name: str, variable: str) -> Value:
        """See `Components.value`."""
        value = self._ask("value", name, variable)
        binary = self.exchange.checked.descriptions[name].variables[variable].kind == "Binary"
        return bytes.fromhex(value) if binary else value

    def reset(self, checked: Checked) -> None:
        """See `Components.reset`."""
        self.exchange.checked, self._stepping = checked, False
        starts = {name: [(v.name, value) for v, value in each] for name, each in checked.starts.items()}
        self._ask("reset", starts, dict(checked.multiples))

    def close(self) -> CosimError | None:
        """Free all components, end the process, and return the first failure."""
        failure = None
        self._stepping = False
        self.pressed = lambda: False
        try:
            if self._child is not None and self._child.since == math.inf:  # it waits for a request
                failure = self._ask("close", self.box.time)
                failure = None if failure is None else CosimError(*failure)
            elif self._child is not None:  # interrupted in a call
                self._child.kill()
        except CosimError as error:
            failure = error
        finally:
            self._end()
        self.box.flush()
        return failure

    def _ask(self, name: str, *arguments: Any) -> Any:
        """Make the process call a method of its `Server`."""
        assert self._child is not None
        self._child.send((name, arguments))
        return self._take()

    def _take(self) -> Any:
        """Wait for the answer to a request; CosimError if it failed or the process has ended."""
        assert self._child is not None
        try:
            reply = self._child.take()
        except EOFError:
            lost = self._lost()
            raise KeyboardInterrupt if self._cut_off else lost from None
        if reply is None:
            return None
        self.box.pending += [LogMessage(**message) for message in reply["messages"]]
        self.box.ended.clear()
        self.box.ended.update(reply["ended"])
        if reply["interrupted"]:
            raise KeyboardInterrupt
        if reply["failure"] is not None:
            raise CosimError(*reply["failure"])
        if reply["fault"] is not None:
            raise VdfmuError(reply["fault"])
        return reply["result"]

    def _called(self) -> tuple[str, str]:
        """Return the component and the function that the process called last; empty if it called none."""
        number = abs(self.exchange.running.value)
        with suppress(OSError, ValueError, IndexError):  # the component's code may have written there too
            lines = self._memory.with_name(CALLS).read_text(encoding="utf-8", errors="replace").splitlines()
            position, call = lines[number - 1].split(" ") if number else ("", "")
            return self._names[int(position)], call
        return "", ""

    def _lost(self) -> CosimError:
        """Return the error of a process that has ended or sends an invalid answer."""
        code, peak = self._end()
        unit, call = self._called()
        time = self.exchange.clock.value if self._stepping else self.box.time
        how, killed = ending(code)
        if not unit:
            why = f"it ended ({how})"
            return LostProcessError("components", "start of their process", time, why, kind=FailureKind.LOST)
        if killed and not self._late:
            unit = "components"
            why = f"their process was killed from outside ({how}), as the system does when memory is short"
        elif self.exchange.running.value < 0:
            end = f"did not continue within {self.limits.time:g} s" if self._late else f"ended ({how})"
            why = f"the process {end} after this call had returned: the call did damage, or vdfmu has a fault"
        elif self._late:
            why = f"no return within {self.limits.time:g} s; a longer wait_limit (run --wait-limit) allows more"
        elif code < 0:
            why = f"the component crashed the process ({how})"
        else:
            why = f"the component ended the process ({how})"
        if peak > 0.5 * self.limits.memory:
            why += f"; its memory had reached {peak:.0f} MB of {self.limits.memory:.0f} MB (memory_limit)"
        kind = FailureKind.TIME_LIMIT if self._late else FailureKind.LOST
        return LostProcessError(unit, call, time, why, kind=kind)

    def _stop(self) -> bool:
        """Forward Ctrl-C; return whether to abort a long step."""
        if self.pressed():
            self.exchange.pressed.value = 1
            self._pressed_at = min(self._pressed_at, monotonic())
        since = math.inf if self._child is None else self._child.since
        self._cut_off = monotonic() - max(since, self._pressed_at) > _PATIENCE
        return self._cut_off

    def _end(self) -> tuple[Any, float]:
        """End the process and its children; return its exit code and its peak memory [MB]."""
        child = self._child
        if child is None:
            return 0, 0.0
        try:
            code, peak, _ = child.end()
        finally:
            self._late, self._child = child.late, None
        return code, peak


class IsolatedSteps:
    """Steps of isolated components in C, whose rows are in `windows`; see `CompiledSteps`."""

    lasting = False

    def __init__(
        self, components: Isolated, grid: Grid, keepers: Sequence[RowsInMemory], windows: Sequence[Window]
    ) -> None:
        self._components, self._grid, self._row = components, grid, components.exchange.row
        self._parts = list(zip(keepers, windows, strict=True))

    def run(self, end: int) -> int:
        """Do steps to row `end` at most; return the last complete row. See `CompiledSteps.run`."""
        first = self._row.value + 1
        try:
            self._components.do_steps(end)
        finally:
            for keeper, window in self._parts:
                window.bring(keeper, first, self._row.value + 1)
            self._components.box.time = self._grid.time(max(self._row.value - 1, 0))
        return self._row.value


class Window(RowsInMemory):
    """Rows of a block of steps in C, in memory shared by both processes."""

    def __init__(self, data: Mapping[str, NDArray[Any]], columns: Mapping[str, Sequence[int]], size: int) -> None:
        super().__init__(data, columns, lambda k: None)
        self._size = size

    def room(self, k: int) -> tuple[int, int]:
        """Make room for a block from row `k`; see `RowsInMemory.room`."""
        return k, k + self._size

    def bring(self, keeper: RowsInMemory, first: int, after: int) -> None:
        """Pass the rows from `first` to a keeper."""
        k, after = first, min(after, first + self._size)  # a component's code may have changed the number of rows
        while k < after:
            begin, full = keeper.room(k)
            end = min(after, full)
            for kind, rows in self.data.items():
                keeper.data[kind][k - begin : end - begin] = rows[k - first : end - first]
            k = end


def windows(words: Floats, columns: Sequence[Mapping[str, Sequence[int]]], size: int) -> list[Window]:
    """Return windows of `size` rows in shared memory for the places of each keeper, by kind."""
    made: list[Window] = []
    for each in columns:
        data: dict[str, NDArray[Any]] = {}
        for kind, places in each.items():
            n = size * len(places)
            data[kind] = words.view(DTYPES[kind.capitalize()])[:n].reshape(size, -1)
            words = words[n:]
        made.append(Window(data, each, size))
    return made


def mapped(path: Path) -> Floats:
    """Return the shared memory."""
    with open(path, "r+b") as file:
        return np.frombuffer(mmap.mmap(file.fileno(), 0), np.float64)
