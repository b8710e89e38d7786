"""Parts that all commands share: options, output, progress, and the way they end."""

from __future__ import annotations

import inspect
import logging
import os
import re
import sys
import traceback
from collections.abc import Callable, Generator, Iterable, Mapping, Sequence
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, NoReturn

import typer
from rich.markup import escape

from vdfmu.base.bars import Bars, EscapedTerminal, errors
from vdfmu.base.errors import LOG, UsageError
from vdfmu.base.option import DeclaredOption, Option, declared, read_settings, taken_options
from vdfmu.base.table import plain_table as table
from vdfmu.base.text import elided, error_text, first_few
from vdfmu.engine.options import TEXTS
from vdfmu.study.options import RobotOptions, ScenarioRunOptions, known_robots

if TYPE_CHECKING:
    from rich.panel import Panel
    from rich.table import Table

    from vdfmu.engine.run import LogMessage
    from vdfmu.system.scenario import Scenario


def completing(names: Callable[[], Iterable[str]]) -> Callable[[str], list[str]]:
    """Return what completes names in the shell."""

    def complete(incomplete: str) -> list[str]:
        return [name for name in names() if name.startswith(incomplete)]

    return complete


def typer_option(options: Any, name: str, help: str = "") -> Any:
    """Return what typer is told of an option, of a TypedDict of options, or with another `help`."""
    return _told(next(each for each in declared(options) if each.name == name), help)


def choice(*values: str) -> dict[str, Any]:
    """Return what typer is told of an option with these values."""
    return {"metavar": "|".join(values), "autocompletion": completing(lambda: values)}


def out_option(help: str) -> Any:
    """Return what typer is told of an option ``--out`` with this help."""
    return typer.Option("--out", "-o", help=help)


def _told(each: DeclaredOption, help: str = "") -> Any:
    option = each.option
    return typer.Option(
        option.flag or f"--{each.name.replace('_', '-')}",
        *(("-o",) if each.name == "out" else ()),
        metavar=option.metavar or "|".join(option.choices) or None,
        help=help or (f"{option.text} Repeatable." if option.typed == TEXTS else option.text),
        autocompletion=completing(option.names or (lambda: option.choices)),
        show_default=option.default is not None and option.default is not False,
    )


def expanded(
    function: Callable[..., Any],
) -> tuple[list[inspect.Parameter], Callable[[dict[str, Any]], dict[str, Any]]]:
    """Return the parameters of a command, with those of its ``**options``, and what reads the values of these.

    Those of ``**options`` stand behind the others, but before what is keyword-only and not needed.
    """
    own = inspect.signature(function, eval_str=True).parameters.values()
    own = [one for one in own if one.kind is not one.VAR_KEYWORD]
    last = [one for one in own if one.kind is one.KEYWORD_ONLY and one.default is not one.empty]
    first = [one for one in own if one not in last]
    taken = taken_options(function)
    shown = [each for each in declared(taken) if each.option.flag is not None] if taken else []
    more = [
        inspect.Parameter(
            each.name,
            inspect.Parameter.KEYWORD_ONLY,
            default=_default(each),
            annotation=Annotated[each.option.typed or each.type, _told(each)],
        )
        for each in shown
    ]
    readers = {each.name: each.option for each in shown}

    def read(values: dict[str, Any]) -> dict[str, Any]:
        return {name: _read(readers[name], one) if name in readers else one for name, one in values.items()}

    return [one.replace(kind=one.KEYWORD_ONLY) for one in (*first, *more, *last)], read


def _default(each: DeclaredOption) -> Any:
    """Return the default on the command line: texts are joined, and what a flag turns on is off."""
    default = each.option.default
    if isinstance(default, tuple):
        return ",".join(default) or None
    return False if each.option.typed is bool else default


def _read(option: Option, value: Any) -> Any:
    """Return the value of an option for Python."""
    if not value and option.typed == TEXTS:
        return option.default
    if option.read is not None:
        return option.read(value)
    if option.typed is str and isinstance(option.default, tuple):
        return value.split(",") if value else option.default
    return value or option.default if option.typed in (TEXTS, bool) else value


class _StandardOutput(EscapedTerminal):
    """The standard output: the bars of a command leave the terminal to what is printed there."""

    bars: Bars | None = None

    def print(self, *objects: Any, **options: Any) -> None:
        """Print as rich does."""
        self.rest()
        super().print(*objects, **options)

    def rest(self) -> None:
        """Let the bars leave the terminal."""
        if self.bars is not None and self.is_terminal:
            self.bars.rest()

    def leave(self) -> None:
        """Let the bars leave the terminal for good: from here on the command waits for the user."""
        if self.bars is not None:
            self.bars.__exit__()
            self.bars = None


console = _StandardOutput()


def complete_scenario(incomplete: str) -> list[str]:
    """Complete the name of a scenario in the shell."""
    from vdfmu.system.scenario.scenario_file import scenario_names

    return [name for name in (*scenario_names(), "reach") if name.startswith(incomplete)]


ScenarioArgument = Annotated[
    str,
    typer.Argument(
        help="Name of a shipped scenario, reach for a first motion of any robot, or path of a TOML file.",
        autocompletion=complete_scenario,
    ),
]
RobotArgument = Annotated[
    str,
    typer.Argument(help="Name of a shipped robot, or path of a robot file.", autocompletion=completing(known_robots)),
]
RobotOption = Annotated[str | None, typer_option(RobotOptions, "robot")]
BackendOption = Annotated[str | None, typer_option(RobotOptions, "backend")]
OverwriteOption = Annotated[bool, typer.Option("--overwrite", help="Replace a file of this name.")]
ForeignOption = Annotated[
    bool, typer.Option("--overwrite", help="Replace files of these names too that vdfmu did not write.")
]
JsonOption = Annotated[bool, typer.Option("--json", help="Print JSON instead of tables.")]
FmiOption = Annotated[str, typer_option(ScenarioRunOptions, "fmi_version")]
SetOption = Annotated[list[str] | None, typer_option(RobotOptions, "settings")]


