"""Commands with ``--quiet``, ``--verbose`` and progress bars."""

from __future__ import annotations

import inspect
import logging
import os
import platform
import sys
import time
from collections.abc import Callable, Iterable, Sequence
from contextlib import ExitStack
from difflib import get_close_matches
from functools import cached_property
from glob import glob
from typing import Any, NoReturn, TypeVar

import click

from vdfmu.base.bars import Bars, errors
from vdfmu.base.errors import LOG, UsageError
from vdfmu.base.option import FORMER, Option
from vdfmu.base.progress import showing
from vdfmu.base.trust import CodeNotRunError, announced_to, reading_only
from vdfmu.base.version import __version__
from vdfmu.cli import own_process
from vdfmu.cli.options import in_columns, in_lines, parameter, parameters_of, rows_by_task
from vdfmu.cli.terminal import console, fail

_words: list[str] = []
"""The words of the command line."""
_F = TypeVar("_F", bound=Callable[..., Any])
COMPLETE = "_VDFMU_COMPLETE"
"""Environment variable with which the shell requests completions."""


COMPILER = Option(
    "C compiler for this machine: zig, gcc, clang.",
    default=None,
    metavar="PROGRAM",
    more="Default: the variable VDFMU_COMPILER, else ziglang if it is installed, else cc, gcc or clang.",
)
"""Option of the commands that build FMUs."""
NO_ISOLATE = Option("Run code of files in this process, to debug it.")
LOOKS, RUNS = "looks", "runs"
"""Options for commands that meet files which name code."""


def meets_code(kind: str) -> Callable[[_F], _F]:
    """Mark a command that meets files which name code.

    A command that only reads does not run the code, unless ``--trust`` is given. A command that calculates runs it in a
    separate process.
    """

    def mark(function: _F) -> _F:
        function.code = kind  # type: ignore[attr-defined]
        return function

    return mark


class Described(click.Command):
    """Help with one line per option, in groups by task, and the options of all commands."""

    panel = "Commands"
    """Heading of its group in the list of commands."""
    code: str = ""
    """Whether it runs code of files, or only reads them."""

    def __init__(self, name: str | None, *, example: str = "", declare: Any = tuple, **settings: Any) -> None:
        super().__init__(name, **settings)
        self.example, self._declare = example, declare
        del self.params

    @cached_property
    def params(self) -> list[click.Parameter]:  # pyright: ignore[reportIncompatibleVariableOverride]
        """Parameters of the command, made when first used."""
        declared: Sequence[click.Parameter] = self._declare()
        names = {each.name for each in declared}
        return [
            *declared,
            *([parameter("compiler", str, COMPILER)] if "backend" in names else []),
            *([parameter("no_isolate", bool, NO_ISOLATE)] if self.code == RUNS and "isolate" not in names else []),
            parameter("quiet", bool, Option("Print only results: no bars, notes or tables."), "-q"),
            parameter("verbose", bool, Option("Print all tables, each stage and its time."), "-v"),
        ]

    @property
    def summary(self) -> str:
        """First sentence of the help."""
        first = " ".join((self.help or "").partition("\n\n")[0].split())
        return first.partition(". ")[0].rstrip(".") + "."

    def format_help(self, ctx: click.Context, formatter: click.HelpFormatter) -> None:
        """Write usage, description, a line for each argument, option and command, and the example."""
        self.format_usage(ctx, formatter)
        self.format_help_text(ctx, formatter)
        panels: dict[str, list[tuple[str, str]]] = {}
        for name, command in getattr(self, "commands", {}).items():
            panels.setdefault(command.panel, []).append((name, command.summary))
        for heading, rows in panels.items():
            formatter.write(f"\n{heading}:\n{in_columns(rows, 13)}")
        for heading, rows in rows_by_task(self.get_params(ctx)).items():
            formatter.write(f"\n{heading}:\n{in_columns(rows)}")
        if self.example:
            formatter.write(f"\n{in_lines(f'Example: {self.example}')}\n")

    def invoke(self, ctx: click.Context) -> Any:
        """Run the command below a moving line."""
        in_place = ctx.params.pop("no_isolate", ctx.params.get("isolate") is False)
        with ExitStack() as rules:
            if isinstance(self, click.Group):
                return self._run(ctx)
            if self.code == LOOKS and not ctx.params.get("trust"):
                rules.enter_context(announced_to(reading_only))
            elif not in_place and own_process.wanted():
                if self.code and not own_process.is_second() and (code := own_process.code_named(_words)):
                    own_process.require(code)  # before anything that takes long is imported
                rules.enter_context(announced_to(own_process.require))
            try:
                return self._run(ctx, moves=not in_place and not own_process.is_second())
            except CodeNotRunError as error:
                way = " --trust runs it." if "trust" in ctx.params else ""
                raise UsageError(f"{error.code} is code, and was not run.{way}") from None

    def _run(self, ctx: click.Context, moves: bool = True) -> Any:
        """Run the command. No line `moves` if code of the user runs, as it would overwrite a debugger's prompt."""
        set_verbosity(ctx.params.pop("quiet"), ctx.params.pop("verbose"))
        if (chosen := ctx.params.pop("compiler", None)) is not None:
            os.environ["VDFMU_COMPILER"] = chosen  # including other processes
        if isinstance(self, click.Group):
            return super().invoke(ctx)
        with Bars(ctx.command_path.partition(" ")[2] if moves else "") as bars, showing(bars.update):
            console.bars = bars
            try:
                return super().invoke(ctx)
            finally:
                console.bars = None


