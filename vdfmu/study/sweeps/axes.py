"""Axes of a parameter study, ``controller.K_p[2]=lin(500, 5000, 20)``, and its points: combinations of their values."""

from __future__ import annotations

import math
import re
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from vdfmu.base.arrays import Floats
from vdfmu.base.csv_file import MOST_FAULTS, open_csv
from vdfmu.base.errors import UsageError
from vdfmu.base.extras import module_of_extra
from vdfmu.base.option import FORMER, check_type
from vdfmu.study.options import SAMPLES

_FORMS = {
    "lin": "lin(FROM, TO) or, with the number of values in a grid, lin(FROM, TO, N)",
    "log": "log(FROM, TO) or, with the number of values in a grid, log(FROM, TO, N)",
    "normal": "normal(MEAN, DEVIATION)",
    "lognormal": "lognormal(MEDIAN, DEVIATION of the logarithm)",
}
_EXPECTED = f"{'; '.join(_FORMS.values())}; or values, 1, 2, 5. A star before it, *lin(0.9, 1.1), makes them factors"
_RANGE = re.compile(r"([-+.\de]+):([-+.\de]+)(?::([-+.\de]+))?")
"""A range as other tools write it, 500:4000:8."""
_CALL = re.compile(r"(\w+)\s*\((.*)\)")

MOST_POINTS = 10_000_000
"""Largest number of points, because a grid of many axes easily has more than intended."""
OPTIONS = ("robot", "algorithm", "step", "stop")
"""Targets that are options of a run instead of parameters."""


def is_option(target: str) -> bool:
    """Return whether a target is an option of a run, not a parameter, so that another value means another system."""
    return target in OPTIONS or target.startswith("unit:")


@dataclass(frozen=True)
class Axis:
    """A quantity that varies, and how it varies."""

    target: str
    """``component.parameter``, with or without an index, ``robot.parameter``, or an option of a run:
    ``robot``, ``algorithm``, ``step``, ``stop``, ``unit:COMPONENT``."""
    form: str
    """``values``, or the name of a distribution: ``lin`` and ``log`` spread evenly, ``normal`` and ``lognormal``."""
    numbers: tuple[float, ...] = ()
    """Parameters of the distribution."""
    values: tuple[Any, ...] = ()
    """Values, numbers or texts; for ``lin`` and ``log`` those of a grid; empty without a number of values."""
    factor: bool = False
    """Whether a value multiplies the scenario's, element by element."""

    def at(self, share: ArrayLike) -> NDArray[Any]:
        """Return the values at `shares` of the distribution, quantiles between 0 and 1; for a list the value there."""
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

        # the shares 0 and 1, with which low-discrepancy sequences begin, are infinitely far away
        z = ndtri(np.clip(u, 2.0**-32, 1.0 - 2.0**-32))
        return low + high * z if self.form == "normal" else low * np.exp(high * z)

    def __str__(self) -> str:
        star = "*" if self.factor else ""
        if self.form == "values":
            return f"{self.target}={star}{', '.join(map(str, self.values))}"
        count = [str(len(self.values))] if self.values else []
        return f"{self.target}={star}{self.form}({', '.join([*(f'{x!r}' for x in self.numbers), *count])})"


def read_axes(over: Mapping[str, Any] | Sequence[str]) -> list[Axis]:
    """Read axes, ``TARGET=FORM``, or target to form or values. UsageError has a line for each faulty one."""
    check_type("vary", "Mapping[str, Any] | Sequence[str]", over)
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
    problems += [f"{target} is now {FORMER[target]}." for target in counts if target in FORMER]
    problems += [f"{target}: expected once, got {n} times." for target, n in counts.items() if n > 1]
    if problems:
        raise UsageError("\n".join(problems))
    return axes


def _axis(target: str, form: Any) -> Axis:
    if not isinstance(form, str):
        array = np.atleast_1d(np.array(form, object))
        if array.ndim > 1:
            raise ValueError(f"expected a value or a list of values, got the shape {array.shape}.")
        values = tuple(v.item() if isinstance(v, np.generic) else v for v in array)
        return Axis(target, "values", values=_checked(values))
    factor, text = form.startswith("*"), form.lstrip("*").strip()
    if (ends := _RANGE.fullmatch(text)) is not None:
        star = "*" * factor
        raise ValueError(f"expected {_EXPECTED}; got {form}. Write {star}lin({ends[1]}, {ends[2]}, {ends[3] or 'N'}).")
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
        raise ValueError(f"expected two numbers of the same sign, neither of them 0, got {form}.")
    if name == "lognormal" and low == 0.0 or name.endswith("normal") and high < 0.0:
        raise ValueError(f"expected a deviation that is not negative, and a median that is not 0, got {form}.")
    axis = Axis(target, name, (low, high), factor=factor)
    if not counted:
        return axis
    n = numbers[2]
    if n != int(n) or not 1 <= n <= MOST_POINTS:
        raise ValueError(f"expected a whole number of values from 1 to {MOST_POINTS}, got {form}.")
    return Axis(target, name, (low, high), tuple(axis.at(np.linspace(0.0, 1.0, int(n))).tolist()), factor)


