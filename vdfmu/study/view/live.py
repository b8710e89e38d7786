"""`LiveView`: a run in progress in a browser, drawn by a separate process."""

from __future__ import annotations

import signal
import sys
import tempfile
import threading
import time as clock
from collections.abc import Callable, Mapping, Sequence
from contextlib import ExitStack, suppress
from pathlib import Path
from typing import Any, Self

import numpy as np

from vdfmu.arm.robot import Robot
from vdfmu.base.arrays import Floats
from vdfmu.base.errors import UsageError, VdfmuError
from vdfmu.base.files import temporary_folder
from vdfmu.base.interrupt import InterruptGuard
from vdfmu.base.process import Child
from vdfmu.engine.results.results import Results
from vdfmu.engine.run import mapped
from vdfmu.study.run.scene import arm_of
from vdfmu.study.view.server import PERIOD

SIGNALS = ("plant.q", "trajectory.q_d", "controller.tau", "feedforward.tau_m", "plant.kappa")
"""Drawn arrays; the first is needed."""
HEAD = 2
"""Words before the values of a row: the count of its begins and ends, and its time."""
_MOST = 10_001
"""Most rows of the finished run that are sent."""


class LiveView:
    """The arm of a run in a browser, during and after the run.

    A separate process serves the page of the run, and sends it at most 30 rows a second from memory that it shares with
    the run. The run waits neither for it nor for a browser, and continues without it.

    Parameters
    ----------
    port : int, optional
        Port on loopback; default a free one.
    arm : Robot or mapping, optional
        Arm of a system that does not name it; for a mapping see :func:`vdfmu.study.run.scene.arm_of`.
    say : callable, optional
        Takes the address, and notes on missing parts of the view.

    Raises
    ------
    UsageError
        If the port is taken.
    VdfmuError
        If the process cannot be started.

    Examples
    --------
    >>> with vdfmu.LiveView() as live:
    ...     results = vdfmu.run("tracking", observer=live, pace=1)
    ...     live.stay()
    """

    def __init__(
        self, *, port: int | None = None, arm: Robot | Mapping[str, Any] | None = None,
        say: Callable[[str], None] = print,
    ) -> None:  # fmt: skip
        self.wanted: Sequence[str] = [f"{name}[*]" for name in SIGNALS]
        self.period = PERIOD
        self._arm, self._say = arm_of(arm, {}) if isinstance(arm, Robot) else arm, say
        self._words: Floats | None = None
        self._title, self._stop_time = "", 0.0
        self._clients, self._said, self._ended = 0, "", False
        self._stack = ExitStack()
        try:
            self._start(port)
        except BaseException:
            self.close()
            raise

    def _start(self, port: int | None) -> None:
        self._folder = Path(self._stack.enter_context(temporary_folder("vdfmu-view-")))
        self._child = Child("vdfmu.study.view.live_server", "" if port is None else str(port), limit=np.inf)
        self._reader = threading.Thread(target=self._listen, daemon=True)
        self._stack.callback(self._stop)
        try:
            first = self._child.take()
        except EOFError:
            raise VdfmuError(f"the process of the view has ended: {self._stop()}") from None
        if "error" in first:
            raise UsageError(first["error"])
        self.address: str = first["address"]
        """Address for a browser."""
        self._reader.start()
        self._say(f"Live view: {self.address}")

    def _listen(self) -> None:
        with suppress(EOFError, ValueError, TypeError):
            while True:
                self._clients = int(self._child.take())

    def _stop(self) -> str:
        """End the process; return the end of its output."""
        if not self._ended:
            self._ended = True
            self._child.kill()
            if self._reader.ident is not None:
                self._reader.join()
            self._said = self._child.end()[2].strip()
        return self._said

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def close(self) -> None:
        """End the view."""
        self._stack.close()

    @property
    def open(self) -> bool:
        """Whether the view can be opened."""
        return self._child.alive

    def _send(self, name: str, *arguments: Any) -> None:
        if self.open:  # else it has ended, which does not concern the run
            self._child.send((name, arguments))

    def begin(self, names: Sequence[str], about: Mapping[str, Any]) -> None:
        """Show the arm of a run; see `vdfmu.engine.masters.observer.Observer`."""
        arm = about.get("arm") or self._arm
        title = self._title = str(about.get("scenario") or about.get("system") or "")
        self._words = None
        joints = {f"{SIGNALS[0]}[{i}]" for i in range(1, 1 + len(arm["types"]))} if arm else set[str]()
        if arm is None or not joints <= {*names}:
            why = f"there is no signal {SIGNALS[0]} of its joints"
            why = "no robot is known; --robot, or arm of LiveView, names one" if arm is None else why
            text = f"There is no arm to show: {why}."
            self._say(f"note: live view: {text}")
            self._send("words", title, text)
            return
        handle, path = tempfile.mkstemp(dir=self._folder)
        with open(handle, "wb") as file:
            file.write(bytes(8 * (HEAD + len(names))))
        self._words, self._stop_time = mapped(Path(path)), float(about["stop"])
        self._facts = {**about, "arm": arm}
        self._send("begin", title, self._facts, list(names), path, float(about["start"]), self._stop_time)

    def row(self, time: float, values: Floats) -> None:
        """Take a row."""
        words = self._words
        if words is not None:
            words[0] += 1.0
            words[1] = time
            words[HEAD:] = values
            words[0] += 1.0

    def end(self, results: Results) -> None:
        """Show the recorded rows, on the page of a run."""
        if self._words is not None and len(results):
            few = results.thinned(_MOST)
            bare = Results(few.time, few.signals, {kind: np.array(array) for kind, array in few.data.items()})
            self._send("end", self._title, bare, self._facts | results.summary, self._stop_time)

    def page(self, path: Path) -> None:
        """Show the page that a run has written."""
        if self._words is not None:
            self._send("page", path.read_bytes())

    def stay(self) -> None:
        """Wait for Ctrl-C in a terminal; without a terminal, until no browser shows the view."""
        terminal = sys.stdin is not None and sys.stdin.isatty()
        if not self.open:
            self._say(f"note: live view: it has ended: {self._stop() or 'it was killed'}")
        if not self.open or not (terminal or self._clients):
            return
        until = "Ctrl-C" if terminal else "no browser has it open"
        self._say(f"The view stays until {until}: {self.address}")
        with InterruptGuard() as guard:
            while not guard.number and self.open and (terminal or self._clients):
                clock.sleep(0.1)
            if guard.number == signal.SIGINT:
                guard.number = 0
