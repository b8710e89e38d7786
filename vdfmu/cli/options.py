"""Turns declared options into command-line options, with their place in the help, and has those that commands share."""

from __future__ import annotations

import inspect
import re
from collections.abc import Callable, Iterable, Mapping
from dataclasses import replace
from pathlib import Path
from types import NoneType, UnionType
from typing import TYPE_CHECKING, Annotated, Any, get_args, get_origin

import click

from vdfmu.base.errors import UsageError
from vdfmu.base.option import Option, declared, option_of, taken_options
from vdfmu.study.options import RobotOptions, ScenarioRunOptions, known_robots

if TYPE_CHECKING:
    from vdfmu.system.scenario import Scenario

WIDTH = 80
"""Columns of the help."""
_FLAGS = 29
"""Columns of the help before the text of an option."""
TASKS = {
    "System": "robot set unit connect unfed backend compiler fmi input input-hold variant",
    "Time, coupling": "start stop step at algorithm adaptive stepper tolerance pace isolate memory-limit wait-limit "
    "ignore-unmatched",
    "Points": "vary sample points seed spread spread-points together",
    "Judgement": "reference reference-stop judge wanted sampled measure cost limit combine margin method evaluations",
    "Runs": "engine workers scheduler chunk time-limit retry",
    "Browser": "open simulate page",
    "Output": "out overwrite format record pictures width serif json",
}
"""Tasks, and their options in order. An option may name another; all others are listed below "Options"."""


class Positional(Option):
    """Declaration of an argument: a word without a flag."""


class _Number(click.types.FloatParamType):
    """A number."""

    name = "number"

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> float:
        number = super().convert(value, param, ctx)
        return self.fail("expected a number, got nan", param, ctx) if number != number else number


_KINDS: dict[Any, click.ParamType[Any]] = {
    str: click.STRING,
    int: click.INT,
    float: _Number(),
    Path: click.Path(path_type=Path),
}
"""Types on the command line."""


def parameters_of(function: Callable[..., Any]) -> list[click.Parameter]:
    """Return the arguments and options of a command, including its ``**options``.

    A command may have ``forms``: heading to a TypedDict of options. An option that not every form has is below its
    heading.
    """
    parameters: list[click.Parameter] = []
    for argument in inspect.signature(function, eval_str=True).parameters.values():
        if argument.kind is not argument.VAR_KEYWORD:
            kind, option = get_args(argument.annotation)
            parameters.append(parameter(argument.name, option.typed or kind, replace(option, default=argument.default)))
    forms: Mapping[str, Any] = getattr(function, "forms", {"": taken_options(function)})
    options = {each.name: each for form in forms.values() if form for each in declared(form)}
    for name, each in options.items():
        headings = [heading for heading, form in forms.items() if name in form.__annotations__]
        group = each.option.group or ("" if len(headings) == len(forms) else headings[0])
        if each.option.flag is not None:
            parameters.append(parameter(name, each.option.typed or each.type, replace(each.option, group=group)))
    return parameters


def parameter(name: str, kind: Any, option: Option, letter: str = "") -> click.Parameter:
    """Return a declared option or argument with its type on the command line."""
    kind = next(member for member in get_args(kind) if member is not NoneType) if isinstance(kind, UnionType) else kind
    many = get_origin(kind) is list
    base = get_args(kind)[0] if many else kind
    required, default = option.default is inspect.Parameter.empty, option.default

    def read(context: click.Context, parameter: click.Parameter, value: Any) -> Any:
        if value is None or value == ():
            return None if required else default
        if option.read is not None:
            return option.read(value)
        if isinstance(default, tuple) and not many:
            return value.split(",") if value else default
        return list(value) if many else value

    def complete(context: click.Context, parameter: click.Parameter, incomplete: str) -> list[Any]:
        from click.shell_completion import CompletionItem

        choices = (option.names or (lambda: option.choices))()
        files = [] if option.choices else [CompletionItem(incomplete, type="file")]
        return [word for word in choices if word.startswith(incomplete)] or files

    settings: dict[str, Any] = {
        "required": required,
        "callback": read,
        "shell_complete": complete,
        "metavar": option.metavar or "|".join(option.choices) or None,
    }
    if not required and not many:
        settings["default"] = (",".join(default) or None) if isinstance(default, tuple) else default
    settings |= {"is_flag": True} if kind is bool else {"type": _KINDS[base]}
    if isinstance(option, Positional):
        made = click.Argument([name], nargs=-1 if many else 1, **settings)
    else:
        flag = option.flag or f"--{name.replace('_', '-')}"
        both = f"{flag}/--no-{name}" if kind is bool and default is True and not option.flag else flag
        letters = ["-o"] if name == "out" else [letter] if letter else []
        made = click.Option([name, *letters, both], multiple=many, **settings)
    made.help, made.more, made.group = option.text, option.more, option.group  # type: ignore[attr-defined]
    return made


