"""Units of measurement: SI exponents, units of joint quantities, and a suitable prefix for a number."""

from __future__ import annotations

import math
import re
from functools import lru_cache
from typing import NamedTuple

from vdfmu.base.errors import UsageError


class UnitOfMeasurement(NamedTuple):
    """A unit of FMI and SSP. All are coherent SI units: factor 1, offset 0."""

    name: str
    exponents: dict[str, int]
    """Exponents of the base units kg, m, s, A, K, mol, cd, rad, except zeros."""
    display: dict[str, float]
    """Display unit to its factor, ``value in display unit = factor * value``."""


POSITIVE = 1e-12
"""Smallest positive value in SI units: smaller values underflow in products."""
LARGEST_NUMBER = 1e12
"""Default bound of the absolute value of a number."""
BASE_UNITS = ("kg", "m", "s", "A", "K", "mol", "cd", "rad")
_DERIVED = {
    "N": {"kg": 1, "m": 1, "s": -2}, "J": {"kg": 1, "m": 2, "s": -2}, "W": {"kg": 1, "m": 2, "s": -3},
    "Pa": {"kg": 1, "m": -1, "s": -2}, "Hz": {"s": -1}, "C": {"A": 1, "s": 1},
    "V": {"kg": 1, "m": 2, "s": -3, "A": -1}, "Ohm": {"kg": 1, "m": 2, "s": -3, "A": -2},
    "F": {"kg": -1, "m": -2, "s": 4, "A": 2}, "H": {"kg": 1, "m": 2, "s": -2, "A": -2},
    "Wb": {"kg": 1, "m": 2, "s": -2, "A": -1}, "T": {"kg": 1, "s": -2, "A": -1},
}  # fmt: skip
_DEG = 180.0 / math.pi
_DISPLAY = {
    "s": {"ms": 1e3}, "kg": {"g": 1e3}, "m": {"mm": 1e3}, "m/s": {"mm/s": 1e3}, "N/m": {"N/mm": 1e-3},
    "N.m": {"N.mm": 1e3}, "rad": {"deg": _DEG}, "rad/s": {"deg/s": _DEG},
    **{f"rad/s{k}": {f"deg/s{k}": _DEG} for k in (2, 3, 4)},
}  # fmt: skip
# Quantity to its unit for a revolute and for a prismatic joint. "_m" is motor-side, others are link-side.
_QUANTITIES = {
    "position": ("rad", "m"),
    "velocity": ("rad/s", "m/s"),
    "acceleration": ("rad/s2", "m/s2"),
    "jerk": ("rad/s3", "m/s3"),
    "snap": ("rad/s4", "m/s4"),
    "torque": ("N.m", "N"),
    "per torque": ("1/(N.m)", "1/N"),
    "stiffness": ("N.m/rad", "N/m"),
    "damping": ("N.m.s/rad", "N.s/m"),
    "damping_m": ("N.m.s/rad", "N.m.s/m"),
    "ratio": ("1", "rad/m"),
    "per velocity": ("s/rad", "s/m"),
    "rotor inertia": ("kg.m2", "kg.m"),
}
_FACTOR = re.compile(r"([A-Za-z]+)(-?\d*)")


@lru_cache
def measure(name: str) -> UnitOfMeasurement:
    """Return a unit of measurement by its name: ``N.m``, ``m/s2``, ``1/(N.m)``, ``kg.m2``, ``1``, else UsageError."""
    upper, slash, lower = name.partition("/")
    if lower.startswith("(") and lower.endswith(")"):
        lower = lower[1:-1]
    exponents: dict[str, int] = {}
    for text, sign in ((upper, 1), (lower, -1)):
        for factor in text.split(".") if text != "1" and (text or slash or sign > 0) else ():
            match = _FACTOR.fullmatch(factor)
            base = match and ({match[1]: 1} if match[1] in BASE_UNITS else _DERIVED.get(match[1]))
            if not match or not base:
                raise UsageError(
                    f"expected a unit of measurement such as N.m, m/s2, 1/(N.m) or 1, got {name!r}. The symbols "
                    f"are {', '.join((*BASE_UNITS, *_DERIVED))}."
                )
            for symbol, exponent in base.items():
                exponents[symbol] = exponents.get(symbol, 0) + sign * exponent * int(match[2] or 1)
    ordered = {symbol: exponents[symbol] for symbol in BASE_UNITS if exponents.get(symbol)}
    return UnitOfMeasurement(name, ordered, _DISPLAY.get(name, {}))


