"""Numbers with three digits in units of measurement that fit their size; ``web/numbers.js`` writes them alike."""

from __future__ import annotations

import math

_PREFIXES = {-9: "n", -6: "µ", -3: "m", 0: "", 3: "k", 6: "M"}
_DOWN, _BOTH = {"m", "s", "rad", "deg"}, {"N", "N.m", "J", "W", "Hz"}
"""Symbols that take prefixes for small numbers, and those that also take them for large ones."""
NONE = 1e-9
"""Share of a peak below which a number is rounding: 0."""


def quantity(value: float, unit: str = "", peak: float = 0.0) -> str:
    """Return a number with three digits and its unit: ``2.89e-6, "m"`` is ``2.89 µm``.

    mm becomes a multiple of m; from 0.1 to 1000 numbers stay as they are. Those below `NONE` of the `peak`, in the
    same unit, are 0.
    """
    if unit == "mm":
        value, unit, peak = 1e-3 * value, "m", 1e-3 * peak
    if not math.isfinite(value):
        return "–"
    value = 0.0 if abs(value) < NONE * abs(peak) else float(f"{value:.3g}")
    symbol = unit.partition("/")[0]
    power = 3 * math.floor(math.log10(abs(value)) / 3.0 + 1e-12) if value else 0
    if symbol in _DOWN | _BOTH and -9 <= power:
        power = 0 if abs(value) >= 0.1 and power < 0 else min(power, 6 if symbol in _BOTH else 0)
        value, unit = float(f"{value / 10.0**power:.3g}"), f"{_PREFIXES[power]}{unit}"
    size = abs(value)
    if value and not 1e-3 <= size < 1e6:
        mantissa, _, exponent = f"{value:.2e}".partition("e")
        text = f"{float(mantissa):g}·10{str(int(exponent)).translate(_RAISED)}"
    else:
        text = f"{value:.3g}" if size < 1000.0 else f"{value:.0f}"
    return f"{text} {unit}".rstrip().replace("-", "−")


_RAISED = str.maketrans("-0123456789", "⁻⁰¹²³⁴⁵⁶⁷⁸⁹")
