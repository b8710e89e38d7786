"""Output and exit of commands."""

from __future__ import annotations

import logging
import os
import sys
import traceback
import webbrowser
from collections.abc import Callable, Generator, Mapping, Sequence
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import TYPE_CHECKING, Any, NoReturn

from rich.markup import escape
from rich.text import Text

from vdfmu.base.bars import Bars, EscapedTerminal, errors
from vdfmu.base.bars import plain_table as table
from vdfmu.base.errors import LOG
from vdfmu.base.text import elided, error_text, first_few

if TYPE_CHECKING:
    from rich.panel import Panel
    from rich.table import Table

    from vdfmu.engine.run import LogMessage


class _StandardOutput(EscapedTerminal):
    """The standard output; progress bars are removed from the terminal while it prints."""

    bars: Bars | None = None

    def print(self, *objects: Any, **options: Any) -> None:
        """Print as rich does."""
        self.rest()
        super().print(*objects, **options)

    def rest(self) -> None:
        """Remove the progress bars from the terminal."""
        if self.bars is not None and self.is_terminal:
            self.bars.rest()


console = _StandardOutput()


def say(text: str) -> None:
    """Print a line that may contain a path: unbroken, so that it can be copied or read by a program."""
    console.print(text, markup=False, soft_wrap=True)


def say_written(*paths: Path, more: str = "") -> None:
    """Print the written files: a single one as its path, several in a folder as the folder and their names."""
    folder = paths[0].parent
    if len(paths) > 1 and all(path.parent == folder for path in paths):
        say(f"Written to {folder}: {', '.join(path.name for path in paths)}{more}")
    else:
        say(f"Written to {', '.join(map(str, paths))}{more}")


def say_page(page: Path, opened: bool) -> None:
    """Print the path of a page as a link; open it in a browser if `opened`."""
    address = page.resolve().as_uri()
    if not errors.quiet and page.exists():
        console.print(Text.assemble("Open ", (str(page), f"link {address}")), soft_wrap=True)
    if opened and not webbrowser.open(address):
        say_notes([f"{page}: expected a browser to open the page, found none."])


def say_json(content: Mapping[str, Any]) -> None:
    """Print JSON and nothing else; failing to write it is an error."""
    from vdfmu.base.text import to_json

    if sys.stdout is None:
        fail("the findings cannot be written: the standard output is closed", 2)
    try:
        console.rest()
        print(to_json(content, 1), flush=True)
    except BrokenPipeError:
        raise
    except OSError as error:
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        fail(f"the findings cannot be written: {error.strerror}", 2)


def say_list(heading: str, texts: Mapping[str, str], as_json: bool) -> None:
    """Print names with their descriptions."""
    if as_json:
        say_json(dict(texts))
    else:
        console.print(table(heading, "what it is", rows=((name, escape(text)) for name, text in texts.items())))


def _aside(text: str, markup: bool = False) -> None:
    """Print a line on standard error: broken between words on a terminal, unbroken elsewhere, for programs."""
    errors.print(text, markup=markup, soft_wrap=not errors.is_terminal)


def tell(*shown: Table | Panel | str) -> None:
    """Print content that is also in the written files; ``--quiet`` omits it."""
    if not errors.quiet:
        for each in shown:
            say(each) if isinstance(each, str) else console.print(each)


def say_notes(notes: Sequence[str]) -> None:
    """Print notes on standard error."""
    for note in first_few(notes):
        _aside(f"note: {elided(note)}")


def folder_is_gone() -> bool:
    """Whether the working directory was deleted."""
    try:
        os.getcwd()
    except OSError:
        return True
    return False


def fail(error: object, code: int) -> NoReturn:
    """Print an error and exit, with the same code if it cannot be printed."""
    if folder_is_gone():
        text = "The working directory was deleted: start the command in another one."
        error = ". ".join([*filter(None, [error_text(error).rstrip(".")]), text])
    with suppress(OSError):
        say_error(error)
    sys.exit(code)


def say_error(error: object) -> None:
    """Print an error, and with ``--verbose`` its traceback."""
    errors.quiet = False
    if LOG.isEnabledFor(logging.INFO) and sys.exception():
        errors.print(traceback.format_exc().rstrip(), markup=False, soft_wrap=True)
    _aside(f"[red]error:[/red] {escape(error_text(error))}", markup=True)


@contextmanager
def unit_messages() -> Generator[Callable[[LogMessage], None]]:
    """Show the messages of units; notes with the same text are shown once, at the end."""
    notes: dict[str, dict[str, None]] = {}

    def show(message: LogMessage) -> None:
        if message.status == "note":
            name, colon, words = message.text.partition(": ")
            notes.setdefault(words if colon else name, {}).update({name: None} if colon else {})
        elif LOG.isEnabledFor(logging.INFO) or message.status not in ("ok", "error", "fatal"):
            # the error that ends the run quotes these; --verbose shows them in full
            named = message.unit or message.status == "connections"
            text = str(message) if named else f"{message.status}: {message.text}"
            _aside(elided(text))

    try:
        yield show
    finally:
        say_notes([": ".join([*([", ".join(names)] if names else []), words]) for words, names in notes.items()])
