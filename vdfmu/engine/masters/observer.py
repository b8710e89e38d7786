"""Observers and visitors of a run in progress."""

from __future__ import annotations

import time as clock
from collections.abc import Callable, Container, Mapping, Sequence
from pathlib import Path
from typing import Any, Protocol

import numpy as np

from vdfmu.base.arrays import Floats
from vdfmu.engine.masters.exchange import Exchange
from vdfmu.engine.plan.grid import Grid
from vdfmu.engine.results.results import Results


class Observer(Protocol):
    """Receives rows of a run, which waits for it. A class needs ``row``; the other members are optional."""

    wanted: Sequence[str]
    """Names of real signals that it receives, with ``*`` for any text; they need not exist. Default: all."""
    period: float
    """Wall time between two rows [s], at least; 0, the default, for every row."""

    def begin(self, names: Sequence[str], about: Mapping[str, Any]) -> None:
        """Take the names of the existing signals, and the facts of the run."""
        ...

    def row(self, time: float, values: Floats) -> None:
        """Take the values (k,) at a time [s]; the array is the observer's."""
        ...

    def end(self, results: Results) -> None:
        """Take all rows of the run, which may have failed."""
        ...

    def page(self, path: Path) -> None:
        """Take the page that :func:`vdfmu.run` has written of the finished run; the file moves afterwards."""
        ...


class Visitor(Protocol):
    """Sees the components of a run at some of its rows, to query them; it leaves them unchanged."""

    def rows(self, n: int) -> Container[int]:
        """Return the rows of a run of n steps that it wants to see."""
        ...

    def visit(self, components: Any, time: float, step: float) -> None:
        """Take the components, as they are at a time [s], and the communication step [s]."""
        ...


def visited(visitor: Visitor, components: Any, grid: Grid, store: Callable[[int], None]) -> Callable[[int], None]:
    """Return a function that stores a row k and shows the components to its visitor."""
    rows = visitor.rows(grid.n)

    def storing(k: int) -> None:
        store(k)
        if k in rows:
            visitor.visit(components, grid.time(k), grid.step)

    return storing


def observed(
    observer: Observer, exchange: Exchange, about: Mapping[str, Any], grid: Grid, store: Callable[[int], None]
) -> Callable[[int], None]:
    """Return a function that stores row k and shows it to the observer when due."""
    names, memory, places = exchange.reals(getattr(observer, "wanted", ("*",)))
    getattr(observer, "begin", lambda names, about: None)(names, about)
    period, due, now = getattr(observer, "period", 0.0), 0.0, clock.perf_counter
    columns = np.array(places, np.intp)

    def storing(k: int) -> None:
        nonlocal due
        store(k)
        if now() >= due:
            observer.row(grid.time(k), memory.take(columns))
            due = now() + period

    return storing
