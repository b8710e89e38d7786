"""Axes of a parameter study: ``controller.K_p[2]=lin(500, 5000, 20)``."""

from __future__ import annotations

import math
import re
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from vdfmu.base.errors import UsageError
from vdfmu.base.option_types import type_problem

_FORMS = {
    "lin": "lin(FROM, TO) or, with the number of values in a grid, lin(FROM, TO, N)",
    "log": "log(FROM, TO) or, with the number of values in a grid, log(FROM, TO, N)",
    "normal": "normal(MEAN, DEVIATION)",
    "lognormal": "lognormal(MEDIAN, DEVIATION of the logarithm)",
}
_EXPECTED = f"{'; '.join(_FORMS.values())}; or values, 1, 2, 5. A star before it, *lin(0.9, 1.1), makes them factors"
_CALL = re.compile(r"(\w+)\s*\((.*)\)")

MOST_POINTS = 10_000_000
"""More are refused: a grid of many axes is more than one thinks."""
OPTIONS = ("robot", "master", "step", "stop")
"""Targets that are options of a run, not parameters."""


def is_option(target: str) -> bool:
    """Whether a target is an option of a run, not a parameter, so that another value means another system."""
    return target in OPTIONS or target.startswith("unit:")


@dataclass(frozen=True)
class Axis:
    """A quantity that varies, and how."""

    target: str
    """``component.parameter``, with or without an index, ``robot.parameter``, or an option of a run:
    ``robot``, ``master``, ``step``, ``stop``, ``unit:COMPONENT``."""
    form: str
    """``values``, or the name of a distribution: ``lin`` and ``log`` spread evenly, ``normal`` and ``lognormal``."""
    numbers: tuple[float, ...] = ()
    """Parameters of the distribution."""
    values: tuple[Any, ...] = ()
    """Its values, numbers or words; for ``lin`` and ``log`` the values of a grid; empty if there is no such number."""
    factor: bool = False
    """Whether a value multiplies the scenario's, element by element."""

    def at(self, share: ArrayLike) -> NDArray[Any]:
        """Values at shares of the distribution (its quantiles), each between 0 and 1; for a list the value there."""
        u = np.asarray(share, dtype=float)
        if self.form == "values":
            index = np.minimum((u * len(self.values)).astype(int), len(self.values) - 1)
            return np.array(self.values)[index]
        low, high = self.numbers
        if self.form == "lin":
            return low + u * (high - low)
        if self.form == "log":
            return low * (high / low) ** u
        from scipy.special import ndtri

        # the shares of 0 and 1, which low-discrepancy sequences begin with, are infinitely far away
        z = ndtri(np.clip(u, 2.0**-32, 1.0 - 2.0**-32))
        return low + high * z if self.form == "normal" else low * np.exp(high * z)

    def __str__(self) -> str:
        star = "*" if self.factor else ""
        if self.form == "values":
            return f"{self.target}={star}{', '.join(map(str, self.values))}"
        count = [str(len(self.values))] if self.values else []
        return f"{self.target}={star}{self.form}({', '.join([*(f'{x!r}' for x in self.numbers), *count])})"


def read_axes(over: Mapping[str, Any] | Sequence[str]) -> list[Axis]:
    """Read axes, ``TARGET=FORM`` texts, or a mapping of target to form or to a sequence of values.

    UsageError with a line for each that cannot be read.
    """
    if problem := type_problem("vary", "Mapping[str, Any] | Sequence[str]", over):
        raise UsageError(problem)
    pairs: list[tuple[str, Any]] = []
    problems: list[str] = []
    if isinstance(over, Mapping):
        pairs = list(over.items())
    else:
        for text in over:
            target, equals, form = text.partition("=")
            if equals and target.strip():
                pairs.append((target.strip(), form.strip()))
            else:
                problems.append(f"{text}: expected TARGET=FORM, such as controller.K_p[1]=lin(500, 5000, 10).")
    axes: list[Axis] = []
    for target, form in pairs:
        try:
            axes.append(_axis(target, form))
        except ValueError as error:
            problems.append(f"{target}: {error}")
    counts = Counter(axis.target for axis in axes)
    problems += [f"{target}: expected once, got {n} times." for target, n in counts.items() if n > 1]
    if problems:
        raise UsageError("\n".join(problems))
    return axes


def _axis(target: str, form: Any) -> Axis:
    if not isinstance(form, str):
        array = np.atleast_1d(np.array(form, object))
        if array.ndim > 1:
            raise ValueError(f"expected a value, or several in a row, got the shape {array.shape}.")
        values = tuple(v.item() if isinstance(v, np.generic) else v for v in array)
        return Axis(target, "values", values=_checked(values))
    factor, text = form.startswith("*"), form.lstrip("*").strip()
    call = _CALL.fullmatch(text)
    if call is None:
        values = tuple(_value(word.strip()) for word in text.strip("[]").split(","))
        return Axis(target, "values", values=_checked(values), factor=factor)
    name = {"uniform": "lin", "loguniform": "log"}.get(call[1], call[1])
    if name not in _FORMS:
        raise ValueError(f"expected {_EXPECTED}; got {form}.")
    numbers = [_value(word.strip()) for word in call[2].split(",")]
    counted = name in ("lin", "log") and len(numbers) == 3
    if len(numbers) != 2 + counted or not all(isinstance(x, (int, float)) and math.isfinite(x) for x in numbers):
        raise ValueError(f"expected {_FORMS[name]}, got {form}.")
    low, high = float(numbers[0]), float(numbers[1])
    if name == "log" and not 0.0 < low * high:
        raise ValueError(f"expected two numbers of one sign, neither of them 0, got {form}.")
    if name == "lognormal" and low == 0.0 or name.endswith("normal") and high < 0.0:
        raise ValueError(f"expected a deviation that is not negative, and a median that is not 0, got {form}.")
    axis = Axis(target, name, (low, high), factor=factor)
    if not counted:
        return axis
    n = numbers[2]
    if n != int(n) or not 1 <= n <= MOST_POINTS:
        raise ValueError(f"expected a whole number of values of at least 1, at most {MOST_POINTS}, got {form}.")
    return Axis(target, name, (low, high), tuple(axis.at(np.linspace(0.0, 1.0, int(n))).tolist()), factor)


def _value(text: str) -> Any:
    """Return a number, where the text is one."""
    try:
        return float(text) if not re.fullmatch(r"[+-]?\d+", text) else int(text)
    except ValueError:
        return text


def _checked(values: tuple[Any, ...]) -> tuple[Any, ...]:
    if not values or "" in values:
        raise ValueError(f"expected {_EXPECTED}; got {', '.join(map(str, values)) or 'nothing'}.")
    wrong = [v for v in values if isinstance(v, float) and not math.isfinite(v)]
    if wrong:
        raise ValueError(f"expected finite values, got {wrong[0]}.")
    return tuple(map(str, values)) if any(isinstance(v, str) for v in values) else values
