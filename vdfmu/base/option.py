"""Options, each declared once as a field of a TypedDict, for functions, their help, the command line and the docs.

A field is ``step: Annotated[float | None, Option("Communication step in seconds.", "float [s]")]``. A function with
``**options: Unpack[...]`` and `with_options` reads ``options["step"]``.
"""

from __future__ import annotations

import inspect
import os
import re
import textwrap
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cache, partial, wraps
from numbers import Integral, Real
from typing import Any, ForwardRef, NamedTuple, ParamSpec, TypeVar, Unpack, cast, get_args, get_origin

from vdfmu.base.errors import UsageError
from vdfmu.base.text import close_to

FORMER: Mapping[str, str] = {
    "meant": "sampled",
    "master": "algorithm",
    **dict.fromkeys(("settings", "values", "start_values"), "parameters"),
}
"""Names of options, keys and arguments in earlier versions to their names now."""
_P = ParamSpec("_P")
_T = TypeVar("_T")
_ENTRY = re.compile(r"^( *)\*\*options\n(?:\1 +\S.*\n)*", re.MULTILINE)
_UNPACKED = re.compile(r"Unpack\[(\w+)\]")
_WIDTH = 110


@dataclass(frozen=True)
class Option:
    """Declaration of an option without its name and type."""

    text: str
    """Meaning, in sentences for ``--help`` and ``help()``."""
    kind: str = ""
    """Type as text, with its unit of measurement. Default: the type in Python."""
    more: str = ""
    """Text that ``help()`` adds to `text`."""
    default: Any = None
    flag: str | None = ""
    """Name on the command line, ``--set``. Default: the name of the field. None omits it there."""
    metavar: str | None = None
    typed: Any = None
    """Type on the command line, if it differs."""
    read: Callable[[Any], Any] | None = None
    """Converts the value of the command line."""
    names: Callable[[], Iterable[str]] | None = None
    """Returns names for the shell's completion."""
    choices: tuple[str, ...] = ()
    """Valid values, for ``--help`` and completion."""
    group: str = ""
    """Heading in ``--help``. Default by :mod:`vdfmu.cli.options`."""


class DeclaredOption(NamedTuple):
    """A field of a TypedDict of options."""

    name: str
    type: Any
    """Type in Python. A text if it refers to names that are not imported."""
    option: Option

    @property
    def annotation(self) -> str:
        """The type as a text."""
        return _plain(self.type)

    def entry(self) -> str:
        """Return the entry in the list of parameters of a docstring."""
        kind = self.option.kind or self.annotation.removesuffix(" | None")
        text = textwrap.fill(f"{self.option.text} {self.option.more}", _WIDTH, break_long_words=False)
        return f"{self.name} : {kind}, optional\n{textwrap.indent(text, '    ')}\n"


def _plain(annotation: Any) -> str:
    """Return a type as a text, without the modules in its names."""
    return re.sub(r"\b(?:[a-z]+\.)+(?=[A-Z])", "", inspect.formatannotation(annotation).strip("'"))


def declared(options: Any) -> list[DeclaredOption]:
    """Return the fields of a TypedDict of options, inherited fields first."""
    fields: list[DeclaredOption] = []
    for name, annotation in options.__annotations__.items():
        kind, option = get_args(annotation)
        fields.append(DeclaredOption(name, kind.__forward_arg__ if isinstance(kind, ForwardRef) else kind, option))
    return fields


def option_of(options: Any, name: str, text: str = "") -> Option:
    """Return the declaration of an option, with `text` replaced if given."""
    option = next(each.option for each in declared(options) if each.name == name)
    return replace(option, text=text) if text else option


def taken_options(function: Callable[..., Any]) -> Any:
    """Return the TypedDict of a function with ``**options: Unpack[...]``, else None."""
    plain = inspect.unwrap(function)
    annotation = plain.__annotations__.get("options")
    if isinstance(annotation, str) and (named := _UNPACKED.fullmatch(annotation)):
        return plain.__globals__[named[1]]
    return get_args(annotation)[0] if get_origin(annotation) is Unpack else None


def renamed(content: Any) -> Any:
    """Return a table with its keys of earlier versions renamed; other content unchanged."""
    return {FORMER.get(key, key): value for key, value in content.items()} if isinstance(content, dict) else content


def _call_of(function: Callable[..., Any]) -> str:
    return function.__qualname__.removesuffix(".__init__")


def checks_types(function: Callable[_P, _T]) -> Callable[_P, _T]:
    """Make a function raise a UsageError that lists all arguments of a wrong type; see `_TYPES`."""
    check = _check_of(function, ())

    @wraps(function)
    def called(*args: _P.args, **kwargs: _P.kwargs) -> _T:
        check(args, kwargs)
        return function(*args, **kwargs)

    return called


