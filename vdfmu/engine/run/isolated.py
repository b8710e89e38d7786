"""The components of one run in a process of their own, which they may crash, end, or never return in.

Master and process share the memory of the `Exchange`: a step is one message to the process and one back, whatever the
number of components. In that memory the process also notes which component it calls, so that the master can name it.
Messages to the process are pickled; what comes back is JSON, because code of the FMUs might have written it. What the
FMUs print is shown on the error output, with what a terminal would act on written out.
"""

from __future__ import annotations

import json
import math
import mmap
import os
import pickle
import select
import signal
import struct
import subprocess
import threading
from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from pathlib import Path
from time import monotonic
from typing import Any

import numpy as np

from vdfmu.base.arrays import Floats
from vdfmu.base.errors import CosimError, UsageError, VdfmuError
from vdfmu.base.process import Listener, end_group, started
from vdfmu.engine.fmu.messages import LogMessage, MessageBox
from vdfmu.engine.masters.exchange import Exchange, words_of
from vdfmu.engine.plan.checked import Checked

REQUEST = struct.Struct("<Iddd")
"""Length of what follows, or 0 and time, step and stop of `advance`."""
REPLY = struct.Struct("<I")
CALLS = "calls"
"""File beside the memory: a line for each function of a component, from before its first call on. While the function
runs, the word `running` of the exchange is the number of the line, from 1, and after it has returned minus that."""
_LARGEST = 2**28
"""Bytes of the largest answer that is read."""
_BLOCK = 2**20
"""Bytes that are read at once at most."""
_TICK = 0.1
"""Interval at which the master looks after the process [s]."""
_START = 60.0
"""Time that the process has to start, beyond the limit [s]."""
_PATIENCE = 0.5
"""Time that a step has to end after Ctrl-C [s]."""
_FAREWELL = 5.0
"""Time that the process has to end after its components are freed [s]."""


class Limits:
    """What components may take: `time` [s] for a step, and for loading and so on each, and `memory` [MB].

    Default: 300 s, and half of the machine's memory.
    """

    def __init__(self, time: float | None = None, memory: float | None = None) -> None:
        self.time = 300.0 if time is None else time
        self.memory = _half_of_memory() if memory is None else memory
        for name, value, unit in (("time_limit", self.time, "s"), ("memory_limit", self.memory, "MB")):
            if not value > 0.0:
                raise UsageError(f"{name} must be positive, got {value:g} {unit}")


def _half_of_memory() -> float:
    """Return half of the machine's memory [MB]; infinite where it cannot be asked."""
    try:
        return os.sysconf("SC_PHYS_PAGES") * os.sysconf("SC_PAGE_SIZE") / 2**21
    except (AttributeError, ValueError, OSError):
        return math.inf


