"""Units of the interface: base-unit exponents for tools, display units for people."""

from __future__ import annotations

import math
from dataclasses import dataclass, field

from vdfmu.model.measure import unit_of

__all__ = ["DERIVATIVES", "UNITS", "Unit", "unit_of"]


@dataclass(frozen=True)
class Unit:
    """A unit of FMI and SSP; all are coherent SI, so factor 1 and offset 0.

    Attributes
    ----------
    name : str
    exponents : dict
        Exponents of the base units kg, m, s, rad.
    display : dict
        Display unit to its factor, ``value in display unit = factor * value``.
    """

    name: str
    exponents: dict[str, int]
    display: dict[str, float] = field(default_factory=dict)


_DEG = 180.0 / math.pi
UNITS = {
    unit.name: unit
    for unit in (
        Unit("1", {}),
        Unit("s", {"s": 1}, {"ms": 1e3}),
        Unit("1/s", {"s": -1}),
        Unit("s/rad", {"s": 1, "rad": -1}),
        Unit("s/m", {"s": 1, "m": -1}),
        Unit("kg", {"kg": 1}, {"g": 1e3}),
        Unit("kg.m", {"kg": 1, "m": 1}),
        Unit("kg.m2", {"kg": 1, "m": 2}),
        Unit("J", {"kg": 1, "m": 2, "s": -2}),
        Unit("rad", {"rad": 1}, {"deg": _DEG}),
        Unit("rad/s", {"rad": 1, "s": -1}, {"deg/s": _DEG}),
        Unit("rad/s2", {"rad": 1, "s": -2}, {"deg/s2": _DEG}),
        Unit("rad/s3", {"rad": 1, "s": -3}, {"deg/s3": _DEG}),
        Unit("rad/s4", {"rad": 1, "s": -4}, {"deg/s4": _DEG}),
        Unit("rad/m", {"rad": 1, "m": -1}),
        Unit("m", {"m": 1}, {"mm": 1e3}),
        Unit("m/s", {"m": 1, "s": -1}, {"mm/s": 1e3}),
        Unit("m/s2", {"m": 1, "s": -2}),
        Unit("m/s3", {"m": 1, "s": -3}),
        Unit("m/s4", {"m": 1, "s": -4}),
        Unit("N", {"kg": 1, "m": 1, "s": -2}),
        Unit("1/N", {"kg": -1, "m": -1, "s": 2}),
        Unit("N/s", {"kg": 1, "m": 1, "s": -3}),
        Unit("N/m", {"kg": 1, "s": -2}, {"N/mm": 1e-3}),
        Unit("N.s/m", {"kg": 1, "s": -1}),
        Unit("N.m", {"kg": 1, "m": 2, "s": -2}, {"N.mm": 1e3}),
        Unit("N.m/s", {"kg": 1, "m": 2, "s": -3}),
        Unit("1/(N.m)", {"kg": -1, "m": -2, "s": 2}),
        Unit("N.m/rad", {"kg": 1, "m": 2, "s": -2, "rad": -1}),
        Unit("N.m.s/rad", {"kg": 1, "m": 2, "s": -1, "rad": -1}),
        Unit("N.m.s/m", {"kg": 1, "m": 1, "s": -1}),
    )
}

DERIVATIVES = {
    "rad": "rad/s", "rad/s": "rad/s2", "m": "m/s", "m/s": "m/s2", "N.m": "N.m/s", "N": "N/s",
}  # fmt: skip
"""Unit of a state to that of its derivative."""