def _check_of(
    function: Callable[..., Any], options: Iterable[DeclaredOption]
) -> Callable[[Sequence[Any], Mapping[str, Any]], None]:
    """Return the check of the arguments of a call of a function with `options`."""
    parameters = inspect.signature(function).parameters.values()
    leading = [each.name for each in parameters if each.kind is each.POSITIONAL_OR_KEYWORD]
    types: dict[str, Any] = {
        p.name: (_plain(p.annotation),) for p in parameters if p.kind not in (p.VAR_POSITIONAL, p.VAR_KEYWORD)
    }
    types |= {o.name: (o.annotation, o.option.kind, o.option.choices) for o in options}
    call = _call_of(function)
    exact = {name: [_PLAIN[part] for part in kind[0].split(" | ") if part in _PLAIN] for name, kind in types.items()}
    checked = {name for name, kind in types.items() if _checks(kind[0])}

    def check(args: Sequence[Any], kwargs: Mapping[str, Any]) -> None:
        arguments = {**dict(zip(leading, args, strict=False)), **kwargs}
        if former := [name for name in kwargs if name not in exact and FORMER.get(name) in exact]:
            raise UsageError("\n".join(f"{call}: {name} is now {FORMER[name]}." for name in former))
        odd = [name for name, value in arguments.items() if name in checked and type(value) not in exact[name]]
        faults = (type_problem(name, types[name][0], arguments[name], *types[name][1:]) for name in odd)
        if problems := [*filter(None, faults)]:
            raise UsageError("\n".join(problems))

    return check


def with_options(function: Callable[_P, _T]) -> Callable[_P, _T]:
    """Add its options to a function: defaults, signature, docstring, and a UsageError for values of a wrong type."""
    plain = inspect.signature(function)
    listed = declared(taken_options(function))
    parameters = [each for each in plain.parameters.values() if each.kind is not each.VAR_KEYWORD]
    kind = inspect.Parameter.KEYWORD_ONLY
    parameters += [inspect.Parameter(o.name, kind, default=o.option.default, annotation=o.annotation) for o in listed]
    signature = plain.replace(parameters=parameters)
    defaults = {each.name: each.option.default for each in listed}
    leading = [each.name for each in plain.parameters.values() if each.kind is each.POSITIONAL_OR_KEYWORD]
    variable = inspect.Parameter.VAR_POSITIONAL, inspect.Parameter.VAR_KEYWORD
    needed = {e.name for e in plain.parameters.values() if e.default is e.empty and e.kind not in variable}
    names = frozenset(signature.parameters)
    call = _call_of(function)
    check = _check_of(function, listed)

    @wraps(function)
    def called(*args: _P.args, **kwargs: _P.kwargs) -> _T:
        for unknown in kwargs.keys() - names:
            if FORMER.get(unknown) in names:
                continue  # the check names its successor
            close = close_to(unknown, signature.parameters)
            raise TypeError(f"{call}() got an unexpected keyword argument {unknown!r}{close}")
        positional = leading[: len(args)]
        if len(args) > len(leading) or not needed <= {*positional, *kwargs} or not kwargs.keys().isdisjoint(positional):
            try:
                signature.bind(*args, **kwargs)
            except TypeError as error:
                raise TypeError(f"{call}() {error}") from None
        check(args, kwargs)
        return function(*args, **{**defaults, **kwargs})  # pyright: ignore[reportCallIssue]

    called.__signature__ = signature  # type: ignore[attr-defined]
    called.__doc__ = _listing(function.__doc__, listed)
    return called


def lists_options(kind: type[_T]) -> type[_T]:
    """Add the options of its constructor to the docstring of a class."""
    kind.__doc__ = _listing(kind.__doc__, declared(taken_options(kind.__init__)))
    return kind


def _listing(docstring: str | None, options: list[DeclaredOption]) -> str | None:
    """Replace ``**options`` in a docstring by the options."""
    entries = "".join(each.entry() for each in options)
    return docstring and _ENTRY.sub(lambda match: textwrap.indent(entries, match[1]), docstring)


def pick(kind: type[_T], options: Mapping[str, Any]) -> _T:
    """Return the options declared by a TypedDict, to forward them."""
    names = kind.__annotations__
    return cast("_T", {name: value for name, value in options.items() if name in names})


def read_settings(
    items: Iterable[str] | None,
    option: str = "--set",
    form: str = "COMPONENT.VARIABLE=VALUE, such as controller.K_p[1]=3000",
) -> dict[str, str]:
    """Read ``--set`` options, or others of the form ``NAME=TEXT``; return name to text."""
    settings: dict[str, str] = {}
    for item in items or []:
        key, equals, value = item.partition("=")
        if not equals or not key.strip() or not value.strip():
            raise UsageError(f"{option} {item}: expected {form}.")
        settings[key.strip()] = value.strip()
    return settings


