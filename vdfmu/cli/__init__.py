"""The command line: ``vdfmu run``, ``build``, ``ssp``, ``check``, ``robot``, ``unit`` ...

Exit codes: 0 done, 1 a check or a unit failed, 2 wrong usage or input, 130 stopped with Ctrl-C, 143 by SIGTERM, 129 by
SIGHUP.
"""

from __future__ import annotations

import atexit
import gc
import os
import signal
import sys
from contextlib import suppress

from vdfmu.base.interrupt import command_begins, command_ended
from vdfmu.base.process import ONE_THREAD
from vdfmu.base.text import error_text, message_of, shown
from vdfmu.base.version import __version__
from vdfmu.cli import own_process

__all__ = ["main"]


def main() -> None:
    """Entry point, which ends Python. From here on signals end the command, even while its modules are imported."""
    command_begins()
    own_process.begin()
    os.environ.update(ONE_THREAD | os.environ)
    gc.set_threshold(200_000, 5, 5)  # above the objects of a warm run: repeated searches take 35 ms
    atexit.register(gc.freeze)  # Python would search them for cycles when it ends, only to free memory
    short = ""
    try:
        bytes(2**24)  # the C library then keeps freed memory of this size, which saves 20,000 page faults, 40 ms
        _require_named_folder()
        from vdfmu.cli.commands import command

        command()
    except BaseException as error:
        stop = _stop_behind(error)
        if stop is not None:
            with suppress(OSError):
                sys.stderr.write(f"stopped: {shown(error_text(stop))}\n" if error_text(stop) else "stopped\n")
        elif short := _lacks_memory(error):
            with suppress(OSError, MemoryError):
                sys.stderr.write(f"error: the memory does not hold it ({short}): choose fewer steps or signals, ")
                sys.stderr.write("or raise the limit (ulimit -v).\n")
        elif isinstance(error, ImportError):
            _say_missing(error)
        command_ended()
        if stop is not None:
            code = 128 + getattr(stop, "number", signal.SIGINT)
        else:
            code = error.code if isinstance(error, SystemExit) and isinstance(error.code, int) and not short else 1
        own_process.finished(code)
        if stop is not None or short:
            _flush()
            sys.exit(code)
        raise


def _require_named_folder() -> None:
    """Exit if the working folder's name is not text, because lxml cannot encode it and FMPy would read no FMU there."""
    with suppress(OSError):  # it no longer exists: commands that need it report this
        folder = os.getcwd()
        if any("\udc80" <= letter <= "\udcff" for letter in folder):
            sys.stderr.write(
                f"error: the working folder {ascii(folder)}: expected a name in UTF-8, and a locale that has UTF-8. "
                "Start the command in another folder, with the paths of files in this one, or set LC_ALL=C.UTF-8\n"
            )
            sys.exit(2)


def _say_missing(error: ImportError) -> None:
    """Exit because a package other than vdfmu itself is missing. ``--version`` needs no package."""
    package = (error.name or message_of(error)).partition(".")[0]
    if package == "vdfmu":
        return
    if sys.argv[1:] == ["--version"]:
        sys.stdout.write(f"vdfmu {__version__}\n")
        sys.exit(0)
    missing = isinstance(error, ModuleNotFoundError)
    sys.stderr.write(
        f"error: the Python package {package} {'is not installed' if missing else f'cannot be imported: {error}'}. "
        f"Install it, or vdfmu with all that it needs: {sys.executable} -m pip install {package}\n"
    )
    for note in getattr(error, "__notes__", ()):
        sys.stderr.write(f"{shown(note)}\n")
    own_process.finished(1)
    sys.exit(1)


def _lacks_memory(error: BaseException | None) -> str:
    """Return the text of an error, or of its cause, if it is a lack of memory; empty for other errors."""
    while error is not None and not isinstance(error, SystemExit):  # which has reported the reason
        text = message_of(error)
        if isinstance(error, MemoryError):
            return text.partition("\n")[0] or "MemoryError"
        if any(words in text for words in _MEMORY) and isinstance(error, (ImportError, OSError, RuntimeError)):
            return text.partition("\n")[0]
        error = error.__cause__ or error.__context__
    return ""


_MEMORY = ("can't start new thread", "Cannot allocate memory", "failed to map segment", "std::bad_alloc")
"""Texts with which Python, the loader and libraries report a lack of memory."""


def _stop_behind(error: BaseException | None) -> KeyboardInterrupt | None:
    """Return the signal that caused an error, such as a closed terminal."""
    while error is not None and not isinstance(error, KeyboardInterrupt):
        error = error.__cause__ or error.__context__
    return error


def _flush() -> None:
    """Flush the output, or discard it if its reader has closed it."""
    for stream in (sys.stdout, sys.stderr):
        try:
            stream.flush()
        except OSError:
            os.dup2(os.open(os.devnull, os.O_WRONLY), stream.fileno())
