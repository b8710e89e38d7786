"""Units of measurement: what tools need of them, and which one a joint's quantity has."""

from __future__ import annotations

import math
import re
from dataclasses import dataclass
from functools import lru_cache

from vdfmu.base.errors import UsageError


@dataclass(frozen=True)
class UnitOfMeasurement:
    """A unit of measurement of FMI and SSP; all are coherent SI, so factor 1 and offset 0."""

    name: str
    exponents: dict[str, int]
    """Exponents of the base units kg, m, s, A, K, mol, cd, rad; those that are 0 are left out."""
    display: dict[str, float]
    """Display unit to its factor, ``value in display unit = factor * value``."""


POSITIVE = 1e-12
"""Smallest value of what must be positive, in SI units: smaller ones underflow in products."""
LARGEST_NUMBER = 1e12
"""Largest absolute value of a number that has no bound of its own."""
_BASE = ("kg", "m", "s", "A", "K", "mol", "cd", "rad")
_DERIVED = {
    "N": {"kg": 1, "m": 1, "s": -2},
    "J": {"kg": 1, "m": 2, "s": -2},
    "W": {"kg": 1, "m": 2, "s": -3},
    "Pa": {"kg": 1, "m": -1, "s": -2},
    "Hz": {"s": -1},
    "C": {"A": 1, "s": 1},
    "V": {"kg": 1, "m": 2, "s": -3, "A": -1},
    "Ohm": {"kg": 1, "m": 2, "s": -3, "A": -2},
    "F": {"kg": -1, "m": -2, "s": 4, "A": 2},
    "H": {"kg": 1, "m": 2, "s": -2, "A": -2},
    "Wb": {"kg": 1, "m": 2, "s": -2, "A": -1},
    "T": {"kg": 1, "s": -2, "A": -1},
}
_DEG = 180.0 / math.pi
_DISPLAY = {
    "s": {"ms": 1e3},
    "kg": {"g": 1e3},
    "rad": {"deg": _DEG},
    "rad/s": {"deg/s": _DEG},
    "rad/s2": {"deg/s2": _DEG},
    "rad/s3": {"deg/s3": _DEG},
    "rad/s4": {"deg/s4": _DEG},
    "m": {"mm": 1e3},
    "m/s": {"mm/s": 1e3},
    "N/m": {"N/mm": 1e-3},
    "N.m": {"N.mm": 1e3},
}
# Quantity to unit, for a revolute and for a prismatic joint. "_m" is motor-side, else link-side.
_QUANTITIES = {
    "position": ("rad", "m"),
    "velocity": ("rad/s", "m/s"),
    "acceleration": ("rad/s2", "m/s2"),
    "jerk": ("rad/s3", "m/s3"),
    "snap": ("rad/s4", "m/s4"),
    "torque": ("N.m", "N"),
    "stiffness": ("N.m/rad", "N/m"),
    "damping": ("N.m.s/rad", "N.s/m"),
    "per torque": ("1/(N.m)", "1/N"),
    "ratio": ("1", "rad/m"),
    "per velocity": ("s/rad", "s/m"),
    "rotor inertia": ("kg.m2", "kg.m"),
    "damping_m": ("N.m.s/rad", "N.m.s/m"),
}
WIDE_ANGLE = 4.0 * math.pi
"""Two turns [rad]: more than the joints of common arms make, less than 13 degrees."""
_FACTOR = re.compile(r"([A-Za-z]+)(-?\d*)")


@lru_cache
def measure(name: str) -> UnitOfMeasurement:
    """Return a unit of measurement by its name: ``N.m``, ``m/s2``, ``1/(N.m)``, ``kg.m2``, ``1``; else UsageError."""
    upper, slash, lower = name.partition("/")
    if lower.startswith("(") and lower.endswith(")"):
        lower = lower[1:-1]
    exponents: dict[str, int] = {}
    for text, sign in ((upper, 1), (lower, -1)):
        for factor in text.split(".") if text != "1" and (text or slash or sign > 0) else ():
            match = _FACTOR.fullmatch(factor)
            base = match and ({match[1]: 1} if match[1] in _BASE else _DERIVED.get(match[1]))
            if not match or not base:
                raise UsageError(
                    f"expected a unit of measurement such as N.m, m/s2, 1/(N.m) or 1, got {name!r}. The symbols "
                    f"are {', '.join((*_BASE, *_DERIVED))}."
                )
            for symbol, exponent in base.items():
                exponents[symbol] = exponents.get(symbol, 0) + sign * exponent * int(match[2] or 1)
    found = {symbol: exponents[symbol] for symbol in _BASE if exponents.get(symbol)}
    return UnitOfMeasurement(name, found, _DISPLAY.get(name, {}))


def coherent(name: str) -> tuple[str, float]:
    """Return the unit of the SI for a display unit, and what one is worth in it: ``("rad", pi / 180)`` for ``deg``."""
    return next(((unit, 1.0 / shown[name]) for unit, shown in _DISPLAY.items() if name in shown), (name, 1.0))


def derivative_of(name: str) -> str:
    """Return the unit of the derivative in time: ``rad/s`` of ``rad``, ``m/s2`` of ``m/s``."""
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
    """Return the unit of a joint's quantity: ``unit_of("torque", "prismatic")`` is ``"N"``.

    The name of a unit of measurement stands for itself.
    """
    if quantity in _QUANTITIES:
        return _QUANTITIES[quantity][joint_type == "prismatic"]
    return measure(quantity).name