def _number(value: Any) -> bool:
    kind = "" if getattr(value, "shape", None) != () else value.dtype.kind  # a zero-dimensional array is a number too
    return not isinstance(value, bool) and isinstance(value, Real) or bool(kind) and kind in "iuf"


def _switch(value: Any) -> bool:
    return isinstance(value, bool) or getattr(getattr(value, "dtype", None), "kind", "") == "b" and not value.shape


def _texts(value: Any) -> bool:
    if isinstance(value, (str, Iterator)):
        return not isinstance(value, str)  # checking would exhaust an iterator
    return isinstance(value, Iterable) and all(isinstance(each, str) for each in value)


def _numbers(value: Any) -> bool:
    return isinstance(value, Iterable) and not isinstance(value, (str, Iterator)) and all(map(_number, value))


def _array(value: Any) -> bool:
    from numpy import asarray  # takes long to import

    try:
        array = asarray(value)
    except ValueError:  # rows of different lengths
        return False
    return not array.size or array.dtype.kind in "iuf"


def _is_one(name: str, value: Any) -> bool:
    return any(kind.__name__ == name for kind in type(value).__mro__)


NUMBERS = "a number, or a list or rows of them"
"""The text for an array."""
_PLAIN = {"float": float, "int": int, "bool": bool, "str": str, "None": type(None)}
"""Types by their annotation."""
_TYPES: dict[str, tuple[str, Callable[[Any], bool]]] = {
    "float": ("a number", _number),
    "int": ("a whole number", lambda value: not isinstance(value, bool) and isinstance(value, Integral)),
    "bool": ("True or False", _switch),
    "str": ("a text", lambda value: isinstance(value, str)),
    "PathLike[str]": ("a path", lambda value: isinstance(value, os.PathLike)),
    "Path": ("a pathlib.Path", lambda value: isinstance(value, os.PathLike)),
    "Sequence[Path]": ("a sequence of them", lambda value: isinstance(value, Iterable) and not isinstance(value, str)),
    "Mapping": ("a mapping with texts as keys", lambda value: isinstance(value, Mapping) and _texts(value)),
    "Sequence[str]": ("a sequence of texts", _texts),
    "Sequence[float]": ("a sequence of numbers", _numbers),
    "Sequence[int]": ("a sequence of numbers", _numbers),
    "ArrayLike": (NUMBERS, _array),
    "Literal[False]": ("False", lambda value: value is False),
    "type": ("a class", lambda value: isinstance(value, type)),
    "Callable": ("a function", callable),
    "None": ("None", lambda value: value is None),
    **{name: (f"a {name}", partial(_is_one, name)) for name in ("Robot", "Scenario", "System", "FlatSystem", "Motion")},
}
"""Annotation, or its part before a bracket, to the type as a text and its check; other annotations are not checked."""


_LOADERS = {
    "a Robot": "load_robot",
    "a Scenario": "system.scenario.load_scenario",
    "a System": "load",
    "a Motion": "load_motion",
}
"""Type, as a text, to the function that loads it."""


@cache
def _checks(annotation: str) -> list[tuple[str, Callable[[Any], bool]]]:
    """Return the rows of an annotation's types, ``None`` first; an empty list if a type has no row."""
    parts = sorted(annotation.split(" | "), key=lambda part: part != "None")
    rows = [_TYPES.get(part) or _TYPES.get(part.partition("[")[0]) for part in parts]
    return [] if None in rows else [row for row in rows if row is not None]


def type_problem(name: str, annotation: str, value: Any, kind: str = "", choices: tuple[str, ...] = ()) -> str | None:
    """Return the problem of a value whose type differs from its annotation, ``float | None``, else None.

    `kind` is the type in words with a unit of measurement, ``float [s]``; `choices` are the valid texts.
    """
    checks = _checks(annotation)
    if any(fits(value) for _, fits in checks) or not checks:
        return None
    unit = re.search(r"\[(.+)\]", kind)
    more = {"a number": f" in {unit[1]}" if unit else "", "a text": f", one of {', '.join(choices)}" if choices else ""}
    words = [text + more.get(text, "") for text, _ in checks if text != "None"]
    listed = isinstance(value, str) and "Sequence[str]" in annotation
    way = f" Put it into a list: [{value!r:.60}]." if listed else ""
    if loader := next(filter(None, map(_LOADERS.get, words)), None):
        way = f" Load it with vdfmu.{loader}."
    return f"{name}: expected {' or '.join(dict.fromkeys(words))}, got {value!r:.60}.{way}"


def check_type(name: str, annotation: str, value: Any) -> None:
    """Raise UsageError for a value of another type. See :func:`type_problem`."""
    if problem := type_problem(name, annotation, value):
        raise UsageError(problem)
