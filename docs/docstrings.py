"""What the documentation does to docstrings: types and references in them are text, not Python and not Sphinx."""

from __future__ import annotations

import inspect
import re
from typing import Any

import griffe

from vdfmu.arm.robot import Robot

_TYPE = re.compile(r"^ *[\w*, ]+ : .*$", re.MULTILINE)
_GROUP = re.compile(r"^((?:\w+,\s)+\w+)\n((?: +.*\n)+)", re.MULTILINE)
_UNIT = re.compile(r"(?<=\d\]) \[(?=\w)")
_ROLE = re.compile(r":\w+:`~?([^`]+)`")


class PlainDocstrings(griffe.Extension):
    """Keep units of measurement as they are written, and show ``:func:`name` `` as code.

    As Python, the type ``(n,) [N.m]`` is an index and shows as ``(n,)[m]``. A space that does not break before the
    bracket makes it no Python. Names that share a text without a type are told apart, so that each shows its own.
    """

    def on_object(self, *, obj: griffe.Object, **_: Any) -> None:
        """Change the docstring of one object."""
        if isinstance(obj, griffe.Class):
            for parameter in obj.parameters:
                if str(parameter.default).startswith("row("):  # of the table of a robot's parameters
                    parameter.default = None
        if isinstance(obj, griffe.Function) and "options" in obj.parameters:
            _expand(obj)
        if isinstance(obj, griffe.Class) and obj.docstring is not None and "**options" in obj.docstring.value:
            obj.docstring.value = inspect.getdoc(griffe.dynamic_import(obj.path)) or ""
        if obj.docstring is not None:
            text = obj.docstring.value
            if obj.path == f"{Robot.__module__}.Robot":  # its docstring goes on with the table of parameters
                text = inspect.getdoc(Robot) or ""
            text = _GROUP.sub(lambda m: "".join(f"{name}\n{m[2]}" for name in re.findall(r"\w+", m[1])), text + "\n")
            text = _TYPE.sub(lambda line: line[0].replace(" [", "\u00a0["), text)
            text = _UNIT.sub(r" \[", text)  # else Markdown takes the index and the unit for a link
            obj.docstring.value = _ROLE.sub(r"`\1`", text)


def _expand(function: griffe.Function) -> None:
    """Show each option of a function that takes them as ``**options``, in its signature and its docstring."""
    real = griffe.dynamic_import(function.path)
    named = [parameter for parameter in function.parameters if parameter.name != "options"]
    more = list(inspect.signature(real).parameters.values())[len(named) :]
    kind = griffe.ParameterKind.keyword_only
    function.parameters = griffe.Parameters(
        *named, *(griffe.Parameter(p.name, annotation=p.annotation, kind=kind, default=repr(p.default)) for p in more)
    )
    if function.docstring is not None:
        function.docstring.value = inspect.getdoc(real) or ""
