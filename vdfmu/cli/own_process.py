"""Separate process for a command that runs the user's code.

The command starts itself again with the same arguments, so that a crash of the code, or a call of ``exit``, ends only
that process instead of silently ending the command. It has the same terminal: print, ``breakpoint()`` and Ctrl-C work
as in ``python file.py``. The first process waits, passes signals on, and turns an end without a result into an error.
"""

from __future__ import annotations

import os
import re
import signal
import sys
from collections.abc import Collection, Iterable, Sequence
from contextlib import suppress
from pathlib import Path

from vdfmu.base.files import PACKAGE, read_text
from vdfmu.base.interrupt import SIGNALS
from vdfmu.base.process import end_with_parent

_PIPE = "_VDFMU_PIPE"
"""Environment variable with the pipe to the first process, or on Windows its handle."""
_END = b"\0"
"""Byte that precedes the exit code of a command that was not killed."""
_MOST = 4096
"""Largest size of the sent names [byte]; a pipe holds more, so it need not be read before the end."""
_CODE = re.compile(r"(.+\.(?:py|casadi))(?::\w*)?", re.IGNORECASE)
"""A name of a file of code, such as ``my_units.py:Name``."""
_LARGEST = 2**20
"""Largest file that is searched for names [byte]."""
_wanted = False
_pipe: int | None = None
_sent: list[bytes] = []


class OwnProcessNeeded(BaseException):  # noqa: N818 - not an error, and no error handler may catch it
    """Code is about to run, and must not run in this process."""

    def __init__(self, code: str) -> None:
        self.code = code
        super().__init__(code)


def require(code: object) -> None:
    """Raise OwnProcessNeeded or, in the second process, report to the first one which code runs."""
    if _pipe is None:
        raise OwnProcessNeeded(str(code))
    message = f"{code}\n".encode(errors="replace").replace(_END, b"")
    if message not in _sent and sum(map(len, _sent)) + len(message) <= _MOST:
        _sent.append(message)
        os.write(_pipe, message)


def wanted() -> bool:
    """Return whether commands of this process run code in another one; not if a program calls them."""
    return _wanted


def is_second() -> bool:
    """Return whether this is the separate process in which the code runs."""
    return _pipe is not None


def begin() -> None:
    """Detect whether this process is the second one; then it ends with the first if the system supports that."""
    global _pipe, _wanted
    _wanted = True
    handle = os.environ.pop(_PIPE, None)
    if handle is None:
        return
    _pipe = int(handle)
    if sys.platform == "win32":
        import msvcrt

        _pipe = msvcrt.open_osfhandle(_pipe, 0)
    os.set_inheritable(_pipe, False)
    end_with_parent()


def finished(code: int) -> None:
    """Report to the first process that the command has ended, with this exit code."""
    if _pipe is not None:
        os.write(_pipe, _END + bytes([code % 256]))


def code_named(words: Iterable[str], folder: Path = Path(), seen: Collection[Path] = ()) -> str:
    """Return a file of code named by arguments, directly or through TOML files; empty if there is none.

    Texts are searched for names, and nothing is run. Names that are only known later, such as those of a study, are
    checked by `require`.
    """
    for name in (word.rpartition("=")[2] for word in words):
        path = folder / name
        if code := _CODE.fullmatch(name):
            return code[1]
        if name.lower().endswith(".toml") and path not in seen:
            with suppress(OSError, ValueError):  # the command reports it
                quoted = re.findall(r"""["']([^"'\n]+)["']""", read_text(path, _LARGEST))
                if inner := code_named(quoted, path.parent, {*seen, path}):
                    return inner
    return ""


def run_again(words: Sequence[str], code: str) -> int:
    """Run a command in a separate process and return its exit code; print the reason if it did not end by itself."""
    import subprocess

    reader, writer = os.pipe()
    os.set_inheritable(writer, True)
    handle, inherited = writer, {"pass_fds": (writer,)}
    if sys.platform == "win32":
        import msvcrt

        handle, inherited = msvcrt.get_osfhandle(writer), {"close_fds": False}
    start = f"import sys; sys.path[:] = {sys.path!r}; from vdfmu.cli import main; main()"
    environment = {**os.environ, _PIPE: str(handle)}
    process = subprocess.Popen([sys.executable, "-P", "-c", start, *words], env=environment, **inherited)  # pyright: ignore
    os.close(writer)

    def pass_on(number: int, *_: object) -> None:
        if os.name == "posix":  # on Windows the console sends it to all processes
            process.send_signal(number)

    before = {number: signal.getsignal(number) for number in SIGNALS}
    taken = {number: handler for number, handler in before.items() if handler != signal.SIG_IGN}
    for number in taken:
        signal.signal(number, pass_on)
    try:
        returned = process.wait()
    finally:
        for number, handler in taken.items():
            signal.signal(number, handler)
    os.set_blocking(reader, False)
    said = b""
    with suppress(BlockingIOError):  # a process that the code left behind still holds the pipe
        said = os.read(reader, 2 * _MOST)
    names, end, result = said.partition(_END)
    if end:
        return returned if 0 <= returned < 256 else result[0]
    if -returned in SIGNALS:  # before it could report it
        sys.stderr.write("stopped\n")
        return 128 - returned
    from vdfmu.cli.terminal import say_error

    how = f"crashed ({signal.strsignal(-returned)})" if returned < 0 else f"was ended (exit code {returned})"
    files = ", ".join(names.decode(errors="replace").splitlines()) or code
    say_error(
        f"{files}: the process that ran this code {how} before the command was complete. --no-isolate runs the code in "
        "the process of the command, for a debugger."
    )
    return 1


def foreign_exit(end: SystemExit) -> str:
    """Return the place in the user's code that called ``sys.exit`` without a message; empty if the command did."""
    trace, place = end.__traceback__, ""
    while trace is not None:
        file = trace.tb_frame.f_code.co_filename
        place = "" if Path(file).is_relative_to(PACKAGE) else f"{file}, line {trace.tb_lineno}"
        trace = trace.tb_next
    return "" if isinstance(end.code, str) else place
