"""Values that the user gives: their variables, found and checked."""

from __future__ import annotations

from collections.abc import Mapping

from vdfmu.base.errors import UsageError
from vdfmu.base.text import close_to
from vdfmu.engine.fmu.description import Description
from vdfmu.engine.fmu.variables import FmuVariable
from vdfmu.engine.package.system import Value, spread
from vdfmu.engine.plan.conversion import as_type

Starts = dict[str, dict[str, tuple[FmuVariable, Value]]]
"""Variables and their values by component and name."""


def overrides(descriptions: Mapping[str, Description], parameters: Mapping[str, Value]) -> Starts:
    """Resolve ``component.variable`` names given by the user; one without an index means all elements."""
    starts: Starts = {}
    problems: list[str] = []
    for full, value in parameters.items():
        owners = [name for name in descriptions if full.startswith(name + ".")]
        if not owners:
            problems.append(f"parameter {full!r}: no component of that name; there are {', '.join(descriptions)}")
            continue
        wanted = {
            owner: named for owner in owners if (named := _named(descriptions[owner].variables, full[len(owner) + 1 :]))
        }
        if not wanted:
            owner = max(owners, key=len)
            name = full[len(owner) + 1 :]
            whole = dict.fromkeys(v.partition("[")[0] for v in descriptions[owner].variables)
            problems.append(f"parameter {full!r}: {owner} has no variable {name!r}" + close_to(name, whole))
        for owner, named in wanted.items():
            try:
                for one, element in zip(named, spread(value, named), strict=True):
                    variable = descriptions[owner].variables[one]
                    if not variable.settable:
                        raise ValueError(why_not(variable))
                    starts.setdefault(owner, {})[one] = (variable, as_type(element, variable))
            except ValueError as error:
                problems.append(f"parameter {full!r}: {error}")
    if problems:
        raise UsageError("\n".join(problems))
    return starts


def _named(variables: Mapping[str, FmuVariable], name: str) -> list[str]:
    return [name] if name in variables else [v for v in variables if v.startswith(f"{name}[")]


def why_not(variable: FmuVariable) -> str:
    """Say why a variable cannot be set."""
    text = f"is not settable: causality {variable.causality}, variability {variable.variability}"
    return text + (f", initial {variable.initial}" if variable.initial else "")
