"""Dahl's element: a spring that slips, with its torque as state. Hysteresis and bristles are made of it."""

from __future__ import annotations

from typing import Any


def dahl_rate(stiffness: Any, velocity: Any, torque: Any, limit: Any) -> Any:
    """Rate of the torque, ``stiffness (v - |v| torque / limit)`` (Dahl 1968, exponent 1): (n,) [N m/s or N/s].

    At ``|torque| = limit`` it slips; at rest it holds. Against a motion that turns back it is as stiff as a spring.

    Parameters
    ----------
    stiffness, limit : (n,) [N m/rad or N/m, N m or N]
    velocity : (n,) [rad/s or m/s] at which the element is stretched
    torque : (n,) [N m or N]
    """
    return stiffness * (velocity - abs(velocity) * torque / limit)


def dahl_loss(velocity: Any, torque: Any, limit: Any) -> Any:
    """Power that turns into heat, ``torque v - d/dt (torque^2 / (2 stiffness))``, never negative: (n,) [W]."""
    return abs(velocity) * torque * torque / limit


def dahl_energy(stiffness: Any, torque: Any) -> Any:
    """Elastic energy: (n,) [J]."""
    return torque * torque / (2.0 * stiffness)