def coherent(name: str) -> tuple[str, float]:
    """Return the SI unit of a display unit and the conversion factor: ``("rad", pi / 180)`` for ``deg``."""
    return next(((unit, 1.0 / shown[name]) for unit, shown in _DISPLAY.items() if name in shown), (name, 1.0))


def derivative_of(name: str) -> str:
    """Return the unit of the time derivative: ``rad/s`` of ``rad``, ``m/s2`` of ``m/s``."""
    upper, _, lower = name.partition("/")
    if not lower:
        return f"{upper}/s"
    factors = lower.strip("()").split(".")
    if re.fullmatch(r"s\d*", factors[-1]):
        factors[-1] = f"s{int(factors[-1][1:] or 1) + 1}"
    else:
        factors.append("s")
    return f"{upper}/{factors[0]}" if len(factors) == 1 else f"{upper}/({'.'.join(factors)})"


def unit_of(quantity: str, joint_type: str) -> str:
    """Return the unit of a joint's quantity, or a unit itself: ``unit_of("torque", "prismatic")`` is ``"N"``."""
    if quantity in _QUANTITIES:
        return _QUANTITIES[quantity][joint_type == _SLIDING]
    return measure(quantity).name


class Shown(NamedTuple):
    """Unit of measurement in figures and tables, and the factor from the SI unit."""

    unit: str
    factor: float = 1.0


def shown_as(quantity: str, joint_type: str = "revolute") -> Shown:
    """Return how a quantity of a joint is shown: angles in deg, lengths in mm, others in their SI unit.

    >>> shown_as("velocity").unit, shown_as("velocity", "prismatic"), shown_as("torque")
    ('deg/s', Shown(unit='mm/s', factor=1000.0), Shown(unit='N.m', factor=1.0))
    """
    unit = unit_of(quantity, joint_type)
    display = _DISPLAY.get(unit, {}) if unit.partition("/")[0] in ("rad", "m") else {}
    return next((Shown(name, factor) for name, factor in display.items()), Shown(unit))


class JointType(NamedTuple):
    """A type of joint: how it moves, its units of measurement, and its usual sizes."""

    slides: bool
    """Whether it slides along its axis instead of turning about it."""
    noun: str
    """Noun for its torque."""
    mistaken: str
    """The unit, as a word, in which positions beyond `far` were probably given by mistake."""
    far: float
    """Position that joints of arms do not reach [rad or m]."""
    fastest: float
    """Speed that joints of arms do not reach [rad/s or m/s]."""
    travel: float
    """Largest position on a slider without limits [rad or m]."""
    stroke: float
    """Length of a first motion, unless end stops make it shorter [rad or m]."""

    @property
    def name(self) -> str:
        """Its name in files."""
        return _SLIDING if self.slides else _TURNING

    @property
    def shown(self) -> Shown:
        """Display of its position, with the factor from rad or m."""
        return shown_as("position", self.name)

    def unit(self, quantity: str) -> str:
        """Return the unit of a quantity; see :func:`unit_of`."""
        return unit_of(quantity, self.name)

    @property
    def position_factors(self) -> dict[str, float]:
        """Units in which a file may state positions, and their factors to rad or m."""
        return {self.unit("position"): 1.0, self.shown.unit: 1.0 / self.shown.factor}


_TURNING, _SLIDING = "revolute", "prismatic"
JOINT_TYPES = {
    # Common joints move less than two turns, and a number above 13 is probably in degrees. The wrists of SCARA
    # robots reach 45 rad/s. Limits in public robot files, up to 1e4 rad/s, are not used here.
    _TURNING: JointType(False, "torque", "degrees", 4.0 * math.pi, 60.0, math.pi, 0.5),
    # The longest arms in space are 17 m long, and links in millimetres exceed 20. Linear motors reach 15 m/s.
    _SLIDING: JointType(True, "force", "mm", 20.0, 20.0, 0.5, 0.1),
}
"""Types of joints by their names in files."""


