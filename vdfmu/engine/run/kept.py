"""Many runs of a package: its components stay loaded between them."""

from __future__ import annotations

import os
import sys
import threading
from contextlib import nullcontext
from pathlib import Path
from typing import Any, Unpack

from vdfmu.base.interrupt import InterruptGuard
from vdfmu.engine.options import RowOptions, SimulateOptions
from vdfmu.engine.package.archive import stamp_of
from vdfmu.engine.results.results import Results
from vdfmu.engine.run.simulator import Simulator, simulate

_ROWS = frozenset(RowOptions.__annotations__)
_PLAIN = (str, int, float, type(None))
"""Types of options that can be compared."""


class KeptRuns:
    """Runs of a package, each like :func:`vdfmu.engine.run.simulate`.

    Components stay loaded while the package and the options are the same but for values, times and rows. They are
    terminated after each run and reset before the next. Isolated and foreign components, and FMUs that allow one
    instance in a process, are freed after each run. So are all components in a worker of a pool of multiprocessing: the
    end of the pool kills it.
    """

    def __init__(self, path: Path) -> None:
        self._path, self._lock, self._loaded, self._process = path, threading.Lock(), _Loaded(), 0

    def run(self, **options: Unpack[SimulateOptions]) -> Results:
        """Run the package; for options and errors see :func:`vdfmu.engine.run.simulate`."""
        rows: Any = {name: value for name, value in options.items() if name in _ROWS}
        fixed: Any = {name: value for name, value in options.items() if name not in _ROWS}
        parameters, log, files = fixed.pop("parameters", None), fixed.get("log"), fixed.get("inputs")
        plain = files is None and all(isinstance(value, _PLAIN) or value is log for value in fixed.values())
        if plain and not _is_worker() and self._lock.acquire(False):
            try:
                if self._process != os.getpid():
                    from multiprocessing.util import Finalize  # takes long to import

                    self._process = os.getpid()
                    Finalize(self, self._loaded.close, exitpriority=0)  # in children of multiprocessing too
                simulator = self._loaded.simulator(self._path, fixed)
                if simulator.sizes.isdisjoint(parameters or ()):
                    with InterruptGuard() if simulator.lasts else nullcontext():  # one for the others within it
                        results = simulator.run(parameters=parameters, **rows)
                        simulator.rest()
                    return results
            finally:
                self._lock.release()
        return simulate(self._path, **options)


def _is_worker() -> bool:
    """Whether the parent process may kill this one, so that no folders are removed at its end."""
    process = sys.modules.get("multiprocessing.process")  # takes long to import
    return process is not None and process.current_process().daemon


class _Loaded:
    """A simulator in its block, and the facts that it depends on."""

    def __init__(self) -> None:
        self._known: Any = None
        self._simulator: Simulator | None = None

    def simulator(self, path: Path, options: Any) -> Simulator:
        """Return the simulator of a package with its options."""
        wanted = os.getpid(), stamp_of(path), options
        if self._simulator is None or self._known != wanted:
            self.close()
            self._simulator, self._known = Simulator(path, **options).__enter__(), wanted
        return self._simulator

    def close(self) -> None:
        """Free the simulator, unless a parent process has made it."""
        simulator, self._simulator = self._simulator, None
        if simulator is not None and self._known[0] != os.getpid():
            _inherited.append(simulator)
        elif simulator is not None:
            simulator.__exit__(None, None, None)


_inherited: list[Simulator] = []
"""Simulators of a parent process; at their end they would remove its folders."""
