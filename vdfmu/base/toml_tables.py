"""Reads TOML tables and collects all problems.

Each problem is a line with the file, the key, the expected and the actual value, and a fix. Joints count from 1, as in
the paper and in FMI names.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from functools import reduce
from operator import getitem
from typing import Any, NamedTuple, cast

import numpy as np
import numpy.typing as npt

from vdfmu.base.arrays import Floats
from vdfmu.base.errors import ModelError, VdfmuError
from vdfmu.base.measure import LARGEST_NUMBER, POSITIVE
from vdfmu.base.option import FORMER
from vdfmu.base.text import FORBIDDEN, LONGEST_NAME, name_fault, nearest, printable

_LONGEST_TEXT = 4000
"""Longest text that is not a name [characters]."""


class Problems:
    """Problems of a file or another source of data, named `where`."""

    def __init__(self, where: str) -> None:
        self.where = where
        self.lines: list[str] = []

    def add(self, key: str, expected: str, got: str, fix: str) -> None:
        """Note an unexpected value of `key`."""
        key = printable(key)
        self.lines.append(f"{self.where}: {key}: expected {expected}, got {got}. {fix}".rstrip())

    def take(self, error: VdfmuError, key: str = "") -> None:
        """Note an error, with a key if given. Problems of another file already have their place."""
        if isinstance(error, ModelError):
            self.lines += error.problems
        else:
            self.lines += [f"{self.where}: {f'{key}: ' if key else ''}{line}" for line in str(error).splitlines()]

    def raise_any(self) -> None:
        """Raise `ModelError` with all problems, if any."""
        if self.lines:
            raise ModelError(self.lines)


def value_text(value: object) -> str:
    """Return a value, shortened for a message."""
    if isinstance(value, dict):
        return "a table"
    if isinstance(value, str):
        value = f'"{value}"'
    elif isinstance(value, bool):
        value = "true" if value else "false"
    try:
        text = str(value)
    except ValueError:  # integers with more than 4300 digits
        return "a number of thousands of digits"
    return printable(text)


def as_number(value: object) -> float | None:
    """Return a TOML number as float (infinity if too large), None for anything else."""
    if isinstance(value, bool) or not isinstance(value, int | float):
        return None
    try:
        return float(value)
    except OverflowError:
        return math.inf


class Table:
    """A TOML table. Wrong values are noted in `problems` and read as NaN, so that reading continues.

    `path` is its key in the file, "" for the whole file. Keys that are not `allowed` are problems, unless `allowed` is
    None.
    """

    def __init__(self, problems: Problems, data: object, path: str, allowed: Sequence[str] | None) -> None:
        self.problems = problems
        self.path = path
        self.usable = isinstance(data, dict)
        self.data: dict[str, Any] = cast("dict[str, Any]", data) if self.usable else {}
        if not self.usable:
            keys = "" if allowed is None else f"Its keys are: {', '.join(allowed)}."
            problems.add(path or "the file", "a table", value_text(data), keys)
        for key in self.data:
            if allowed is not None and key not in allowed:
                now = FORMER.get(key, "")
                fix = f"It is now {now}." if now in allowed else nearest(key, allowed)
                problems.add(self.key(key), "a known key", "an unknown one", fix)

    def key(self, key: str) -> str:
        """Return the full key of an entry."""
        return f"{self.path}.{key}" if self.path else key

    def value(self, key: str, expected: str, default: object = None) -> Any:
        """Return an entry. A missing one without a default is a problem and reads as None."""
        if key in self.data:
            return self.data[key]
        if default is None and self.usable:
            self.problems.add(self.key(key), expected, "nothing", "The key is missing: add it.")
        return default

    def table(self, key: str, allowed: Sequence[str]) -> Table:
        """Return a table. A missing entry is a problem."""
        value = self.value(key, "a table")
        if value is None:
            table = self.optional_table(key, allowed)
            table.usable = False
            return table
        return Table(self.problems, value, self.key(key), allowed)

    def optional_table(self, key: str, allowed: Sequence[str] | None = None) -> Table:
        """Return a table, empty if the entry is missing."""
        return Table(self.problems, self.data.get(key, {}), self.key(key), allowed)

    def text(self, key: str, default: str | None = None, choices: Sequence[str] = ()) -> str:
        """Return a string, one of `choices` if there are any."""
        expected = " or ".join(f'"{choice}"' for choice in choices) or "a string that is not empty"
        value = self.value(key, expected, default)
        if value is None:
            return ""
        if not isinstance(value, str):
            self.problems.add(self.key(key), expected, value_text(value), "Write a string in quotes.")
            return ""
        if choices and value not in choices:
            self.problems.add(self.key(key), expected, value_text(value), nearest(value, choices))
        elif not value.strip() and default != "":
            self.problems.add(self.key(key), expected, value_text(value), "Write a text that is not empty.")
        else:
            self.check_text(self.key(key), value)
        return value

    def check_text(self, place: str, value: str) -> None:
        """Note `FORBIDDEN` characters and a text that is too long."""
        match = FORBIDDEN.search(value.replace("\n", " ").replace("\t", " "))
        if match:
            got = value_text(value[max(0, match.start() - 20) :])
            self.problems.add(place, "a text without control characters", got, "Remove them.")
        if len(value) > _LONGEST_TEXT:
            self.problems.add(place, f"at most {_LONGEST_TEXT} characters", str(len(value)), "Shorten it.")

    def flag(self, key: str, default: bool) -> bool:
        """Return true or false."""
        value = self.data.get(key, default)
        if not isinstance(value, bool):
            self.problems.add(self.key(key), "true or false", value_text(value), "Write it without quotes.")
            return default
        return value

    def name(self, key: str) -> str:
        """Return a string that can name a file, such as the folder of results of a scenario."""
        value = self.label(key)
        if value:
            self.check_name(self.key(key), value)
        return value

    def check_name(self, place: str, name: str, dots: bool = True) -> None:
        """Note a name that cannot name a file."""
        if expected := name_fault(name, dots):
            self.problems.add(place, expected, value_text(name), "It names files and folders.")

    def label(self, key: str) -> str:
        """Return a short string of a single line."""
        value = self.text(key)
        if len(value) > LONGEST_NAME:
            most = f"at most {LONGEST_NAME} characters"
            self.problems.add(self.key(key), most, str(len(value)), "It names files and folders.")
        elif "\n" in value or "\t" in value:
            self.problems.add(self.key(key), "one line without tabs", value_text(value), "Write one line.")
        return value

    def number(
        self,
        key: str,
        unit: str,
        default: float | None = None,
        *,
        above: float | None = None,
        at_least: float | None = None,
        at_most: float = LARGEST_NUMBER,
        fix: str = "",
    ) -> float:
        """Return a number, NaN if it is wrong. `at_most` limits its absolute value."""
        bounds = _Bounds(unit, above, at_least, at_most)
        value = self.value(key, bounds.expected("a finite number"), default)
        return math.nan if value is None else self._checked(value, self.key(key), bounds, fix)

    def numbers(
        self,
        key: str,
        shape: tuple[int, ...],
        unit: str,
        default: npt.ArrayLike | None = None,
        *,
        scalar: bool = False,
        above: float | None = None,
        at_least: float | None = None,
        at_most: float = LARGEST_NUMBER,
        infinite: bool = False,
        fix: str = "",
    ) -> Floats:
        """Return an array of numbers. Wrong entries are NaN.

        `scalar` allows a single number for all entries, `infinite` allows plus infinity.
        """
        size = " x ".join(str(k) for k in shape)
        bounds = _Bounds(unit, above, at_least, at_most, infinite)
        expected = bounds.expected(f"{size} finite numbers" + (" or one for all" if scalar else ""))
        value = self.value(key, expected, cast(Any, default))
        if value is None:
            return np.full(shape, math.nan)
        if scalar and as_number(value) is not None:
            return np.full(shape, self._checked(value, self.key(key), bounds, fix))
        actual = shape_of(value)
        if actual != shape:
            got = value_text(value) if actual is None else f"{' x '.join(str(k) for k in actual) or 'one number'}"
            rows = "" if len(shape) < 2 else " as a list of rows"
            self.problems.add(self.key(key), expected, got, f"Write {size} numbers{rows}. {fix}".strip())
            return np.full(shape, math.nan)
        result = np.empty(shape)
        for index in np.ndindex(shape):
            place = self.key(key) + "".join(f"[{k + 1}]" for k in index)
            result[index] = self._checked(reduce(getitem, index, value), place, bounds, fix)
        return result

    def _checked(self, value: object, place: str, bounds: _Bounds, fix: str) -> float:
        number = as_number(value)
        if number is None:
            expected = bounds.expected("a finite number")
            self.problems.add(place, expected, value_text(value), f"Write a number. {fix}".strip())
            return math.nan
        expected = bounds.broken(number)
        if expected is not None:
            self.problems.add(place, expected, value_text(value), fix or "Correct the number.")
            return math.nan
        return number


class _Bounds(NamedTuple):
    """Range of a finite number. `at_most` limits its absolute value."""

    unit: str
    above: float | None
    at_least: float | None
    at_most: float
    infinite: bool = False

    def expected(self, noun: str, bound: str | None = None) -> str:
        """Return the expected value with its bound and unit."""
        if bound is None:
            low = f" >= {self.at_least:g}" if self.at_least is not None else ""
            bound = f" > {self.above:g}" if self.above is not None else low
        return f"{noun}{bound}{' in ' + self.unit if self.unit else ''}"

    def broken(self, number: float) -> str | None:
        """Return the expected value for a number out of range, or None if it is in range."""
        noun = "a finite number"
        if self.infinite and number == math.inf:
            return None
        if not math.isfinite(number) or (self.above is not None and not number > self.above):
            return self.expected(noun)
        if self.at_least is not None and not number >= self.at_least:
            return self.expected(noun, f" >= {self.at_least:g}")
        if self.above == 0 and number < POSITIVE:
            return self.expected(noun, f" >= {POSITIVE:g}")
        if abs(number) > self.at_most:
            return self.expected("a number", f" of at most {self.at_most:g}")
        return None


def shape_of(value: object) -> tuple[int, ...] | None:
    """Return the shape of nested lists, () for anything else, None if the rows differ in shape."""
    if not isinstance(value, list):
        return ()
    rows = cast("list[object]", value)
    shapes = {shape_of(row) for row in rows}
    if len(shapes) > 1 or None in shapes:
        return None
    inner = shapes.pop() if shapes else ()
    return (len(rows), *cast("tuple[int, ...]", inner))
