"""Dahl's element, a spring that slips, with its torque as state. Hysteresis and bristles use it."""

from __future__ import annotations

from typing import Any


def dahl_rate(stiffness: Any, velocity: Any, torque: Any, limit: Any) -> Any:
    """Rate of the torque, ``stiffness (v - |v| torque / limit)`` (Dahl 1968, exponent 1): (n,) [N m/s or N/s].

    At ``|torque| = limit`` it slips, and at rest it holds. When the motion reverses it is as stiff as a spring.
    `velocity` [rad/s or m/s] is the rate at which the element is stretched. `torque` and `limit` are in N m or N,
    `stiffness` per rad or m.
    """
    return stiffness * (velocity - abs(velocity) * torque / limit)


def dahl_loss(velocity: Any, torque: Any, limit: Any) -> Any:
    """Dissipated power, ``torque v - d/dt (torque^2 / (2 stiffness))``, never negative: (n,) [W]."""
    return abs(velocity) * torque * torque / limit


def dahl_energy(stiffness: Any, torque: Any) -> Any:
    """Elastic energy: (n,) [J]."""
    return torque * torque / (2.0 * stiffness)
