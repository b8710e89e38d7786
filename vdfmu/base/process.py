"""Processes for code that may crash, exit or hang: their start, limits, output, messages and end.

Each message is preceded by its length. Requests are pickled. Replies are JSON, because untrusted code may have written
them.
"""

from __future__ import annotations

import atexit
import codecs
import io
import json
import math
import os
import pickle
import select
import signal
import struct
import subprocess
import sys
import threading
import traceback
from collections.abc import Callable, Iterator
from contextlib import suppress
from ctypes import CDLL
from importlib import import_module
from time import monotonic
from typing import IO, Any, NoReturn

from vdfmu.base.files import read_json
from vdfmu.base.text import shown

with suppress(ImportError):  # Windows has none
    import_module("resource")  # os.wait4 imports it, which fails when memory is short

KEPT = 4096
"""Number of bytes kept from the end of the output."""
SHOWN = 2**16
"""Number of bytes at the start of the output that are shown at once."""
ONE_THREAD = {"OPENBLAS_NUM_THREADS": "1"}
"""Environment for numpy and scipy: one thread, because with small matrices several only wait for each other."""
SIZE = struct.Struct("<I")
"""Length of the message that follows, 0 for an empty message."""
_BLOCK, _OUTPUT_BLOCK = 2**20, 2**16
"""Largest number of bytes in one read of replies or output."""
_LARGEST = 2**30
"""Largest reply that is read [byte]."""
_PDEATHSIG = 1
"""Option of prctl that sets the signal sent when the starting thread ends."""
_JOIN = 1.0
"""Time limit [s] for output after the process has ended: an escaped child may hold the pipe open."""
_TICK = 0.1
"""Interval [s] at which the watching thread looks."""
_FAREWELL = 5.0
"""Time limit [s] for the process to end after its pipe is closed."""
_OUTSIDE = ("SIGHUP", "SIGINT", "SIGKILL", "SIGTERM")
"""Signals that come from users and the system; other signals are caused by faulty code."""
_contained = False


def is_contained() -> bool:
    """Whether this process is one for code that may crash, exit or hang."""
    return _contained


def contained(main: Callable[..., None], *arguments: Any) -> NoReturn:
    """Run the task of a process for foreign code, and end the process without the destructors of libraries.

    After the task, those of pythonfmu 0.7.0 write into memory that they have freed. Files are still flushed, and
    functions registered with `atexit` are still called.
    """
    global _contained
    _contained, code = True, 0
    try:
        main(*arguments)
    except SystemExit as error:
        code = error.code if isinstance(error.code, int) else int(error.code is not None)
        if isinstance(error.code, str):
            print(error.code, file=sys.stderr)
    except BaseException:
        traceback.print_exc()
        code = 1
    with suppress(Exception):  # foreign code may have replaced or closed them
        atexit._run_exitfuncs()  # pyright: ignore[reportPrivateUsage]
        sys.stdout.flush()
        sys.stderr.flush()
    os._exit(code)


def started(module: str, *arguments: str, talks: bool = True) -> subprocess.Popen[bytes]:
    """Start a module of this package in a new process and session, with pipes; without `talks` only the error pipe."""
    way = subprocess.PIPE if talks else subprocess.DEVNULL
    return subprocess.Popen(
        [sys.executable, "-P", "-m", module, *arguments],
        stdin=way,
        stdout=way,
        stderr=subprocess.PIPE,
        env={**ONE_THREAD, **os.environ, "PYTHONPATH": os.pathsep.join(filter(None, sys.path))},
        start_new_session=True,
    )


def limit(kind: str, size: int, lasting: bool = True) -> None:
    """Limit a resource of this process if the system supports it: ``AS``, ``DATA``, ``FSIZE``, ``CORE``.

    A limit that is not `lasting` can be raised again.
    """
    if sys.platform != "win32":
        import resource

        number = getattr(resource, f"RLIMIT_{kind}")
        _, most = resource.getrlimit(number)
        size = size if most == resource.RLIM_INFINITY else min(size, most)
        with suppress(OSError, ValueError):  # macOS cannot limit the address space
            resource.setrlimit(number, (size, size if lasting else most))


def end_group(process: subprocess.Popen[bytes], patience: float = 0.0) -> None:
    """Kill a process of `started` and its children. First it gets `patience` [s] to end children in other sessions."""
    with suppress(OSError, subprocess.TimeoutExpired):
        if patience and process.poll() is None:
            process.terminate()
            process.wait(patience)
    with suppress(OSError):  # all have ended
        if hasattr(os, "killpg"):
            os.killpg(process.pid, signal.SIGKILL)
        else:
            process.kill()


def ending(code: int) -> tuple[str, bool]:
    """Return how a process ended, ``SIGSEGV`` or ``exit code 3``, and whether it was killed from outside."""
    with suppress(ValueError):
        name = signal.Signals(-code).name
        return name, name in _OUTSIDE
    return f"exit code {code}", False