def spaced(unit: str) -> str:
    """Return a unit as printed in papers: ``N m`` for ``N.m``, ``m/s²`` for ``m/s2``."""
    return re.sub(r"(?<=[A-Za-z])-?\d+", lambda match: match[0].translate(_RAISED), unit.replace(".", " "))


_INCHES = {"mm": 25.4, "cm": 2.54, "in": 1.0}
_LENGTH = re.compile(r"(\d+\.?\d*)\s*(mm|cm|in)")


def inches(option: str, text: str) -> float:
    """Return a length such as ``85mm``, ``17cm`` or ``3.3in`` in inches; UsageError unless it is 20 mm to 2 m."""
    match = _LENGTH.fullmatch(text.strip())
    length = float(match[1]) / _INCHES[match[2]] if match else 0.0
    if not 20.0 <= 25.4 * length <= 2000.0:
        raise UsageError(f"{option} must be a length from 20mm to 2000mm, got {text}. Try 85mm, 17cm or 3.3in.")
    return length


_PREFIXED = re.compile(r"(?P<milli>m(?=m))?(?P<base>deg|rad|m|s|N|W|J|V|A|Hz)(?P<rest>(?![\w²³⁴]).*)")
_RAISED = str.maketrans("-0123456789", "⁻⁰¹²³⁴⁵⁶⁷⁸⁹")
_PREFIXES = {6: "M", 3: "k", 0: "", -3: "m", -6: "µ", -9: "n"}
NONE = 1e-9
"""Fraction of a peak below which a number is rounding noise."""


def fitted(unit: str, largest: float) -> tuple[str, int]:
    """Return a prefixed unit and a power of ten that leave at most three digits before the point of the largest value.

    Values are divided by ten to that power. Values from 0.1 to 10,000 stay unchanged. The unit is empty if no prefix
    fits.

    >>> fitted("deg", 2e-5), fitted("mm", 0.004), fitted("N.m", 3e5), fitted("rad", 1e-13)
    (('µdeg', -6), ('µm', -3), ('kN.m', 3), ('', -15))
    """
    if not largest or not math.isfinite(largest) or 0.1 <= largest < 1e4:
        return unit, 0
    exponent, match = 3 * math.floor(math.log10(largest) / 3 + 1e-12), _PREFIXED.fullmatch(unit)
    prefix = _PREFIXES.get(exponent - (3 if match and match["milli"] else 0))
    if match and prefix is not None and (prefix not in ("k", "M") or match["base"] in ("N", "W", "J", "V", "A", "Hz")):
        return prefix + match["base"] + match["rest"], exponent
    return (unit, 0) if 0.01 <= largest < 1e5 else ("", exponent)


def quantity(value: float, unit: str = "", peak: float = 0.0) -> str:
    """Return a number with three digits and a fitting unit, ``2.89 µm``; 0 if it is below `NONE` times the `peak`."""
    if not math.isfinite(value):
        return "–"
    value = 0.0 if abs(value) < NONE * abs(peak) else float(f"{value:.3g}")
    fit, power = fitted(unit, abs(value))
    if fit:
        value, unit = float(f"{value / 10.0**power:.3g}"), fit
    text = number(value)
    return f"{f'−{text[1:]}' if text.startswith('-') else text} {unit}".rstrip()


def per_cent(share: float) -> str:
    """Return a fraction in per cent with two digits: ``3.4 %``; ``infinite`` if it is not finite."""
    return f"{number(100.0 * share, 2)} %" if math.isfinite(share) else "infinite"


def number(value: float, digits: int = 3) -> str:
    """Return a number with some significant digits, in the notation of all pages and messages.

    >>> number(0.0123456), number(98765.4), number(6.7e-13), number(2.5e7)
    ('0.0123', '98800', '6.7e-13', '2.5e7')
    """
    if not math.isfinite(value):
        return f"{value:g}"
    mantissa, _, exponent = f"{value:.{digits - 1}e}".partition("e")
    if value and not -3 <= int(exponent) < 6:
        return f"{float(mantissa):g}e{int(exponent)}"
    return f"{float(f'{mantissa}e{exponent}'):.12g}"
