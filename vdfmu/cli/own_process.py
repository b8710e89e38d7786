"""A process of its own for a command that runs code of the user.

The command starts itself again with the same words, so that a crash of the code, or a call of ``exit``, ends that
process and not the command without a word. It has the same terminal: print, ``breakpoint()`` and Ctrl-C work as in
``python file.py``. The first process waits, passes signals on, and turns an end without a result into an error.
"""

from __future__ import annotations

import os
import re
import signal
import sys
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any, cast

from vdfmu.base.errors import ModelError
from vdfmu.base.interrupt import SIGNALS
from vdfmu.base.process import end_with_parent

_PIPE = "_VDFMU_PIPE"
"""Variable of the environment with the pipe, or on Windows its handle, to the first process."""
_END = b"\0"
"""Byte before the exit code of a command that came to its end."""
_MOST = 4096
"""Most bytes of names that are sent: a pipe holds more, so that nobody has to read it before the end."""
_CODE = re.compile(r"(?:\w+=)?(.+\.(?:py|casadi))(?::\w*)?", re.IGNORECASE | re.DOTALL)
"""A word that names a file of code, such as ``controller=my_units.py:Name``."""
_wanted = False
_pipe: int | None = None
_sent = 0


class OwnProcessNeeded(BaseException):  # noqa: N818 - no error, and no handler of errors may take it
    """Code is about to run, and must not run in this process."""

    def __init__(self, code: str) -> None:
        self.code = code
        super().__init__(code)


def require(code: str) -> None:
    """Raise OwnProcessNeeded, or tell the first process which code runs if this is the second."""
    global _sent
    if _pipe is None:
        raise OwnProcessNeeded(code)
    message = f"{code}\n".encode(errors="replace").replace(_END, b"")
    if _sent + len(message) <= _MOST:
        _sent += len(message)
        os.write(_pipe, message)


def wanted() -> bool:
    """Whether commands of this process run code elsewhere: not in a program that calls them."""
    return _wanted


def is_second() -> bool:
    """Whether this is the process of its own, in which the code runs."""
    return _pipe is not None


def begin() -> None:
    """Find out whether this process is the second; then it ends with the first, where the system can do that."""
    global _pipe, _wanted
    _wanted = True
    given = os.environ.pop(_PIPE, None)
    if given is None:
        return
    _pipe = int(given)
    if sys.platform == "win32":
        import msvcrt

        _pipe = msvcrt.open_osfhandle(_pipe, 0)
    os.set_inheritable(_pipe, False)
    end_with_parent()


def finished(code: int) -> None:
    """Tell the first process that the command came to its end, with this exit code."""
    if _pipe is not None:
        os.write(_pipe, _END + bytes([code % 256]))


def code_named(values: Iterable[object], folder: Path = Path(), seen: set[Path] | None = None) -> str:
    """Return a file of code that arguments name, or that TOML files which they name name in turn; empty without one.

    Files are read, nothing is run. Names that only become known later, such as those of a study, are met by `require`.
    """
    seen = set() if seen is None else seen
    for value in values:
        if isinstance(value, Mapping):
            table = cast("Mapping[str, object]", value)
            drive = table.get("drive")
            named = drive if isinstance(drive, str) else code_named(table.values(), folder, seen)
        elif isinstance(value, (list, tuple)):
            named = code_named(cast("Sequence[object]", value), folder, seen)
        elif isinstance(value, (str, Path)):
            match = _CODE.fullmatch(text := str(value))
            named = match[1] if match else _code_in(folder / text, seen) if text.lower().endswith(".toml") else ""
        else:
            continue
        if named:
            return named
    return ""


def _code_in(path: Path, seen: set[Path]) -> str:
    from vdfmu.base.toml_file import read_toml

    if path in seen:
        return ""
    seen.add(path)
    try:
        return code_named([read_toml(path)], path.parent, seen)
    except ModelError:  # the command reports it
        return ""


def run_again(words: Sequence[str], code: str) -> int:
    """Run a command in a process of its own, and return its exit code. Print why it did not come to its end."""
    import subprocess

    reader, writer = os.pipe()
    os.set_inheritable(writer, True)
    handle = writer
    if sys.platform == "win32":
        import msvcrt

        handle = msvcrt.get_osfhandle(writer)
    start = f"import sys; sys.path[:] = {sys.path!r}; from vdfmu.cli import main; main()"
    process: Any = None
    passed: list[int] = []

    def pass_on(number: int, *_: object) -> None:
        passed.append(number)
        send()

    def send() -> None:
        if process is not None and passed and os.name == "posix":  # on Windows the console sends it to all
            process.send_signal(passed[-1])

    handlers = {n: signal.signal(n, pass_on) for n in SIGNALS if signal.getsignal(n) != signal.SIG_IGN}
    try:
        with subprocess.Popen(
            [sys.executable, "-P", "-c", start, *words],
            env={**os.environ, _PIPE: str(handle)},
            **({"pass_fds": (writer,)} if os.name == "posix" else {"close_fds": False}),  # pyright: ignore
        ) as process:
            os.close(writer)
            send()
            returned = process.wait()
    finally:
        for number, handler in handlers.items():
            signal.signal(number, handler)
    os.set_blocking(reader, False)
    try:
        said = os.read(reader, 2 * _MOST)
    except BlockingIOError:  # a process that the code left behind still holds the pipe
        said = b""
    os.close(reader)
    names, end, result = said.partition(_END)
    if end:
        return returned if 0 <= returned < 256 else result[0]
    if passed and returned == -passed[0]:  # before it could say so
        sys.stderr.write("stopped\n")
        return 128 + passed[0]
    _say_end(returned, list(dict.fromkeys(names.decode(errors="replace").splitlines())) or [code])
    return 1


def _say_end(returned: int, names: Sequence[str]) -> None:
    """Print how a process ended that ran code of files."""
    from vdfmu.cli.terminal import say_error

    how = f"ended its process (exit code {returned})"
    if returned < 0:
        try:
            how = f"crashed its process ({signal.Signals(-returned).name})"
        except ValueError:
            how = f"crashed its process (signal {-returned})"
    say_error(
        f"{', '.join(names)}: this code, or what it called, {how} before the command was complete. --no-isolate runs "
        "it in the process of the command, for a debugger."
    )


def foreign_exit(end: SystemExit, package: Path) -> str:
    """Return the place in code of the user that called ``sys.exit``; empty if the command itself did."""
    trace, place = end.__traceback__, ""
    while trace is not None:
        file = trace.tb_frame.f_code.co_filename
        place = "" if Path(file).is_relative_to(package) else f"{file}, line {trace.tb_lineno}"
        trace = trace.tb_next
    return place
