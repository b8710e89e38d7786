"""Options that are declared once: as fields of a TypedDict, for functions, their help, the command line and the docs.

A field is ``step: Annotated[float | None, Option("Communication step in seconds.", "float [s]")]``. A function takes
``**options: Unpack[...]`` and reads them as ``options["step"]``; `with_options` does the rest.
"""

from __future__ import annotations

import inspect
import re
import textwrap
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, replace
from functools import wraps
from typing import Any, ForwardRef, ParamSpec, TypeVar, cast, get_args

from vdfmu.base.errors import UsageError
from vdfmu.base.option_types import type_problem
from vdfmu.base.text import close_to

_P = ParamSpec("_P")
_T = TypeVar("_T")
_ENTRY = re.compile(r"^( *)\*\*options\n(?:\1 +\S.*\n)*", re.MULTILINE)
_WIDTH = 110


@dataclass(frozen=True)
class Option:
    """Declaration of an option besides its name and type."""

    text: str
    """Its meaning, in plain sentences for ``--help`` and ``help()``."""
    kind: str = ""
    """Its type in words, with its unit of measurement; default that of Python."""
    more: str = ""
    """Text that ``help()`` adds to `text`."""
    default: Any = None
    flag: str | None = ""
    """Its name on the command line, ``--set``; default that of the field; None where the command line lacks it."""
    metavar: str | None = None
    typed: Any = None
    """Type on the command line, where it is another."""
    read: Callable[[Any], Any] | None = None
    """Makes its value of what the command line has."""
    names: Callable[[], Iterable[str]] | None = None
    """Returns names that the shell completes."""
    choices: tuple[str, ...] = ()
    """Values that there are, which ``--help`` shows and the shell completes."""
    group: str = ""
    """Heading in ``--help``; default by :mod:`vdfmu.cli.parameters`."""


@dataclass(frozen=True)
class DeclaredOption:
    """A field of a TypedDict of options."""

    name: str
    type: Any
    """Type in Python; a text where its parts are not imported."""
    option: Option

    @property
    def annotation(self) -> str:
        """Its type as a text."""
        return re.sub(r"\b(?:[a-z]+\.)+(?=[A-Z])", "", inspect.formatannotation(self.type).strip("'"))

    def entry(self) -> str:
        """Return the entry in the list of parameters of a docstring."""
        kind = self.option.kind or self.annotation.removesuffix(" | None")
        text = textwrap.fill(f"{self.option.text} {self.option.more}", _WIDTH, break_long_words=False)
        return f"{self.name} : {kind}, optional\n{textwrap.indent(text, '    ')}\n"


def declared(options: Any) -> list[DeclaredOption]:
    """Return the fields of a TypedDict of options, those of its bases first."""
    found: list[DeclaredOption] = []
    for name, annotation in options.__annotations__.items():
        kind, option = get_args(annotation)
        found.append(DeclaredOption(name, kind.__forward_arg__ if isinstance(kind, ForwardRef) else kind, option))
    return found


def option_of(options: Any, name: str, text: str = "") -> Option:
    """Return the declaration of an option, with another text if given."""
    option = next(each.option for each in declared(options) if each.name == name)
    return replace(option, text=text) if text else option


def taken_options(function: Callable[..., Any]) -> Any:
    """Return the TypedDict of a function with ``**options: Unpack[...]``, else None."""
    annotation = inspect.unwrap(function).__annotations__.get("options")
    if isinstance(annotation, str) and annotation.startswith("Unpack["):
        annotation = eval(annotation, inspect.unwrap(function).__globals__)
        return get_args(annotation)[0]
    return None


def with_options(function: Callable[_P, _T]) -> Callable[_P, _T]:
    """Give the options of a function their defaults, and name each in its signature and docstring.

    A value of another type than the declared one is a UsageError, with all of them.
    """
    own = inspect.signature(function)
    listed = declared(taken_options(function))
    parameters = [one for one in own.parameters.values() if one.kind is not one.VAR_KEYWORD]
    parameters += [
        inspect.Parameter(
            each.name, inspect.Parameter.KEYWORD_ONLY, default=each.option.default, annotation=each.annotation
        )
        for each in listed
    ]
    signature = own.replace(parameters=parameters)
    name = function.__qualname__.removesuffix(".__init__")

    @wraps(function)
    def called(*args: _P.args, **kwargs: _P.kwargs) -> _T:
        for unknown in kwargs.keys() - signature.parameters.keys():
            close = close_to(unknown, signature.parameters)
            raise TypeError(f"{name}() got an unexpected keyword argument {unknown!r}{close}")
        try:
            bound = signature.bind(*args, **kwargs)
        except TypeError as error:
            raise TypeError(f"{name}() {error}") from None
        found = [
            type_problem(each.name, each.annotation, bound.arguments[each.name], each.option.kind, each.option.choices)
            for each in listed
            if each.name in bound.arguments
        ]
        if problems := [problem for problem in found if problem]:
            raise UsageError("\n".join(problems))
        bound.apply_defaults()
        return function(*bound.args, **bound.kwargs)

    called.__signature__ = signature  # type: ignore[attr-defined]
    called.__doc__ = _listing(function.__doc__, listed)
    return called


def lists_options(kind: type[_T]) -> type[_T]:
    """Name in the docstring of a class each option that its constructor takes."""
    kind.__doc__ = _listing(kind.__doc__, declared(taken_options(kind.__init__)))
    return kind


def _listing(docstring: str | None, options: list[DeclaredOption]) -> str | None:
    """Put options in the place of ``**options`` in a docstring."""
    entries = "".join(each.entry() for each in options)
    return docstring and _ENTRY.sub(lambda found: textwrap.indent(entries, found[1]), docstring)


def pick(kind: type[_T], options: Mapping[str, Any]) -> _T:
    """Return those of some options that a TypedDict has, to pass them on."""
    names = kind.__annotations__
    return cast("_T", {name: value for name, value in options.items() if name in names})


def read_settings(
    items: Iterable[str] | None,
    option: str = "--set",
    form: str = "COMPONENT.VARIABLE=VALUE, such as controller.K_p[1]=3000",
) -> dict[str, str]:
    """Read ``--set`` options, or others of a form ``NAME=TEXT``: name to text."""
    settings: dict[str, str] = {}
    for item in items or []:
        key, equals, value = item.partition("=")
        if not equals or not key.strip() or not value.strip():
            raise UsageError(f"{option} {item}: expected {form}.")
        settings[key.strip()] = value.strip()
    return settings
