"""The values that a variable may have, with the same conversion and messages wherever a value comes from."""

from __future__ import annotations

import math
from collections.abc import Mapping
from contextlib import suppress
from numbers import Integral, Number
from typing import Any, NamedTuple

from vdfmu.base.measure import POSITIVE

NO_LIMIT = 1e12
"""Start value of a limit that does not limit, because FMI has no portable infinity."""
_WORDS = {"Boolean": "true or false", "String": "a text", "Binary": "bytes, or a text of hexadecimal digits"}


class Domain(NamedTuple):
    """Type and limits of a variable."""

    type: str = "Real"
    """Real, Integer, Enumeration, Boolean, String or Binary."""
    names: Mapping[str, int] | None = None
    """Names of the values of an enumeration."""
    low: float | None = None
    """Least value. `POSITIVE` means "above 0"."""
    high: float | None = None
    unit: str | None = None
    start: Any = None

    def read(self, value: Any) -> Any:
        """Convert a value to the type of the variable.

        A text is read as a number, as true or false, or as the name of a value. A number of any type of Python and
        numpy is accepted if the variable can represent it exactly: an integer keeps all of its 64 bits, a float that is
        a whole number is accepted as an integer, and 0 and 1 as booleans. A boolean is not accepted as a number.
        Infinity is accepted for a limit whose start value is `NO_LIMIT`.

        Raises
        ------
        ValueError
            With the expected and the actual value.
        """
        if getattr(value, "ndim", None) == 0:
            value = value.item()  # a scalar of numpy
        if self.type in ("String", "Binary"):
            return self._content(value)
        text = value.strip() if isinstance(value, str) else ""
        if self.names and text in self.names:
            return self.names[text]
        if self.type == "Boolean":
            value = {"true": 1, "false": 0}.get(text.lower(), int(value) if isinstance(value, bool) else value)
        number = _number(value, whole=self.type != "Real")
        if number is None:
            raise self.misfit(value)
        if number == math.inf and self.type == "Real" and self.start == NO_LIMIT:
            return NO_LIMIT
        if fault := self.fault(number):
            raise ValueError(fault)
        if self.type == "Real":
            return float(number)
        if number != int(number):
            raise ValueError(f"expected a whole number, got {number:.9g}")
        return bool(number) if self.type == "Boolean" else int(number)

    def fault(self, number: float) -> str | None:
        """Return ``expected .., got ..`` for a number that the variable may not have, else None."""
        low, high = self.low, self.high
        if self.names:
            if number in self.names.values():
                return None
            expected = " or ".join(f"{value} ({name})" for name, value in self.names.items())
        elif self.type == "Boolean":
            if number in (0, 1):
                return None
            expected = self._expected()
        elif not -math.inf < number < math.inf:  # an int may exceed all floats
            expected = "a finite number"
        elif low is not None and number < low:
            expected = "a number above 0" if low == POSITIVE and number <= 0.0 else f"at least {self._shown(low)}"
        elif high is not None and number > high:
            expected = f"at most {self._shown(high)}"
        else:
            return None
        return f"expected {expected}, got {self._shown(number)}"

    def misfit(self, value: Any) -> ValueError:
        """Return the error of a value of another type."""
        return ValueError(f"expected {self._expected()}, got {value!r:.60}")

    def _expected(self) -> str:
        words = {**_WORDS, "Real": self._shown("a number", " in")}
        return " or ".join(self.names) if self.names else words.get(self.type, "a whole number")

    def _shown(self, number: float | str, word: str = "") -> str:
        text = f"{number:.9g}" if isinstance(number, float) else str(number)
        return text + (f"{word} {self.unit}" if self.unit and self.unit != "1" else "")

    def _content(self, value: Any) -> str | bytes:
        if isinstance(value, str) and self.type == "String":
            return value
        if self.type == "Binary":
            if isinstance(value, bytes):
                return value
            with suppress(ValueError, TypeError):
                return bytes.fromhex(value)
        raise self.misfit(value)


def _number(value: Any, whole: bool) -> float | None:
    """Return a number or a text as a number, else None. `whole` keeps all digits of integers."""
    if isinstance(value, str) and "_" not in value:  # Python reads 1_000, but FMI and SSP do not allow it
        for kind in (int, float) if whole else (float,):
            with suppress(ValueError):
                return kind(value)
    if isinstance(value, bool | complex) or not isinstance(value, Number):
        return None
    if whole and isinstance(value, Integral) and abs(int(value)) < 2**64:
        return int(value)
    try:
        return float(value)  # pyright: ignore[reportArgumentType]  # real numbers have __float__
    except OverflowError:
        return math.inf
