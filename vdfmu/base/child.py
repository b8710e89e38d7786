"""`Child`: a module of this package in a process of its own, which code there may crash, end, or never return in.

Each message comes after its length: pickled to the process, JSON from it, because any code there might have written it.
"""

from __future__ import annotations

import json
import math
import os
import pickle
import select
import struct
import threading
from collections.abc import Callable, Iterator
from contextlib import suppress
from time import monotonic
from typing import Any

from vdfmu.base.process import Listener, end_group, private_pipes, started

SIZE = struct.Struct("<I")
"""Length of the message that follows; a message of length 0 is the whole message."""
_LARGEST = 2**30
"""Bytes of the largest answer that is read."""
_BLOCK = 2**20
"""Bytes that are read at once at most."""
_TICK = 0.1
"""Interval at which the process is looked after [s]."""
_FAREWELL = 5.0
"""Time that the process has to end after its pipe is closed [s]."""


class Child:
    """The process of a module, in which :class:`Parent` is used, as the one that started it has it.

    An answer may take `limit` [s]; then the process is ended. `show` passes on what it prints. Every tenth of a second
    `stop` is called, in another thread, and says whether to end the process; `gone` is called there when it has ended
    before `end`.
    """

    def __init__(
        self,
        module: str,
        *arguments: str,
        limit: float,
        show: bool = False,
        stop: Callable[[], bool] = lambda: False,
        gone: Callable[[], None] = lambda: None,
    ) -> None:
        self._process = process = started(module, *arguments)
        assert process.stdin is not None
        assert process.stdout is not None
        assert process.stderr is not None
        self._requests, self._replies = process.stdin, process.stdout
        self._listener = Listener(process.stderr, show)
        if hasattr(select, "poll"):
            self._poll = select.poll()
            self._poll.register(process.stdout, select.POLLIN)
        self.limit, self.late, self.since = limit, False, monotonic()
        """`since`: when the answer that is awaited was asked for, infinite if none is."""
        self._stop, self._report = stop, gone
        self._done, self._gone = threading.Event(), threading.Event()
        threading.Thread(target=self._look_after, daemon=True).start()

    def send(self, message: Any) -> None:
        """Send a message."""
        content = pickle.dumps(message)
        self.post(SIZE.pack(len(content)) + content)

    def post(self, request: bytes) -> None:
        """Send bytes; if the process has ended, its answer says so."""
        self.since = monotonic()
        with suppress(OSError):
            self._requests.write(request)
            self._requests.flush()

    def take(self) -> Any:
        """Wait for an answer, None for one of length 0; EOFError if the process has ended, or wrote something else."""
        head = self._read(SIZE.size)
        size = SIZE.unpack(head)[0] if len(head) == SIZE.size else _LARGEST + 1
        try:
            message = json.loads(self._read(size) if size <= _LARGEST else b"") if size else None
        except ValueError:
            raise EOFError from None
        self.since = math.inf
        return message

    def _read(self, size: int) -> bytes | bytearray:
        """Read from the process; less if it has ended, though one that it has left may hold the pipe open."""
        descriptor, found = self._replies.fileno(), bytearray()
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

    def _look_after(self) -> None:
        """End the process if it takes too long or is to stop, or those that it has left and that hold its pipes."""
        while not self._done.wait(_TICK):
            stopped = self._stop()
            self.late = self.late or monotonic() - self.since > self.limit
            if self.late or stopped or self._has_ended():
                self.kill()
                self._gone.set()
                self._report()
                return

    def _has_ended(self) -> bool:
        """Whether the process has ended, with its exit code left to be asked for; False where that is impossible."""
        if not hasattr(os, "waitid"):  # Windows, and macOS before Python 3.13
            return not hasattr(os, "wait4") and self._process.poll() is not None
        with suppress(ChildProcessError):  # its exit code has just been asked for
            return os.waitid(os.P_PID, self._process.pid, os.WEXITED | os.WNOHANG | os.WNOWAIT) is not None
        return True

    @property
    def alive(self) -> bool:
        """Whether the process still runs."""
        return not (self._done.is_set() or self._gone.is_set() or self._has_ended())

    def kill(self) -> None:
        """End the process and those that it started, from any thread."""
        end_group(self._process)

    def end(self) -> tuple[int, float, str]:
        """Let the process end, and end those that it started.

        Returns its exit code, the largest memory that it had [MB], 0 where that is not known, and the end of what it
        printed.
        """
        self._done.set()
        process, peak = self._process, 0.0
        for pipe in (self._requests, self._replies):
            with suppress(OSError):
                pipe.close()
        timer = threading.Timer(_FAREWELL, end_group, [process])
        timer.start()
        try:
            if hasattr(os, "wait4"):
                _, status, usage = os.wait4(process.pid, 0)
                process.returncode, peak = os.waitstatus_to_exitcode(status), usage.ru_maxrss / 1024
            code = process.wait()
        finally:
            timer.cancel()
            end_group(process)
            said = self._listener.finish()
        return code, peak, said


class Parent:
    """The other side, in the process: of a module that is a :class:`Child`."""

    def __init__(self) -> None:
        self._requests, self._replies = private_pipes()

    def read(self, size: int) -> bytes:
        """Read bytes; fewer at the end."""
        return self._requests.read(size)

    def requests(self) -> Iterator[bytes]:
        """Yield the messages, pickled, until there are no more; nothing for one of length 0."""
        while len(head := self.read(SIZE.size)) == SIZE.size:
            yield self.read(SIZE.unpack(head)[0])

    def reply(self, message: Any = None) -> None:
        """Answer; arrays and numbers of numpy become lists and numbers. Without a parent the process ends."""
        content = b"" if message is None else json.dumps(message, default=lambda x: x.tolist()).encode()
        content = SIZE.pack(len(content)) + content
        try:
            while content:
                content = content[os.write(self._replies, content) :]
        except BrokenPipeError:
            raise SystemExit from None
