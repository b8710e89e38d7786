"""Parameters whose start value a function of other parameters gives.

Python calculates them where a unit is made, a scenario is resolved or an FMU is built: the function may be any, and an
FMU has no code of it. So the FMU has a parameter more, a mark of the values that were used, and refuses others.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from functools import wraps
from graphlib import CycleError, TopologicalSorter
from inspect import Parameter as Argument
from inspect import signature
from typing import Any

import numpy as np

from vdfmu.base.errors import UnitError
from vdfmu.base.text import kind_text
from vdfmu.compiler.scalar.generic import minimum, sgn, where
from vdfmu.compiler.unit.declaration import Declared, Parameter
from vdfmu.compiler.unit.machine import Machine
from vdfmu.compiler.unit.place import place

MARK = "design_mark"
"""Parameter of a unit of which some parameters follow from others."""
_ROUNDING = 1e-12
"""Relative tolerance of marks: above the rounding of their sums, below a change by 1e-7 of one value in a hundred."""


def followers(declared: Mapping[str, Declared]) -> dict[str, tuple[str, ...]]:
    """Return the parameters that follow from others, to these, in an order in which they can be calculated."""
    found = {
        name: sources
        for name, d in declared.items()
        if isinstance(d, Parameter) and (sources := tuple(a for a in _arguments(d) if a in declared))
    }
    try:
        order = list(TopologicalSorter(found).static_order())
    except CycleError as error:
        raise UnitError(f"{' <- '.join(error.args[1])}: these parameters follow from each other.") from None
    for name, sources in found.items():
        if wrong := [one for one in sources if not isinstance(declared[one], Parameter)]:
            raise UnitError(f"{name}: start: expected arguments that are parameters, got {', '.join(wrong)}.")
        if len(_arguments(declared[name])) > len(sources) + 1:
            others = [one for one in _arguments(declared[name]) if one not in sources]
            raise UnitError(
                f"{name}: start: expected parameters and one argument for the robot, got {', '.join(others)}."
            )
    return {name: found[name] for name in order if name in found}


def _arguments(declared: Declared) -> list[str]:
    """Return the names of the arguments of a start function that must be given."""
    if not callable(declared.start):
        return []
    try:
        listed = signature(declared.start).parameters.values()
    except (TypeError, ValueError):  # of a function in C
        return []
    kinds = (Argument.POSITIONAL_ONLY, Argument.POSITIONAL_OR_KEYWORD)
    return [one.name for one in listed if one.kind in kinds and one.default is one.empty]


def roots(follows: Mapping[str, tuple[str, ...]]) -> tuple[str, ...]:
    """Return the parameters from which others follow, and that follow from none."""
    return tuple(dict.fromkeys(one for sources in follows.values() for one in sources if one not in follows))


def mark_parameter(follows: Mapping[str, tuple[str, ...]]) -> Parameter:
    """Return the declaration of the mark."""
    text = f"Mark of {', '.join(roots(follows))}, from which {', '.join(follows)} followed; 0: not looked at"
    return Parameter("1", text=text, minimum=0.0)


def mark(values: Sequence[Any]) -> Any:
    """Return a number that differs for other values: a sum of their logarithms and signs, with weights."""
    flat = np.concatenate([np.ravel(one) for one in values])
    weights = 1.0 + np.arange(1, len(flat) + 1) * 0.6180339887498949 % 1.0
    size = np.log1p(1e150 * minimum(np.abs(flat), 1e150))
    return 1.0 + np.sum(weights * size * (3.0 + sgn(flat)))


def with_mark(method: Callable[[Any], Mapping[str, tuple[str, Any]]]) -> Callable[[Any], Any]:
    """Return a method ``requirements`` that requires the mark too."""

    @wraps(method)
    def requirements(unit: Any) -> dict[str, tuple[str, Any]]:
        sources, own = unit.follows[MARK], [name for name in unit.follows if name != MARK]
        known = getattr(unit, MARK)
        away = np.abs(known - mark([getattr(unit, name) for name in sources]))
        expected = (
            f"the mark of {', '.join(sources)}, for which {', '.join(own)} followed in Python: set these by vdfmu, "
            f"or {', '.join(own)} too and {MARK} = 0"
        )
        return {**method(unit), MARK: (expected, where(known > 0.0, _ROUNDING * known - away, 1.0))}

    return requirements


def start_arrays(unit: type[Any], robot: Machine | None, given: Mapping[str, Any]) -> dict[str, Any]:
    """Return the start values of parameters and inputs in their shapes, by name; those in `given` are as they are.

    Raises
    ------
    UnitError
        For a function that fails, or gives what does not fit.
    """
    declared = {name: d for name, d in unit.declared_for(robot).items() if d.set_by is None}
    values = dict(given)
    for name, d in declared.items():
        if name not in values and name not in unit.follows:
            values[name] = d.start_value(robot)
    for name, sources in unit.follows.items():
        if name in declared and name not in values:
            values[name] = _followed(unit, robot, name, {one: values[one] for one in sources})
    return values


def _followed(unit: type[Any], robot: Machine | None, name: str, values: Mapping[str, Any]) -> Any:
    declared = unit.declared[name]
    where_ = f"{place(unit, name)}: {unit.__name__}: {name}"
    try:
        if name == MARK:
            found = mark(list(values.values()))
        else:
            found = declared.start(*(values.get(one, robot) for one in _arguments(declared)))
        array = np.asarray(found, dtype=float)
    except Exception as error:
        of = ", ".join(f"{one} = {' '.join(str(value).split())}" for one, value in values.items())
        raise UnitError(f"{where_}: start: the function fails for {of}: {kind_text(error)}.") from error
    low, high = declared.minimum, declared.maximum
    if not (
        np.isfinite(array).all() and (low is None or (array >= low).all()) and (high is None or (array <= high).all())
    ):
        raise UnitError(f"{where_}: start: expected finite numbers within the limits, got {array}.")
    return declared.shaped(array, robot)
