"""Commands on a pseudo-terminal."""

import fcntl
import os
import signal
import struct
import subprocess
import termios
import time
from typing import NamedTuple

import pytest

pty = pytest.importorskip("pty", reason="Windows has no pseudo-terminals of this kind")


class Shown(NamedTuple):
    """What a terminal got: bytes, exit code, standard output if that was a pipe, longest time without a byte [s]."""

    text: str
    code: int
    output: bytes
    silent: float


def on_terminal(command, *, width=100, stop=0.0, pipe=False, cwd=None, **environment):
    """Run a command on a pseudo-terminal, with Ctrl-C after a time [s]."""
    ours, theirs = pty.openpty()
    fcntl.ioctl(theirs, termios.TIOCSWINSZ, struct.pack("HHHH", 40, width, 0, 0))
    inherited = {name: text for name, text in os.environ.items() if name not in ("NO_COLOR", "COLUMNS")}
    process = subprocess.Popen(
        command, cwd=cwd, env=inherited | {"TERM": "xterm"} | environment, stdin=theirs,
        stdout=subprocess.PIPE if pipe else theirs, stderr=theirs,
    )  # fmt: skip
    os.close(theirs)
    shown, last, silent = bytearray(), time.monotonic(), 0.0
    began = last
    while block := _read(ours):
        now = time.monotonic()
        silent, last = max(silent, now - last), now
        shown += block
        if stop and now - began > stop and b"\xe2\x94\x81" in shown:
            process.send_signal(signal.SIGINT)
            stop = 0.0
    os.close(ours)
    output = process.stdout.read() if process.stdout else b""
    return Shown(shown.decode(), process.wait(120), output, silent)


def _read(end):
    """Read from a pseudo-terminal; nothing if nobody can write to it any more, of which Linux makes an error."""
    try:
        return os.read(end, 65536)
    except OSError:
        return b""
