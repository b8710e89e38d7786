"""Options of the command line, made of those that `vdfmu.engine.options` and `vdfmu.study.options` declare."""

from __future__ import annotations

import inspect
from collections.abc import Callable, Iterable
from typing import Annotated, Any

import typer

from vdfmu.base.option import DeclaredOption, Option, declared, taken_options
from vdfmu.engine.options import TEXTS


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
