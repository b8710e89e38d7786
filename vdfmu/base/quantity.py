"""Numbers in units of measurement that fit their size; ``web/numbers.js`` writes them alike."""

from __future__ import annotations

import math
import re

_PREFIXED = re.compile(r"(?P<milli>m(?=m))?(?P<base>deg|rad|m|s|N|W|J|V|A|Hz)(?P<rest>(?![\w²³⁴]).*)")
_PREFIXES = {6: "M", 3: "k", 0: "", -3: "m", -6: "µ", -9: "n"}
NONE = 1e-9
"""Share of a peak below which a number is rounding: 0."""


def fitted(unit: str, largest: float) -> tuple[str, int]:
    """Return the unit in which a largest value has at most three digits before its point, and the power of ten.

    Values are divided by ten to that power. From 0.1 to 10,000 they stay as they are. The unit is empty where no
    prefix fits.

    >>> fitted("deg", 2e-5), fitted("mm", 0.004), fitted("N.m", 3e5), fitted("rad", 1e-13)
    (('µdeg', -6), ('µm', -3), ('kN.m', 3), ('', -15))
    """
    if not largest or not math.isfinite(largest) or 0.1 <= largest < 1e4:
        return unit, 0
    exponent, found = 3 * math.floor(math.log10(largest) / 3 + 1e-12), _PREFIXED.fullmatch(unit)
    prefix = _PREFIXES.get(exponent - (3 if found and found["milli"] else 0))
    if found and prefix is not None and (prefix not in ("k", "M") or found["base"] in ("N", "W", "J", "V", "A", "Hz")):
        return prefix + found["base"] + found["rest"], exponent
    return (unit, 0) if 0.01 <= largest < 1e5 else ("", exponent)


def quantity(value: float, unit: str = "", peak: float = 0.0) -> str:
    """Return a number with three digits and the unit that fits it: ``2.89e-6, "m"`` is ``2.89 µm``.

    Numbers below `NONE` of the `peak`, in the same unit, are 0.
    """
    if not math.isfinite(value):
        return "–"
    value = 0.0 if abs(value) < NONE * abs(peak) else float(f"{value:.3g}")
    fit, power = fitted(unit, abs(value))
    if fit:
        value, unit = float(f"{value / 10.0**power:.3g}"), fit
    size = abs(value)
    if value and not 1e-3 <= size < 1e6:
        mantissa, _, exponent = f"{value:.2e}".partition("e")
        text = f"{float(mantissa):g}·10{str(int(exponent)).translate(_RAISED)}"
    else:
        text = f"{value:.3g}" if size < 1000.0 else f"{value:.0f}"
    return f"{text} {unit}".rstrip().replace("-", "−")


_RAISED = str.maketrans("-0123456789", "⁻⁰¹²³⁴⁵⁶⁷⁸⁹")
