"""The command line: ``vdfmu run``, ``simulate``, ``build``, ``ssp``, ``container``, ``check`` and ``models``.

Exit codes: 0 done, 1 a check or a unit failed, 2 wrong usage or input, 130 stopped with Ctrl-C, 143 by SIGTERM, 129 by
SIGHUP.
"""

from __future__ import annotations

import os
import signal
import sys
from contextlib import suppress

from vdfmu.interrupt import listening
from vdfmu.text import shown, told

__all__ = ["main"]


def main() -> None:
    """Entry point: signals end the command from here on, while its modules are imported too."""
    with listening():
        try:
            from vdfmu.cli.commands import command

            command()
        except BaseException as error:
            stop = _stop_behind(error)
            if stop is None:
                raise
            with suppress(OSError):
                sys.stderr.write(f"stopped: {shown(told(stop))}\n" if told(stop) else "stopped\n")
            _flush()
            sys.exit(128 + getattr(stop, "number", signal.SIGINT))


def _stop_behind(error: BaseException | None) -> KeyboardInterrupt | None:
    """Return the signal of which an error is the consequence, such as that of a terminal that is gone.

    Typer makes an exit of it, without a word.
    """
    while error is not None and not isinstance(error, KeyboardInterrupt):
        error = error.__cause__ or error.__context__
    return error


def _flush() -> None:
    """Write out what is still to be printed, unless there is nothing to print to any more."""
    for stream in (sys.stdout, sys.stderr):
        try:
            stream.flush()
        except OSError:
            os.dup2(os.open(os.devnull, os.O_WRONLY), stream.fileno())
