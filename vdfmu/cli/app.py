"""Commands that show what they do: ``--quiet``, ``--verbose`` and the line that moves, of all by one mechanism."""

from __future__ import annotations

import inspect
import logging
import os
import platform
import re
import sys
import time
from collections.abc import Callable, Generator
from contextlib import contextmanager
from copy import copy
from functools import partial, wraps
from pathlib import Path
from typing import Annotated, Any

import typer
from typer.core import TyperGroup

from vdfmu.base.bars import Bars, errors
from vdfmu.base.errors import LOG
from vdfmu.base.progress import showing
from vdfmu.base.text import close_to
from vdfmu.base.version import __version__
from vdfmu.cli.terminal import console, expanded, fail

_Decorator = Callable[[Callable[..., Any]], Callable[..., Any]]
QuietOption = Annotated[
    bool,
    typer.Option(
        "--quiet",
        "-q",
        help="Print the result only: no bars, notes, warnings, and no tables that are in the files written.",
    ),
]
VerboseOption = Annotated[
    bool, typer.Option("--verbose", "-v", help="Say what is done and how long it takes, and where errors come from.")
]


class CommandGroup(TyperGroup):
    """All commands: wrong usage is an error as any other."""

    def make_context(self, *args: Any, **kwargs: Any) -> Any:
        """Read the words before the command."""
        with _usage_errors(None):
            return super().make_context(*args, **kwargs)

    def invoke(self, ctx: Any) -> Any:
        """Run the command."""
        with _usage_errors(ctx):
            return super().invoke(ctx)


_CLICK: Any = typer.BadParameter.__mro__[2]
"""What all errors of usage are, of click or of its copy in typer."""


@contextmanager
def _usage_errors(top: Any) -> Generator[None]:
    try:
        yield
    except _CLICK as error:
        context = getattr(error, "ctx", None)
        if type(error).__name__ == "NoArgsIsHelpError":  # the message is the help
            raise
        # an option without its value has no context of its command
        path = context.command_path.partition(" ")[2] if context else (top and top.invoked_subcommand) or ""
        fail(_usage(error, path, context), 2)


def _usage(error: Any, path: str, context: Any) -> str:
    """Return the message of wrong usage, with the way out."""
    message = error.format_message().rstrip(".")
    option: str = getattr(error, "option_name", None) or ""
    if type(error).__name__ == "NoSuchOption":
        known = [word for one in context.command.params for word in (*one.opts, *one.secondary_opts)]
        close = re.sub(r"([\w-]+)(?=[,?])", r"--\1", close_to(option.lstrip("-"), [word.lstrip("-") for word in known]))
        message = f"No such option: {option}{close}"
    stop = "" if message.endswith("?") else "."
    return f"{message}{stop} See '{' '.join(filter(None, ('vdfmu', path)))} --help'."


class App(typer.Typer):
    """An app or a group of commands."""

    def __init__(self, *, cls: type[CommandGroup] = CommandGroup, **options: Any) -> None:
        super().__init__(cls=cls, **options)

    def command(self, name: str | None = None, **options: Any) -> _Decorator:
        """Register a command, as typer does."""
        register = super().command(name, **options)

        def shown(function: Callable[..., Any]) -> Callable[..., Any]:
            words = (self.info.name, name or function.__name__)
            return register(showing_signs(" ".join(word for word in words if isinstance(word, str)))(function))

        return shown

    def __call__(self, *args: Any, **kwargs: Any) -> Any:
        """Run the command that the words name; without the others, which take typer longer than most errors."""
        kwargs.setdefault("prog_name", "vdfmu")  # of python -m vdfmu.cli too
        words = args[0] if args else sys.argv[1:]
        named = next((word for word in words if not word.startswith("-")), "")
        one = copy(self)
        one.registered_commands = [each for each in self.registered_commands if _name_of(each) == named]
        one.registered_groups = [each for each in self.registered_groups if each.name == named]
        found = one.registered_commands or one.registered_groups
        grouped = self.registered_callback is not None  # else typer makes of one command an app without its name
        return _quick(typer.main.get_command(one if found and grouped else self))(*args, **kwargs)


def _quick(command: Any) -> Any:
    """Let a command, and those in it, read texts and paths without pydantic, which takes 0.08 s."""
    for parameter in command.get_params(typer.Context(command)):
        parameter.process_value = partial(_value, parameter, parameter.process_value)
        if parameter.metavar is None or parameter.param_type_name == "argument":
            parameter.display_type = partial(_type_name, parameter)
    for one in getattr(command, "commands", {}).values():
        _quick(one)
    return command


def _type_name(parameter: Any, _: Any) -> str | None:
    """Return a word for the values of an option; None for a switch."""
    if parameter.param_type_name == "argument" or parameter.is_flag:
        return None
    kind = re.sub(r"list\[(.*)\]", r"\1", parameter.bare_type())
    return {"str": "TEXT", "Path": "PATH", "int": "INTEGER"}.get(kind, "NUMBER")


def _value(parameter: Any, asked: Callable[[Any, Any], Any], context: Any, value: Any) -> Any:
    """Return the value of a parameter; `asked`: what typer does."""
    kind, found = getattr(getattr(parameter, "type_descriptor", None), "annotation", None), value
    if value is None and not parameter.required:
        found = () if parameter.multiple or parameter.nargs == -1 else None
    elif kind is Path and isinstance(value, (str, Path)) and (os.access(value, os.R_OK) or not os.path.exists(value)):
        found = Path(value)
    elif not (kind is str and isinstance(value, str) or kind == list[str] and value and isinstance(value, list)):
        found = asked(context, value)
        if any(each != each for each in (found if isinstance(found, (list, tuple)) else (found,))):
            raise typer.BadParameter("expected a number, got nan", context, parameter)
        return found
    return found if parameter.callback is None else parameter.callback(context, parameter, found)


def _name_of(command: typer.models.CommandInfo) -> str:
    return command.name or getattr(command.callback, "__name__", "").replace("_", "-")


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
    """Show what commands show by default, in a process that runs several of them."""
    errors.quiet = False
    LOG.setLevel(logging.NOTSET)
    for handler in list(LOG.handlers):
        if isinstance(handler, _Lines):
            LOG.removeHandler(handler)


def showing_signs(title: str) -> _Decorator:
    """Give a command the options of all, and bars below a title while it runs."""

    def shown(function: Callable[..., Any]) -> Callable[..., Any]:
        parameters, read = expanded(function)

        @wraps(function)
        def command(*, quiet: bool, verbose: bool, **options: Any) -> None:
            set_verbosity(quiet, verbose)
            with Bars(title) as bars, showing(bars.update):
                console.bars = bars
                try:
                    function(**read(options))
                finally:
                    console.bars = None

        more = [
            inspect.Parameter(word, inspect.Parameter.KEYWORD_ONLY, default=False, annotation=option)
            for word, option in (("quiet", QuietOption), ("verbose", VerboseOption))
        ]
        command.__signature__ = inspect.Signature([*parameters, *more])  # type: ignore[attr-defined]
        return command

    return shown


class _Lines(logging.Handler):
    """Prints what is logged above the bars: warnings as notes, details with the time since the command began."""

    def __init__(self) -> None:
        super().__init__()
        self._began = time.perf_counter()

    def emit(self, record: logging.LogRecord) -> None:
        """Print a record."""
        head = "note:" if record.levelno >= logging.WARNING else f"{time.perf_counter() - self._began:8.2f} s "
        errors.print(f"{head} {record.getMessage()}", markup=False, soft_wrap=True)
