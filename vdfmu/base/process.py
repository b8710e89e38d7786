"""Processes that may do anything: how they end with those that they started, and what is kept of their output."""

from __future__ import annotations

import codecs
import io
import os
import signal
import subprocess
import sys
import threading
from contextlib import suppress
from ctypes import CDLL
from typing import IO, BinaryIO

from vdfmu.base.text import shown

KEPT = 4096
"""Bytes of a process's output that are kept: the last."""
SHOWN = 2**16
"""Bytes of it that are shown as they come: the first."""
ONE_THREAD = {"OPENBLAS_NUM_THREADS": "1"}
"""Environment of numpy and scipy for our small matrices, for which their threads only wait for each other."""
_BLOCK = 2**16
_PDEATHSIG = 1
"""Code of prctl for the signal sent when the thread that started the process has ended, however that was."""
_JOIN = 1.0
"""Time [s] that the output has to end after the process: a child that fled may hold it open."""


def started(module: str, *arguments: str, talks: bool = True) -> subprocess.Popen[bytes]:
    """Start a module of this package in a process and a session of its own, with pipes to it.

    Without `talks` there is a pipe of its error output only.
    """
    way = subprocess.PIPE if talks else subprocess.DEVNULL
    return subprocess.Popen(
        [sys.executable, "-P", "-m", module, *arguments],
        stdin=way,
        stdout=way,
        stderr=subprocess.PIPE,
        env={**ONE_THREAD, **os.environ, "PYTHONPATH": os.pathsep.join(filter(None, sys.path))},
        start_new_session=True,
    )


def limit(kind: str, size: int) -> None:
    """Limit what this process may take, where the system knows the kind: ``AS``, ``DATA``, ``FSIZE``, ``CORE``."""
    if sys.platform != "win32":
        import resource

        number = getattr(resource, f"RLIMIT_{kind}")
        _, most = resource.getrlimit(number)
        size = size if most == resource.RLIM_INFINITY else min(size, most)
        with suppress(OSError, ValueError):  # macOS has no limit of the address space
            resource.setrlimit(number, (size, size))


def private_pipes() -> tuple[BinaryIO, int]:
    """Take the pipes of a process that was `started`: a file of requests, and a descriptor for the replies.

    What any code prints goes to the error output then, and it reads nothing. On Linux the process ends with the thread
    that started it.
    """
    requests, replies = os.fdopen(os.dup(0), "rb"), os.dup(1)
    nothing = os.open(os.devnull, os.O_RDONLY)
    os.dup2(nothing, 0)
    os.dup2(2, 1)
    if sys.platform == "linux":
        CDLL(None).prctl(_PDEATHSIG, signal.SIGKILL)
    return requests, replies


def end_group(process: subprocess.Popen[bytes], patience: float = 0.0) -> None:
    """End a process that was started with ``start_new_session``, and those that it has started and left behind.

    It may have ended. `patience` is the time [s] that it has to end those that it started in sessions of their own.
    """
    with suppress(OSError, subprocess.TimeoutExpired):
        if patience and process.poll() is None:
            process.terminate()
            process.wait(patience)
    with suppress(OSError):  # all have ended
        if hasattr(os, "killpg"):
            os.killpg(process.pid, signal.SIGKILL)
        else:
            process.kill()


class Listener:
    """Reads what a process prints, in a thread, so that the process never waits for it; closes the pipe at its end.

    `show`: pass the first `SHOWN` bytes on to the error output, and at the end the last `KEPT` of more, with what a
    terminal would act on written out.
    """

    def __init__(self, stream: IO[bytes], show: bool = False) -> None:
        self._count, self._tail = 0, bytearray()
        self._show = show
        self._text = io.IncrementalNewlineDecoder(codecs.getincrementaldecoder("utf-8")("replace"), True)
        self._thread = threading.Thread(target=self._listen, args=(stream,), daemon=True)
        self._thread.start()

    def _listen(self, stream: IO[bytes]) -> None:
        with stream:
            while block := os.read(stream.fileno(), _BLOCK):
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