def _value(text: str) -> Any:
    """Return a number if the text is a number, else the text."""
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


Points = dict[str, NDArray[Any]]
"""Target of an axis to its values, (n,) each, where row k is point k."""


def draw(axes: Sequence[Axis], sample: str, n: int | None = None, seed: int = 0) -> tuple[list[Axis], Points]:
    """Draw the points of axes; the result is deterministic.

    The `sample` is ``grid``, all combinations of the values, the last axis running fastest; ``lhs`` (Latin hypercube),
    ``sobol`` (scrambled) or ``random``, `n` points; ``saltelli``, n (2 d + 2) points, or ``morris``, n (d + 1) points,
    for d axes; or the path of a CSV file with a line of targets, then a line per point. The file's axes are returned
    with the points. UsageError for axes that do not fit the sample, a bad file, or too many points.
    """
    if seed < 0:
        raise UsageError(f"seed: expected a number of at least 0, got {seed}.")
    if sample not in SAMPLES:
        if axes and Path(sample).suffix:
            raise UsageError(f"sample: {sample} has its own axes. Leave out --vary.")
        if n is not None and Path(sample).is_file():
            raise UsageError(f"points: {sample} has the points; omit it.")
        return _read(sample)
    if not axes:
        raise UsageError("vary: expected at least one axis, such as controller.K_p=lin(500, 5000, 10).")
    if sample == "grid":
        return list(axes), _grid(axes, n)
    if n is None or not 1 <= n <= MOST_POINTS:
        raise UsageError(f"points: expected a number of points of {sample} up to {MOST_POINTS:g}, got {n}.")
    count = n * {"saltelli": 2 * len(axes) + 2, "morris": len(axes) + 1}.get(sample, 1)
    if count > MOST_POINTS:
        raise UsageError(f"points: expected at most {MOST_POINTS:g} points, got {count}.")
    drawn = shares(len(axes), sample, n, seed)
    return list(axes), {axis.target: axis.at(drawn[:, i]) for i, axis in enumerate(axes)}


def _grid(axes: Sequence[Axis], n: int | None) -> Points:
    if n is not None:
        raise UsageError("points: a grid has as many points as its axes define. Omit it, or choose lhs or sobol.")
    words = "expected values, or their number, lin(FROM, TO, N), in a grid; lhs and sobol need none."
    if without := [f"{axis}: {words}" for axis in axes if not axis.values]:
        raise UsageError("\n".join(without))
    size = math.prod(len(axis.values) for axis in axes)
    if size > MOST_POINTS:
        raise UsageError(f"vary: expected a grid of at most {MOST_POINTS:g} points, got {size}.")
    index = np.indices([len(axis.values) for axis in axes]).reshape(len(axes), -1)
    return {axis.target: np.array(axis.values)[i] for axis, i in zip(axes, index, strict=True)}


def shares(d: int, sample: str, n: int, seed: int) -> Floats:
    """Return points in the unit cube, one per row: for each axis the share of its distribution, see `Axis.at`."""
    from scipy.stats import qmc

    drawn: Any = {"seed": seed}  # rng from SciPy 1.15 on, which accepts both
    if sample == "random":
        return np.random.default_rng(seed).random((n, d))
    if sample == "lhs":
        return qmc.LatinHypercube(d, **drawn).random(n)
    if sample == "sobol":
        if n & (n - 1) == 0:
            return qmc.Sobol(d, **drawn).random_base2(n.bit_length() - 1)
        return qmc.Sobol(d, **drawn).random(2 ** n.bit_length())[:n]
    return module_of_extra("sensitivities", "sensitivity", f"sample {sample}").shares_of(d, sample, n, seed)


def _read(path: str) -> tuple[list[Axis], Points]:
    if not Path(path).exists():
        raise UsageError(f"sample: expected {', '.join(SAMPLES)} or a CSV file, got {path}.")
    with open_csv(Path(path)) as file:
        head = [*map(str.strip, file.headings)]
        lines = [(line, [file.pointed(cell).strip() for cell in row]) for line, row in file]
    if not lines:
        raise UsageError(f"{path}: expected a line of targets, then a line for each point.")
    problems = [
        f"{path}: line {k}: expected {len(head)} values, got {len(row)}." for k, row in lines if len(row) != len(head)
    ] or [
        f"{path}: line {k}: {name}: expected one value, got {cell!r}."
        for k, row in lines
        for name, cell in zip(head, row, strict=True)
        if "," in cell or not cell
    ]
    if file.unit_row:
        problems = [f"{path}: line 2: expected values of a point, got units. Leave the line out."]
    if problems:
        raise UsageError("\n".join(problems[:MOST_FAULTS]))
    columns = {name: ", ".join(c) for name, *c in zip(head, *(row for _, row in lines), strict=True)}
    if len(columns) < len(head):
        raise UsageError(f"{path}: expected each target once, got {', '.join(head)}.")
    try:
        axes = read_axes(columns)
    except UsageError as error:
        raise UsageError("\n".join(f"{Path(path)}: {line}" for line in str(error).splitlines())) from None
    return axes, {axis.target: np.array(axis.values) for axis in axes}
