"""The process that draws a run: ``python -m vdfmu.study.view.live_server PORT``; see `vdfmu.study.view.live`."""

from __future__ import annotations

import os
import pickle
import queue
import sys
import threading
import time as clock
from collections.abc import Mapping, Sequence
from contextlib import suppress
from html import escape
from pathlib import Path
from typing import Any

import numpy as np

from vdfmu.base.arrays import Floats
from vdfmu.base.errors import VdfmuError
from vdfmu.base.page import page
from vdfmu.base.process import Parent
from vdfmu.engine.results.results import Results, Signal
from vdfmu.engine.run import mapped
from vdfmu.study.report.page import report_page
from vdfmu.study.report.scripts import look, scripts_of
from vdfmu.study.report.shapes import Chain
from vdfmu.study.report.shown_run import ShownRun
from vdfmu.study.view.live import HEAD, SIGNALS
from vdfmu.study.view.server import PERIOD, PageServer

_ROWS = 500
"""Rows of a page opened during the run, before every second is dropped."""
_GONE = 3.0
"""Time without a page before the last counts as closed: a page that loads the next is away [s]."""


def words_page(title: str, text: str) -> bytes:
    """Return a page of text that loads its successor."""
    return page(title, "A view of vdfmu", f"<p>{escape(text)}</p>", 60, look(), scripts=scripts_of("words"))


def live_page(title: str, about: Mapping[str, Any], names: Sequence[str], start: float, stop: float) -> bytes:
    """Return the page of a run of the signals `names` that begins, from `start` to `stop` [s]; its arm is at 0."""
    types = about["arm"]["types"]
    rail = Chain(about["arm"]).reach / 3.0  # of a prismatic joint, whose motion is not known yet
    ends = {f"{SIGNALS[0]}[{i}]": rail for i, kind in enumerate(types, 1) if kind == "prismatic"}
    values = np.array([np.zeros(len(names)), [ends.get(name, 0.0) for name in names]])
    signals = [Signal(name, "real", "", column) for column, name in enumerate(names)]
    facts = {key: value for key, value in about.items() if key != "scene"}
    results = Results(np.array([start, stop if stop > start else start + 1.0]), signals, {"real": values}, facts)
    run = ShownRun(title, results, facts, Path(facts.get("package", "")))
    return report_page([run], live={"names": list(names), "start": start, "stop": stop})


class ViewServer:
    """Takes messages of `LiveView`, and draws."""

    def __init__(self, server: PageServer) -> None:
        self._server = server
        self._words: Floats | None = None
        self._rows: list[list[float]] = []
        self._seen, self._stride, self._count = 0.0, 1, 0
        self.words("vdfmu", "The run has not begun.")

    def begin(
        self, title: str, about: Mapping[str, Any], names: Sequence[str], path: str, start: float, stop: float
    ) -> None:
        """Draw the arm of a run that begins."""
        self._words, self._seen = mapped(Path(path)), 0.0
        self._rows, self._stride, self._count = [], 1, 0
        with suppress(OSError):  # it is open; on Windows it is removed with its folder
            os.unlink(path)
        self._server.show(
            live_page(title, about, names, start, stop), first=lambda: {"rows": list(self._rows), "anew": True}
        )

    def words(self, title: str, text: str) -> None:
        """Show a text instead of an arm."""
        self._words = None
        self._server.show(words_page(title, text))

    def end(self, title: str, results: Results, about: Mapping[str, Any], stop: float) -> None:
        """Show the rows of the finished run."""
        self._words = None
        first, last = results.time[[0, -1]]
        words = "The run is complete" if last >= stop - 1e-9 * abs(stop) else "The run ended early"
        run = ShownRun(title, results, about, Path(about.get("package", "")))
        self._server.show(report_page([run], live={}), f"{words}: {first:g} to {last:g} s.")

    def page(self, content: bytes) -> None:
        """Show the finished page of the run."""
        self._server.show(content)

    def step(self) -> None:
        """Send the newest row."""
        row = self._row() if self._words is not None else None
        if row is None:
            return

        def add() -> dict[str, Any]:
            if self._count % self._stride == 0:
                self._rows.append(row)
            self._count += 1
            if len(self._rows) > _ROWS:
                self._rows, self._stride = self._rows[::2], 2 * self._stride
            return {"rows": [row]}

        self._server.send(add)

    def _row(self) -> list[float] | None:
        """Return time and values of the row in the memory, if it is new and whole."""
        assert self._words is not None
        count = float(self._words[0])
        row = self._words.copy()
        if count == self._seen or count % 2.0 or not count == row[0] == self._words[0]:
            return None
        self._seen = count
        assert HEAD == 2
        return row[1:].tolist()


def main() -> None:
    """Serve until the pipe closes."""
    parent = Parent()
    with suppress(AttributeError, OSError):
        os.nice(5)  # the run comes first

    try:
        server = PageServer(int(sys.argv[1]) if sys.argv[1] else None)
    except VdfmuError as error:
        parent.reply({"error": str(error)})
        return
    drawer = ViewServer(server)
    parent.reply({"address": server.address})
    tasks: queue.Queue[tuple[str, tuple[Any, ...]]] = queue.Queue()

    def read() -> None:
        for request in parent.requests():
            tasks.put(pickle.loads(request))
        os._exit(0)

    threading.Thread(target=read, daemon=True).start()
    clients, there = 0, clock.monotonic()
    while True:
        with suppress(queue.Empty):
            name, arguments = tasks.get_nowait()
            getattr(drawer, name)(*arguments)
        drawer.step()
        now, connected = clock.monotonic(), server.clients
        there = now if connected else there
        if connected != clients and (connected or now > there + _GONE):
            clients = connected
            parent.reply(clients)
        clock.sleep(PERIOD)


if __name__ == "__main__":
    main()
