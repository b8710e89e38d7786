"""The process of isolated components; see `vdfmu.engine.run.isolated`."""

from __future__ import annotations

import logging
import math
import pickle
import sys
import traceback
from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from dataclasses import replace
from pathlib import Path
from typing import Any

from vdfmu.base.errors import CosimError, UsageError, VdfmuError
from vdfmu.base.process import Parent, contained, limit
from vdfmu.base.text import kind_text
from vdfmu.engine.fmu.messages import LogMessage, MessageBox
from vdfmu.engine.masters.components import Components
from vdfmu.engine.masters.exchange import Exchange
from vdfmu.engine.package.system import Value
from vdfmu.engine.plan.grid import Grid
from vdfmu.engine.run.isolated import CALLS, mapped, windows


class Server:
    """Serves requests of `Isolated` with its own methods and those of the stepper or the components."""

    def __init__(self, memory: str) -> None:
        self._said: list[LogMessage] = []
        self._box = MessageBox(self._said.append)
        self._box.take = self._said.append
        self._words = mapped(Path(memory))
        self._calls, self._lines = open(Path(memory).with_name(CALLS), "w", encoding="utf-8"), 0

    def load(self, start: bytes) -> None:
        """Load the pickled `start`: a `Checked`, and the folders of its unpacked FMUs."""
        checked, folders = pickle.loads(start)
        positions = {name: i for i, name in enumerate(checked.descriptions)}
        running = Exchange(checked, {}, self._box, self._words).running

        def watch(unit: str, call: str, function: Any) -> Any:
            self._calls.write(f"{positions[unit]} {call}\n")
            self._calls.flush()
            self._lines += 1
            number = self._lines

            def noted(*arguments: Any) -> Any:
                running.value = number
                try:
                    return function(*arguments)
                finally:
                    running.value = -number

            noted.__dict__["number"] = number  # for calls in C
            return noted

        self._derivatives: Any = None
        self._components = Components(checked, folders, self._box, self._words, watch)
        self._components.load()

    def reset(self, starts: Mapping[str, Sequence[tuple[str, Value]]], multiples: Mapping[str, int]) -> None:
        """See `Components.reset`; for the values see `Checked`."""
        checked, tables = self._components.checked, self._components.checked.descriptions
        mine = {
            name: [(tables[name].variables[each], value) for each, value in values] for name, values in starts.items()
        }
        self._box.ended.clear()
        self._derivatives = None
        self._components.reset(replace(checked, starts=mine, multiples=multiples))

    def derive(self, call: str, *arguments: Any) -> Any:
        """Call a method of the `Derivatives` of the components."""
        from vdfmu.engine.linear.linearise import Derivatives  # few runs need it

        self._derivatives = self._derivatives or Derivatives(self._components)
        return getattr(self._derivatives, call)(*arguments)

    def value(self, name: str, variable: str) -> Value:
        """See `Components.value`; binary values are hexadecimal text."""
        value = self._components.value(name, variable)
        return value.hex() if isinstance(value, bytes) else value

    def couple(self, adaptive: float | None, convergence: float | None, span: float, record: Any) -> None:
        """See `Components.couple`."""
        exchange = self._components.exchange
        self._stepper = self._components.couple(adaptive, convergence, span, record)
        self._stepper.pressed = lambda: bool(exchange.pressed.value)
        with suppress(UsageError):  # the master reports it
            exchange.recorders(1, record)

    def compile(self, grid: tuple[float, float, float, int], columns: Any, size: int, rows: Path) -> str:
        """Plan steps in C with rows in the `windows` of a file; return an empty text, or why that is impossible."""
        steps = self._components.compiled(Grid(*grid), windows(mapped(rows), columns, size))
        if isinstance(steps, str):
            return steps
        self._steps = steps
        return ""

    def do_steps(self, end: int) -> None:
        """Do steps in C to row `end` at most."""
        self._steps.run(end)

    def advance(self, time: float, step: float, stop: float) -> None:
        """Step all components."""
        self._box.time = time
        self._stepper.advance(time, step, stop)

    def close(self, time: float) -> list[Any] | None:
        """See `Components.close`; `time` is that of the last row."""
        self._box.time = time
        failure = self._components.close()
        return None if failure is None else list(failure.facts)

    def method(self, name: str) -> Callable[..., Any]:
        """Return a method of this object, for facts and notes of the stepper, else of the components."""
        owner = self if hasattr(self, name) else self._stepper if name in ("facts", "notes") else self._components
        return getattr(owner, name)

    def answer(self, request: bytes) -> dict[str, Any] | None:
        """Serve a request; return the reply, None if there is nothing to report."""
        reply: dict[str, Any] = {"result": None, "failure": None, "fault": None, "interrupted": False}
        try:
            name, arguments = pickle.loads(request)
            reply["result"] = self.method(name)(*arguments)
        except CosimError as error:
            reply["failure"] = error.facts
        except VdfmuError as error:
            reply["fault"] = str(error)
        except KeyboardInterrupt:
            reply["interrupted"] = True
        except Exception as error:
            reply["failure"] = ("vdfmu", "step", self._box.time, _fault(error))
        messages = [*self._said, *self._box.pending]
        if reply["result"] is None and not (messages or self._box.ended or any(reply.values())):
            return None
        self._said.clear()
        self._box.pending.clear()
        return reply | {"messages": [message._asdict() for message in messages], "ended": self._box.ended}


def _fault(error: Exception) -> str:
    """Return the message of an error that was not raised by a component."""
    if isinstance(error, MemoryError):
        return "the memory of the components' process is full: raise memory_limit (--memory-limit)"
    frame = traceback.extract_tb(error.__traceback__)[-1]
    place = f"{Path(frame.filename).name}, line {frame.lineno}"
    return f"{kind_text(error)} ({place}). This is a fault of vdfmu, not of a component; please report it"


def serve(memory: str, most: str) -> None:
    """Serve requests until there are no more; `memory` is a file, `most` is in MB."""
    parent = Parent()
    if math.isfinite(float(most)):
        limit("DATA", int(float(most) * 2**20))
    logging.getLogger("vdfmu.compiler.fmu").addHandler(logging.NullHandler())  # its log is returned as messages
    server = Server(memory)
    parent.reply()  # it has started
    for request in parent.requests():
        parent.reply(server.answer(request))


if __name__ == "__main__":
    contained(serve, *sys.argv[1:])
