"""FMUs of any tool as components of a system file: their variables, instead of a unit's."""

from __future__ import annotations

import re
from collections.abc import Iterator
from functools import cached_property
from pathlib import Path
from typing import Any

import fmpy

from vdfmu.base.errors import UsageError
from vdfmu.base.standards import FMI_VERSIONS
from vdfmu.compiler.unit.variable import Variable
from vdfmu.engine.fmu.variables import element_names, start_values, type_of

_INDEXED = re.compile(r"(.+)\[(\d+(?:,\d+)*)\]")
_TYPES = ("Real", "Integer", "Boolean")


class ForeignInterface:
    """Variables of an FMU of FMI 2.0 or 3.0; names ``q[1]``, and elements of arrays, are elements of the group ``q``.

    Raises
    ------
    UsageError
        For a file that is not such an FMU.
    """

    robot = None

    def __init__(self, path: Path) -> None:
        if not path.is_file():
            raise UsageError(f"{path}: there is no such FMU.")
        try:
            description: Any = fmpy.read_model_description(str(path), validate=False)
        except Exception as error:
            raise UsageError(f"{path}: the FMU cannot be read: {error}.") from None
        part = description.coSimulation or description.modelExchange
        if description.fmiVersion not in FMI_VERSIONS or part is None:
            raise UsageError(
                f"{path}: expected an FMU of FMI {' or '.join(FMI_VERSIONS)} for co-simulation or model exchange, got "
                f"FMI {description.fmiVersion}{'' if part else ' with neither'}."
            )
        self.path = path
        self.implementation = "CoSimulation" if description.coSimulation else "ModelExchange"
        self.model_name: str = part.modelIdentifier
        self.description: str = description.description or description.modelName
        self.variables = tuple(each for found in description.modelVariables for each in _variables(found))

    @property
    def name(self) -> str:
        """Its name in messages."""
        return self.path.name

    def __iter__(self) -> Any:
        return iter(self.variables)

    def __len__(self) -> int:
        return len(self.variables)

    @cached_property
    def reference(self) -> dict[str, int]:
        """Name to position in the variables."""
        return {v.name: i for i, v in enumerate(self.variables)}


def _variables(found: Any) -> Iterator[Variable]:
    """Yield the elements of a variable that can be connected or set; none of others, such as strings."""
    if type_of(found.type) not in _TYPES or found.causality not in ("input", "output", "parameter"):
        return
    low, high = (None if text is None else float(text) for text in (found.min, found.max))
    unit = found.unit or getattr(found.declaredType, "unit", None)
    settable = found.start is not None and found.causality != "output"
    for name, start in zip(element_names(found.name, found.shape), start_values(found), strict=True):
        match = _INDEXED.fullmatch(name)
        group = match[1] if match else name
        index = tuple(int(i) - 1 for i in match[2].split(",")) if match else ()
        yield Variable(
            group, index, type_of(found.type), found.causality, found.variability or "continuous", unit,
            start if settable else None, low, high, found.description or "",
        )  # fmt: skip