def _bytes(text: str) -> int:
    """Read a size such as ``500M`` or ``4G``."""
    found = re.fullmatch(r"([1-9]\d{0,11})([KMGT]?)(i?B)?", text.strip(), re.IGNORECASE)
    if not found:
        raise typer.BadParameter(f"expected a size such as 500M or 4G, got {text!r}")
    return int(found[1]) * 1024 ** " KMGT".index(found[2].upper() or " ")


UnpackOption = Annotated[
    int | None,
    typer.Option(
        "--unpack-limit",
        metavar="SIZE",
        parser=_bytes,
        help="Most bytes that the package may unpack to, packages inside it included, such as 4G; default 2G.",
        show_default=False,
    ),
]


def say(text: str) -> None:
    """Print a line that may hold a path: unbroken, so that it can be copied or read by a program."""
    console.print(text, markup=False, soft_wrap=True)


def say_written(*paths: Path, more: str = "") -> None:
    """Say what was written: a file by its path, several in a folder by the folder and their names."""
    folder = paths[0].parent
    if len(paths) > 1 and all(path.parent == folder for path in paths):
        say(f"Written to {folder}: {', '.join(path.name for path in paths)}{more}")
    else:
        say(f"Written to {', '.join(map(str, paths))}{more}")


def say_json(content: Mapping[str, Any]) -> None:
    """Print JSON, and nothing in addition to it; an output that takes none is an error."""
    from vdfmu.base.json_text import to_json

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


def say_list(heading: str, found: Mapping[str, str], as_json: bool) -> None:
    """Print names with their descriptions."""
    if as_json:
        say_json(dict(found))
        return
    shown = table(heading, "what it is")
    for name, text in found.items():
        shown.add_row(name, escape(text))
    console.print(shown)


def target_file(out: Path | None, name: str, overwrite: bool) -> Path:
    """Return the file to write; UsageError for one that is there, unless it may be replaced."""
    target = out if out is not None else Path(name)
    if target.exists() and not overwrite:
        raise UsageError(f"{target}: expected no file of this name. --overwrite replaces it, -o names another.")
    return target


def _aside(text: str, markup: bool = False) -> None:
    """Print a line on standard error: broken between words on a terminal, unbroken elsewhere, for programs."""
    errors.print(text, markup=markup, soft_wrap=not errors.is_terminal)


def tell(*shown: Table | Panel | str) -> None:
    """Print what the files that a command writes have too; ``--quiet`` leaves it out."""
    if not errors.quiet:
        for one in shown:
            say(one) if isinstance(one, str) else console.print(one)


def say_notes(notes: Sequence[str]) -> None:
    """Print notes in addition to what a command writes."""
    for note in first_few(notes):
        _aside(f"note: {elided(note)}")


def load(scenario: str, robot: str | None, settings: list[str] | None = None) -> Scenario:
    """Load a scenario for settings; what does not exist is named before what takes longer to import than that."""
    from vdfmu.base.toml_file import locate

    if scenario == "reach" and not Path(scenario).exists():
        if robot is not None:
            locate(robot, "robots")
        from vdfmu.study.analysis.reach import reach_scenario

        return reach_scenario(robot)
    locate(scenario, "scenarios")
    if robot is not None:
        locate(robot, "robots")
    from vdfmu.system.scenario.replace import with_payload
    from vdfmu.system.scenario.scenario_file import load_scenario

    return with_payload(load_scenario(scenario, robot), read_settings(settings))


def folder_is_gone() -> bool:
    """Whether the working directory was deleted."""
    try:
        os.getcwd()
    except OSError:
        return True
    return False


def fail(error: object, code: int) -> NoReturn:
    """Say what is wrong and end, with the same code where it cannot be said."""
    if folder_is_gone():
        text = "The working directory was deleted: start the command in another one."
        error = ". ".join([*filter(None, [error_text(error).rstrip(".")]), text])
    with suppress(OSError):
        say_error(error)
    sys.exit(code)


def say_error(error: object) -> None:
    """Say what is wrong, and with ``--verbose`` where that is from."""
    errors.quiet = False
    if LOG.isEnabledFor(logging.INFO) and sys.exception():
        errors.print(traceback.format_exc().rstrip(), markup=False, soft_wrap=True)
    _aside(f"[red]error:[/red] {escape(error_text(error))}", markup=True)


@contextmanager
def unit_messages() -> Generator[Callable[[LogMessage], None]]:
    """Show the messages of units; notes of the same words come once, at the end."""
    notes: dict[str, list[str]] = {}

    def show(message: LogMessage) -> None:
        if message.status == "note":
            name, colon, what = message.text.partition(": ")
            notes.setdefault(what if colon else name, []).extend([name] if colon else [])
        elif LOG.isEnabledFor(logging.INFO) or message.status not in ("ok", "error", "fatal"):
            # the error that ends the run quotes these; with --verbose they come in full
            text = str(message) if message.unit else f"{message.status}: {message.text}"
            _aside(elided(text))

    try:
        yield show
    finally:
        say_notes([": ".join([*([", ".join(names)] if names else []), what]) for what, names in notes.items()])
