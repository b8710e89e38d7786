"""LuGre bristles (Canudas de Wit et al. 1995) instead of tanh (v / eps): friction that holds at rest. Off by default.

The bristles are Dahl's element, with the level of (54) as its limit. Their damping fades with speed as ``sigma_1 / (1 +
sigma_1 |v| / (4 g))``, because constant damping above ``4 g / |v|`` generates energy (Barabanov and Ortega 2000).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from vdfmu.arm.drive.dahl import dahl_energy, dahl_rate
from vdfmu.arm.drive.option import Array, DriveOption, Friction, OptionState, Sliding, row
from vdfmu.base.measure import POSITIVE

_LEAST = 1e-9
"""Smallest friction [N m or N] of a bristle, because the rates divide by it."""


@dataclass(frozen=True, eq=False, kw_only=True)
class BristlesRows:
    """Parameters of the bristles."""

    bristles: bool = False
    # fmt: off
    sigma_0: Array = row("bristles", "stiffness", "stiffness of the bristles, link-side", "", 1e12, POSITIVE)
    sigma_1: Array = row("bristles", "damping", "damping of the bristles, link-side", "", 1e9, 0.0)


def bristle_rate(robot: Any, velocity: Any, tau_z: Any, level: Any) -> Any:
    """Rate (n,) [N m/s or N/s] of the bristles' torque `tau_z` [N m or N], link-side; they slip at `level`."""
    return dahl_rate(robot.sigma_0, velocity, tau_z, level + _LEAST)


def bristle_torque(robot: Any, velocity: Any, tau_z: Any, level: Any) -> Any:
    """Friction of the bristles with their damping: (n,) [N m or N], link-side. Parameters as above."""
    damping = robot.sigma_1 / (1.0 + 0.25 * robot.sigma_1 * abs(velocity) / (level + _LEAST))
    return tau_z + damping * bristle_rate(robot, velocity, tau_z, level) / robot.sigma_0


def _friction(friction: Friction, robot: Any, sliding: Sliding, tau_z: Any) -> Friction:
    if tau_z is None:
        return friction
    velocity, level = sliding.velocity, sliding.level
    stored = tau_z * bristle_rate(robot, velocity, tau_z, level) / robot.sigma_0
    dry, energy = bristle_torque(robot, velocity, tau_z, level), dahl_energy(robot.sigma_0, tau_z)
    return friction._replace(dry=dry, stored=stored, energy=energy)


BRISTLES = DriveOption(
    state=OptionState(
        "tau_z", "torque", "torque of the bristles of friction, link-side", "start of the bristles, without equilibrium"
    ),
    dry_parameters=("sigma_0", "sigma_1"),
    replaces_dry_friction=True,
    friction=_friction,
    rate=lambda robot, motion, tau_z: bristle_rate(robot, motion.velocity, tau_z, motion.level),
)