class FunctionCommand(Described):
    """A command: its options are declared by its function."""

    def __init__(self, name: str | None, *, callback: Callable[..., Any], example: str, **settings: Any) -> None:
        attributes = {"help": inspect.getdoc(callback), **settings, "declare": lambda: parameters_of(callback)}
        super().__init__(name, callback=callback, example=example, **attributes)
        self.code = getattr(callback, "code", "")


class App(Described, click.Group):  # pyright: ignore[reportIncompatibleVariableOverride]
    """All commands, or a group of them."""

    command_class = FunctionCommand

    def add(self, commands: Iterable[tuple[Any, str]], panel: str) -> None:
        """Add functions as commands, with examples, and groups, below a heading."""
        for added, example in commands:
            made = added if isinstance(added, App) else FunctionCommand(added.__name__, callback=added, example=example)
            made.panel = panel
            self.add_command(made)

    def main(self, args: Any = None, *_: Any, **extra: Any) -> NoReturn:
        """Run the command of the arguments; wrong usage is reported like any other error."""
        reset_verbosity()
        _words[:] = words = list(sys.argv[1:] if args is None else args)
        if os.name == "nt":
            words = [each for word in words for each in glob(word) or [word]]
        if COMPLETE in os.environ:
            from click.shell_completion import shell_complete

            sys.exit(shell_complete(self, {}, "vdfmu", COMPLETE, os.environ[COMPLETE]))
        try:
            with self.make_context("vdfmu", [*words]) as context:  # click removes from the list what it has read
                self.invoke(context)
        except own_process.OwnProcessNeeded as needed:
            sys.exit(own_process.run_again(words, needed.code))
        except SystemExit as end:
            if place := own_process.foreign_exit(end):
                fail(f"{place}: ended the command by sys.exit({end.code!r}). Raise an error, or return.", 1)
            raise
        except click.exceptions.NoArgsIsHelpError as error:
            error.show()
            sys.exit(2)
        except click.ClickException as error:
            fail(_usage(error, words), 2)
        except click.exceptions.Exit as end:
            sys.exit(end.exit_code)
        sys.exit(0)


def _usage(error: Any, words: Sequence[str]) -> str:
    """Return the message of wrong usage, with a fix."""
    if isinstance(error, click.NoSuchOption) and error.ctx:  # with the dashes all names would be similar
        spelled = {word.lstrip("-"): word for p in error.ctx.command.params for word in (*p.opts, *p.secondary_opts)}
        close = [spelled[word] for word in get_close_matches(error.option_name.lstrip("-"), spelled)]
        error = click.NoSuchOption(error.option_name, possibilities=close, ctx=error.ctx)
    message = error.format_message().rstrip(".")
    if isinstance(error, click.NoSuchOption) and error.ctx:
        now = [p for p in error.ctx.command.params if p.name == FORMER.get(error.option_name.lstrip("-"))]
        message = f"{error.option_name} is now {'/'.join([*now[0].opts, *now[0].secondary_opts])}" if now else message
    # an option without its value has no context of its command
    path = error.ctx.command_path if error.ctx else " ".join(["vdfmu", *words[:1]])
    return f"{message}{'' if message.endswith(('?', '?)')) else '.'} See '{path} --help'."


def set_verbosity(quiet: bool = False, verbose: bool = False) -> None:
    """Hide notes, warnings and bars, or show details."""
    if not any(isinstance(handler, _Lines) for handler in LOG.handlers):
        LOG.addHandler(_Lines())
    if quiet:
        errors.quiet = True
        LOG.setLevel(logging.ERROR)
    elif verbose and not LOG.isEnabledFor(logging.INFO):
        from vdfmu.cli.extras import installed

        LOG.setLevel(logging.INFO)
        there, _ = installed("")
        LOG.info("vdfmu %s, Python %s, %s", __version__, platform.python_version(), ", ".join(there))


def reset_verbosity() -> None:
    """Restore the default verbosity, in a process that runs several commands."""
    errors.quiet = False
    LOG.setLevel(logging.NOTSET)
    for handler in list(LOG.handlers):
        if isinstance(handler, _Lines):
            LOG.removeHandler(handler)


class _Lines(logging.Handler):
    """Prints log records above the bars: warnings as notes, details with the time since the command's start."""

    def __init__(self) -> None:
        super().__init__()
        self._began = time.perf_counter()

    def emit(self, record: logging.LogRecord) -> None:
        """Print a record."""
        head = "note:" if record.levelno >= logging.WARNING else f"{time.perf_counter() - self._began:8.2f} s "
        errors.print(f"{head} {record.getMessage()}", markup=False, soft_wrap=True)
