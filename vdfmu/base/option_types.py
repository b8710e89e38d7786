"""Whether the values of options have the types that are declared of these.

A type that has no row here, such as a class of another room, is left to the function.
"""

from __future__ import annotations

import os
import re
from collections.abc import Callable, Iterable, Iterator, Mapping
from numbers import Integral, Real
from typing import Any

from vdfmu.base.errors import UsageError


def _whole(value: Any) -> bool:
    return not isinstance(value, bool) and isinstance(value, Integral)


def _number(value: Any) -> bool:
    kind = "" if getattr(value, "shape", None) != () else value.dtype.kind  # an array of no dimension is a number too
    return not isinstance(value, bool) and isinstance(value, Real) or bool(kind) and kind in "iuf"


def _switch(value: Any) -> bool:
    return isinstance(value, bool) or getattr(getattr(value, "dtype", None), "kind", "") == "b" and not value.shape


def _texts(value: Any) -> bool:
    if isinstance(value, (str, Iterator)):
        return not isinstance(value, str)  # an iterator would be used up
    return isinstance(value, Iterable) and all(isinstance(one, str) for one in value)


_TYPES: dict[str, tuple[str, Callable[[Any], bool]]] = {
    "float": ("a number", _number),
    "int": ("a whole number", _whole),
    "bool": ("True or False", _switch),
    "str": ("a text", lambda value: isinstance(value, str)),
    "PathLike[str]": ("a path", lambda value: isinstance(value, os.PathLike)),
    "Path": ("a pathlib.Path", lambda value: isinstance(value, os.PathLike)),
    "Sequence[Path]": ("a sequence of them", lambda value: isinstance(value, Iterable) and not isinstance(value, str)),
    "Mapping[str, Any]": ("a mapping with texts as keys", lambda value: isinstance(value, Mapping) and _texts(value)),
    "Mapping[str, Value]": ("a mapping with texts as keys", lambda value: isinstance(value, Mapping) and _texts(value)),
    "Sequence[str]": ("a sequence of texts", _texts),
    "Literal[False]": ("False", lambda value: value is False),
    "Robot": ("a Robot", lambda value: any(one.__name__ == "Robot" for one in type(value).__mro__)),
    "Callable[[LogMessage], None]": ("a function", callable),
    "None": ("None", lambda value: value is None),
}
"""Types of annotations: in words, and whether a value is of the type."""


def type_problem(name: str, annotation: str, value: Any, kind: str = "", choices: tuple[str, ...] = ()) -> str | None:
    """Return what is wrong with the type of an option's value, in words; None if nothing is.

    Parameters
    ----------
    annotation : str
        Its type, such as ``float | None``.
    kind : str
        The type in words, with a unit of measurement in brackets, such as ``float [s]``.
    choices : tuple of str
        Texts that there are.
    """
    rows = [_TYPES.get(one) for one in annotation.split(" | ")]
    known = [row for row in rows if row is not None]
    if len(known) < len(rows) or any(fits(value) for _, fits in known):
        return None
    unit = re.search(r"\[(.+)\]", kind)
    more = {"a number": f" in {unit[1]}" if unit else "", "a text": f", one of {', '.join(choices)}" if choices else ""}
    words = [text + more.get(text, "") for text, _ in known if text != "None"]
    listed = isinstance(value, str) and "Sequence[str]" in annotation
    way = f" Put it into a list: [{value!r:.60}]." if listed else ""
    return f"{name}: expected {' or '.join(dict.fromkeys(words))}, got {value!r:.60}.{way}"


def check_type(name: str, annotation: str, value: Any) -> None:
    """Raise UsageError for a value of another type; see :func:`type_problem`."""
    if problem := type_problem(name, annotation, value):
        raise UsageError(problem)