class Isolated:
    """`Components` and their stepper, in a process of their own."""

    server = "vdfmu.engine.run.isolated_server"
    """The module that runs there."""

    def __init__(
        self, checked: Checked, folders: Mapping[str, Path], box: MessageBox, folder: Path, limits: Limits
    ) -> None:
        self.box, self.limits = box, limits
        self._names = list(checked.descriptions)
        self._memory = folder / "memory"
        self._memory.write_bytes(bytes(8 * words_of(checked)))
        self.exchange = Exchange(checked, {}, box, mapped(self._memory))
        self.content = pickle.dumps((checked, dict(folders)))
        self.pressed: Callable[[], bool] = lambda: False
        self._process: subprocess.Popen[bytes] | None = None
        self._since, self._late, self._cut_off, self._stepping = math.inf, False, False, False
        self._done, self._gone = threading.Event(), threading.Event()

    def load(self) -> None:
        """Start the process, load the libraries and create the instances."""
        self.start()
        self.take()
        self.ask("load", self.content)

    def start(self) -> None:
        """Start the process; that it has started is its first answer."""
        self._process = started(self.server, str(self._memory), str(self.limits.memory))
        assert self._process.stderr is not None
        self._listener = Listener(self._process.stderr, show=True)
        assert self._process.stdout is not None
        if hasattr(select, "poll"):
            self._poll = select.poll()
            self._poll.register(self._process.stdout, select.POLLIN)
        threading.Thread(target=self._look_after, args=(self._process,), daemon=True).start()
        self._since = monotonic() + _START

    def initialize(self, *arguments: Any) -> None:
        """See `Components.initialize`."""
        self.box.time = arguments[0]
        self.ask("initialize", *arguments)

    def couple(self, *arguments: Any) -> Isolated:
        """See `Components.couple`."""
        self.ask("couple", *arguments)
        self._stepping = True
        return self

    def advance(self, time: float, step: float, stop: float) -> None:
        """Step all components."""
        self.post(REQUEST.pack(0, time, step, stop))
        self.take()

    def facts(self) -> dict[str, Any]:
        """Return what the summary says of the steps; nothing if the process is gone."""
        return {} if self._process is None else self.ask("facts")

    def notes(self) -> list[str]:
        """Return what is worth knowing after the run."""
        return self.ask("notes")

    def keep(self, names: Sequence[str]) -> None:
        """See `Components.keep`."""
        self.ask("keep", names)

    def look(self, steps: Mapping[str, float], times: Sequence[float], end: float) -> Any:
        """See `Components.look`."""
        return self.ask("look", steps, times, end)

    def close(self) -> CosimError | None:
        """Free all, end the process, and return the first failure in that."""
        failure = None
        self._stepping = False
        self.pressed = lambda: False
        try:
            if self._process is not None and self._since == math.inf:
                failure = self.ask("close", self.box.time)
                failure = None if failure is None else CosimError(*failure)
            elif self._process is not None:  # cut off in a call
                end_group(self._process)
        except CosimError as error:
            failure = error
        finally:
            self._end()
        self.box.flush()
        return failure

    def ask(self, name: str, *arguments: Any) -> Any:
        """Have the process call a method of its `Server`."""
        self.post_call(name, *arguments)
        return self.take()

    def post_call(self, name: str, *arguments: Any) -> None:
        """Send the request that it call a method."""
        request = pickle.dumps((name, arguments))
        self.post(REQUEST.pack(len(request), 0.0, 0.0, 0.0) + request)

    def post(self, request: bytes) -> None:
        """Send a request; if the process has ended, its answer says so."""
        process = self._process
        assert process is not None
        assert process.stdin is not None
        self._since = monotonic()
        with suppress(BrokenPipeError):
            process.stdin.write(request)
            process.stdin.flush()

    def take(self) -> Any:
        """Wait for the answer to a request; CosimError if it failed or the process has ended."""
        process = self._process
        assert process is not None
        answer: bytes | bytearray = b""
        head = self._read(process, REPLY.size)
        if len(head) == REPLY.size:
            (size,) = REPLY.unpack(head)
            if not size:
                self._since = math.inf
                return None
            answer = self._read(process, size) if size <= _LARGEST else b""
        try:
            reply = json.loads(answer)
        except ValueError:
            lost = self.lost()
            raise KeyboardInterrupt if self._cut_off else lost from None
        self._since = math.inf
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

    def _read(self, process: subprocess.Popen[bytes], size: int) -> bytes | bytearray:
        """Read from the process; less if it has ended, though one that it has left may hold the pipe open."""
        assert process.stdout is not None
        descriptor, found = process.stdout.fileno(), bytearray()
        while len(found) < size:
            if hasattr(select, "poll"):
                gone = self._gone.is_set()  # looked at first: what it wrote before its end is read
                if not self._poll.poll(0.0 if gone else 1e3 * _TICK):
                    if gone:
                        break
                    continue
            block = os.read(descriptor, min(size - len(found), _BLOCK))
            if not block:
                break
            found += block
        return found

    def _called(self) -> tuple[str, str]:
        """Return the component and the function that the process called last; empty if it called none."""
        number = abs(self.exchange.running.value)
        with suppress(OSError, ValueError, IndexError):  # code of the component may have written there, too
            lines = self._memory.with_name(CALLS).read_text(encoding="utf-8", errors="replace").splitlines()
            position, call = lines[number - 1].split(" ") if number else ("", "")
            return self._names[int(position)], call
        return "", ""

    def lost(self) -> CosimError:
        """Return the error of a process that has ended, or sends what is not an answer."""
        code, peak = self._end()
        unit, call = self._called()
        time = self.exchange.clock.value if self._stepping else self.box.time
        if not self._late and code < 0:
            with suppress(ValueError):
                code = signal.Signals(-code).name
        if not unit:
            return self.idle(time, code)
        if self.exchange.running.value < 0:
            what = f"did not go on within {self.limits.time:g} s" if self._late else f"ended ({code})"
            why = f"the process {what} after this call had returned: it left damage, or vdfmu has a fault"
        elif self._late:
            why = f"no return within {self.limits.time:g} s; a longer time_limit (simulate --time-limit) gives it more"
        elif isinstance(code, str):
            why = f"the component crashed the process ({code})"
        else:
            why = f"the component ended the process (exit code {code})"
        if peak > 0.5 * self.limits.memory:
            why += f", of which the memory had reached {peak:.0f} MB of {self.limits.memory:.0f} MB (memory_limit)"
        return CosimError(unit, call, time, why)

    def idle(self, time: float, code: int | str) -> CosimError:
        """Return the error of a process that has ended while it called no component; `code` may name a signal."""
        return CosimError("components", "start of their process", time, f"it ended with code {code}")

    def _look_after(self, process: subprocess.Popen[bytes]) -> None:
        """Pass Ctrl-C on, and end a process that takes too long, or those that it has left and that hold its pipes."""
        pressed = math.inf
        while not self._done.wait(_TICK):
            if self.pressed():
                self.exchange.pressed.value = 1
                pressed = min(pressed, monotonic())
            self._late = monotonic() - self._since > self.limits.time
            self._cut_off = monotonic() - max(self._since, pressed) > _PATIENCE
            if self._late or self._cut_off or _has_ended(process):
                end_group(process)
                self._gone.set()
                self.gone()
                return

    def gone(self) -> None:
        """Note in another thread that the process ended before its time."""

    def _end(self) -> tuple[Any, float]:
        """End the process and those that it started; return its exit code and the largest memory that it had [MB]."""
        process, self._process = self._process, None
        self._done.set()
        if process is None:
            return 0, 0.0
        for pipe in (process.stdin, process.stdout):
            with suppress(OSError):
                pipe.close()  # pyright: ignore[reportOptionalMemberAccess]
        timer = threading.Timer(_FAREWELL, end_group, [process])
        timer.start()
        try:
            if not hasattr(os, "wait4"):
                return process.wait(), 0.0
            _, status, usage = os.wait4(process.pid, 0)
            process.returncode = os.waitstatus_to_exitcode(status)
            return process.returncode, usage.ru_maxrss / 1024
        finally:
            timer.cancel()
            end_group(process)
            self._listener.finish()


def _has_ended(process: subprocess.Popen[bytes]) -> bool:
    """Return whether a process has ended, and leave its exit code to be asked for; False where that is impossible."""
    if not hasattr(os, "waitid"):  # Windows, and macOS before Python 3.13
        return False
    with suppress(ChildProcessError):  # its exit code has just been asked for
        return os.waitid(os.P_PID, process.pid, os.WEXITED | os.WNOHANG | os.WNOWAIT) is not None
    return True


def mapped(path: Path) -> Floats:
    """Return the shared memory."""
    with open(path, "r+b") as file:
        return np.frombuffer(mmap.mmap(file.fileno(), 0), np.float64)
