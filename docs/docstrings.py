"""What the documentation does to docstrings: types and references in them are text, not Python and not Sphinx."""

from __future__ import annotations

import inspect
import re
from typing import Any

import griffe

from vdfmu.arm.robot import Robot

_TYPE = re.compile(r"^ *[\w*, ]+ : .*$", re.MULTILINE)
_GROUP = re.compile(r"^((?:\w+,\s)+\w+)\n((?: +.*\n)+)", re.MULTILINE)
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
                if str(parameter.default).startswith("_row("):  # of the table of a robot's parameters
                    parameter.default = None
        if obj.docstring is not None:
            text = obj.docstring.value
            if obj.path == f"{Robot.__module__}.Robot":  # its docstring goes on with the table of parameters
                text = inspect.getdoc(Robot) or ""
            text = _GROUP.sub(
                lambda m: "".join(f"{name}\n{m[2]}" for name in re.findall(r"\w+", m[1])), text + "\n"
            )
            text = _TYPE.sub(lambda line: line[0].replace(" [", "\u00a0["), text)
            obj.docstring.value = _ROLE.sub(r"`\1`", text)