class Listener:
    """Thread that reads the output of a process, so that the process never blocks, and closes the pipe at its end.

    `show`: copy the first `SHOWN` bytes to the error output and, if the output is longer, at the end its last `KEPT`
    bytes. Control characters are escaped.
    """

    def __init__(self, stream: IO[bytes], show: bool = False) -> None:
        self._count, self._tail = 0, bytearray()
        self._show = show
        self._text = io.IncrementalNewlineDecoder(codecs.getincrementaldecoder("utf-8")("replace"), True)
        self._thread = threading.Thread(target=self._listen, args=(stream,), daemon=True)
        self._thread.start()

    def _listen(self, stream: IO[bytes]) -> None:
        with stream:
            while block := os.read(stream.fileno(), _OUTPUT_BLOCK):
                first = block[: max(0, SHOWN - self._count)]
                self._count += len(block)
                self._tail += block
                del self._tail[:-KEPT]
                self._pass_on(self._text.decode(first))

    def _pass_on(self, text: str) -> None:
        if self._show and text:
            with suppress(OSError, ValueError, AttributeError):  # the error output is closed, or missing
                sys.stderr.write(shown(text))
                sys.stderr.flush()

    def finish(self) -> str:
        """Return the last `KEPT` bytes, after the process has ended."""
        self._thread.join(_JOIN)
        more = self._count - SHOWN
        if more > 0:
            left_out = max(0, more - KEPT)
            words = self._tail[-more:].decode(errors="replace")
            self._pass_on(f"\n... ({left_out} bytes left out)\n{words}" if left_out else words)
        self._show = False
        return self._tail.decode(errors="replace")


class Child:
    """A process whose module uses :class:`Parent`, seen from the process that started it.

    A thread kills the process if a reply takes longer than `limit` [s], or if `stop`, called every tenth of a second,
    returns True. `show` copies the output.
    """

    def __init__(
        self, module: str, *arguments: str, limit: float, show: bool = False, stop: Callable[[], bool] = lambda: False
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
        """`since`: time of the last request, infinite after its reply."""
        self._stop = stop
        self._done, self._gone = threading.Event(), threading.Event()
        threading.Thread(target=self._watch, daemon=True).start()

    def send(self, message: Any) -> None:
        """Send a message."""
        content = pickle.dumps(message)
        self.post(SIZE.pack(len(content)) + content)

    def post(self, request: bytes) -> None:
        """Send bytes. If the process has ended, `take` reports it."""
        self.since = monotonic()
        with suppress(OSError):
            self._requests.write(request)
            self._requests.flush()

    def take(self) -> Any:
        """Wait for a reply, None if empty. EOFError if the process has ended or its reply is not JSON."""
        head = self._read(SIZE.size)
        size = SIZE.unpack(head)[0] if len(head) == SIZE.size else _LARGEST + 1
        try:
            message = read_json(bytes(self._read(size)) if size <= _LARGEST else b"") if size else None
        except ValueError:
            raise EOFError from None
        self.since = math.inf
        return message

    def _read(self, size: int) -> bytes | bytearray:
        """Read bytes, fewer if the process has ended. Its children may still hold the pipe open."""
        descriptor, content = self._replies.fileno(), bytearray()
        while len(content) < size:
            if hasattr(select, "poll"):
                gone = self._gone.is_set()  # checked before the poll, so that all output before the end is read
                if not self._poll.poll(0.0 if gone else 1e3 * _TICK):
                    if gone:
                        break
                    continue
            block = os.read(descriptor, min(size - len(content), _BLOCK))
            if not block:
                break
            content += block
        return content

    def _watch(self) -> None:
        """Kill the process if it is late or must stop. If it has ended, kill children that hold its pipes."""
        while not self._done.wait(_TICK):
            stopped = self._stop()
            self.late = self.late or monotonic() - self.since > self.limit
            if self.late or stopped or self._has_ended():
                self.kill()
                self._gone.set()
                return

    def _has_ended(self) -> bool:
        """Return whether the process has ended, without collecting its exit code. False if this is unknown."""
        if not hasattr(os, "waitid"):  # Windows, and macOS before Python 3.13
            return not hasattr(os, "wait4") and self._process.poll() is not None
        with suppress(ChildProcessError):  # its exit code has just been collected
            return os.waitid(os.P_PID, self._process.pid, os.WEXITED | os.WNOHANG | os.WNOWAIT) is not None
        return True

    @property
    def alive(self) -> bool:
        """Whether the process still runs."""
        return not (self._done.is_set() or self._gone.is_set() or self._has_ended())

    def kill(self) -> None:
        """Kill the process and its children, from any thread."""
        end_group(self._process)

    def end(self) -> tuple[int, float, str]:
        """Let the process end and kill its children. Return its exit code, peak memory [MB] or 0, and last output."""
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
            output = self._listener.finish()
        return code, peak, output


def end_with_parent() -> None:
    """Make this process end with the thread that started it, which only Linux supports."""
    if sys.platform == "linux":
        CDLL(None).prctl(_PDEATHSIG, signal.SIGKILL)


class Parent:
    """The starting process, seen from the started one, a :class:`Child`.

    It takes over the pipes: what the code prints goes to the error output, and the input is empty. On Linux this
    process ends with the thread that started it.
    """

    def __init__(self) -> None:
        self._requests, self._replies = os.fdopen(os.dup(0), "rb"), os.dup(1)
        os.dup2(os.open(os.devnull, os.O_RDONLY), 0)
        os.dup2(2, 1)
        end_with_parent()

    def read(self, size: int) -> bytes:
        """Read bytes, fewer at the end."""
        return self._requests.read(size)

    def requests(self) -> Iterator[bytes]:
        """Yield the unpickled messages until the end, an empty text for an empty message."""
        while len(head := self.read(SIZE.size)) == SIZE.size:
            yield self.read(SIZE.unpack(head)[0])

    def reply(self, message: Any = None) -> None:
        """Send a reply. Arrays and numbers of numpy become lists and numbers. Exit if the parent no longer exists."""
        content = b"" if message is None else json.dumps(message, default=lambda x: x.tolist()).encode()
        content = SIZE.pack(len(content)) + content
        try:
            while content:
                content = content[os.write(self._replies, content) :]
        except BrokenPipeError:
            raise SystemExit from None