def rows_by_task(parameters: Iterable[click.Parameter]) -> dict[str, list[tuple[str, str]]]:
    """Return the names and the text of each parameter, grouped by task."""
    listed = [(task, name) for task, names in TASKS.items() for name in names.split()]
    places = {f"--{name}": (task, i) for i, (task, name) in enumerate(listed)}
    rows: dict[str, list[tuple[int, str, str]]] = {}
    for k, each in enumerate(parameters, len(places)):
        text = getattr(each, "help", None) or ""
        if isinstance(each.default, (str, int, float)) and each.default not in (True, False, ""):
            text = f"{text.rstrip('.')} [{each.default}]."
        if isinstance(each, click.Option):
            named = next((places[word] for word in each.opts if word in places), ("Options", k))
            task, place = named
            rows.setdefault(getattr(each, "group", "") or task, []).append((place, _words(each), text))
        else:
            words = each.make_metavar(click.get_current_context())
            rows.setdefault("Arguments", []).append((k, words, text))
    groups = [task for task in rows if task not in (*TASKS, "Arguments", "Options")]
    order = [task for task in ("Arguments", *TASKS, *groups, "Options") if task in rows]
    return {task: [(words, text) for _, words, text in sorted(rows[task])] for task in order}


def _words(option: click.Option) -> str:
    """Return an option's flags and a word for its value."""
    flags = ", ".join(option.opts)
    if option.is_flag:
        return "/".join([flags, *option.secondary_opts])
    word = option.metavar or option.type.name.upper()
    return f"{flags} {word if len(flags) + len(word) <= _FLAGS - 4 else 'NAME'}"


def in_columns(rows: Iterable[tuple[str, str]], width: int = _FLAGS) -> str:
    """Return lines of two columns."""
    return "".join(f"  {word:<{width - 3}} {text}".rstrip() + "\n" for word, text in rows)


def in_lines(example: str) -> str:
    """Return a command, broken before options with backslashes for the shell."""
    lines = [""]
    for part in re.split(r" (?=--)", example):
        if lines[-1] and len(lines[-1]) + len(part) > WIDTH - 4:
            lines.append("   ")
        lines[-1] = f"{lines[-1]} {part}" if lines[-1] else part
    return " \\\n".join(lines)


def known_scenarios() -> list[str]:
    """Return the names of scenarios."""
    from vdfmu.system.scenario import scenario_names

    return [*scenario_names(), "reach"]


def _bytes(text: str) -> int:
    """Read a size such as ``500M`` or ``4G``."""
    match = re.fullmatch(r"([1-9]\d{0,11})([KMGT]?)(i?B)?", text.strip(), re.IGNORECASE)
    if not match:
        raise click.BadParameter(f"expected a size such as 500M or 4G, got {text!r}")
    return int(match[1]) * 1024 ** " KMGT".index(match[2].upper() or " ")


ScenarioArgument = Annotated[str, Positional("Name of a scenario, TOML file, or reach.", names=known_scenarios)]
RobotArgument = Annotated[str, Positional("Name of a robot, or a TOML file.", names=known_robots)]
RobotOption = Annotated[str | None, option_of(RobotOptions, "robot")]
BackendOption = Annotated[str | None, option_of(RobotOptions, "backend")]
TrustOption = Annotated[bool, Option("Allow running code that the file names.",
    more="It runs with your permissions.")]  # fmt: skip
OverwriteOption = Annotated[bool, Option("Replace a file of this name.")]
ForeignOption = Annotated[bool, Option("Also overwrite files not written by vdfmu.")]
OpenOption = Annotated[bool, Option("Open the page in a browser.", default=False, flag="--open")]
JsonOption = Annotated[bool, Option("Print JSON instead of tables.", flag="--json")]
FmiOption = Annotated[str, option_of(ScenarioRunOptions, "fmi_version")]
SetOption = Annotated[dict[str, str] | None, option_of(RobotOptions, "parameters")]
UnpackOption = Annotated[
    int | None, Option("Largest unpacked size, such as 4G (default 2G).", metavar="SIZE", typed=str, read=_bytes)
]
AnywayOption = Annotated[bool, Option("Run FMUs even if their files have faults.", default=False)]


def target_file(out: Path | None, name: str, overwrite: bool) -> Path:
    """Return the file to write; UsageError if it exists and must not be replaced."""
    target = out if out is not None else Path(name)
    if target.exists() and not overwrite:
        raise UsageError(
            f"{target}: a file of this name exists. Replace it with --overwrite, or choose another name with -o."
        )
    return target


def refuse(options: Mapping[str, Any], why: str) -> None:
    """Raise UsageError if some of the options have a value; `why` is the rest of the message after their names."""
    if unfit := [name for name, value in options.items() if value not in (None, "", [], {}) and value is not False]:
        raise UsageError("\n".join(f"{name} {why}." for name in unfit))


def load(scenario: str, robot: str | None, parameters: Mapping[str, str] | None = None) -> Scenario:
    """Load a scenario for parameters; missing files are reported before slow imports."""
    from vdfmu.base.toml_file import locate

    if scenario != "reach" or Path(scenario).exists():
        locate(scenario, "scenarios")
    if robot is not None:
        locate(robot, "robots")
    from vdfmu.study.run.prepare import scenario_of

    return scenario_of(scenario, robot, parameters or ())


def read_numbers(option: str, text: str) -> list[float]:
    """Return the numbers of an option; UsageError for any other text."""
    try:
        return [float(number) for number in text.replace(",", " ").split()]
    except ValueError:
        raise UsageError(f"{option} {text}: expected numbers, such as '0.3 -0.5'.") from None
