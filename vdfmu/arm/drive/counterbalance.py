"""Counterbalance: a gas spring between two links that helps the motor to hold the arm. Not in the paper.

A cylinder is mounted on a pivot of the link before the joint and pulls at a crank of the link after it, as on axis 2 of
heavy robots. Its torque acts only on the links, so that the drive carries the rest.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from vdfmu.arm.drive.option import Array, Condition, DriveOption, LinkTorque, row
from vdfmu.compiler.scalar import is_zero


@dataclass(frozen=True, eq=False, kw_only=True)
class CounterbalanceRows:
    """Parameters of the counterbalance."""

    counterbalance: bool = False
    # fmt: off
    F_cb: Array = row(
        "counterbalance", "N", "force of the counterbalance at dead centre", "", 1e9, 0.0, default=0.0, fold="zeros",
        hint="Give 0 for a joint without a counterbalance.")
    D_cb: Array = row(
        "counterbalance", "m", "distance from the joint's axis to the pivot of the cylinder", "", 1e4, 0.0,
        default=0.0, part_of="F_cb", start=1.0)
    r_cb: Array = row(
        "counterbalance", "m", "radius of the crank that the cylinder pulls at", "", 1e4, 0.0, default=0.0,
        part_of="F_cb")
    delta_cb: Array = row(
        "counterbalance", "rad", "angle of the crank from its dead centre at q = 0", "", 1e6, default=0.0,
        part_of="F_cb")
    L_cb: Array = row(
        "counterbalance", "m", "length of the gas column at dead centre", "", 1e6, 0.0, default=0.0, part_of="F_cb",
        hint="It is the volume of the gas there over the area of the piston.", start=1.0)


def stroke(robot: Any, i: int, q: Any) -> tuple[Any, Any]:
    """Stroke ``dl = rho - (D - r)`` [m] of the cylinder of joint i from dead centre at `q` [rad], and its slope.

    ``rho = sqrt(D^2 + r^2 - 2 D r cos(q + delta))`` is the distance of pivot and crank.
    """
    D, r, angle = robot.D_cb[i], robot.r_cb[i], q + robot.delta_cb[i]
    rho = np.sqrt(D * D + r * r - 2.0 * D * r * np.cos(angle))
    return rho - (D - r), D * r * np.sin(angle) / rho


def _gas(robot: Any, i: int, q: Any) -> tuple[Any, Any]:
    """Torque and energy of joint i; zeros without a cylinder."""
    if is_zero(robot.F_cb[i]):
        return 0.0 * q, 0.0 * q
    dl, slope = stroke(robot, i, q)
    share = dl / robot.L_cb[i]
    return -robot.F_cb[i] * slope / (1.0 - share), -robot.F_cb[i] * robot.L_cb[i] * np.log1p(-share)


def counterbalance_torque(robot: Any, q: Any) -> np.ndarray:
    """Torque on the links, ``-F dl'`` with the force ``F = F_0 / (1 - dl / L)`` of a gas of constant temperature.

    It turns the crank towards dead centre and is 0 there. As `q` [rad], (n,) or (n, m) for many states: [N m],
    link-side.
    """
    return np.array([_gas(robot, i, q[i])[0] for i in range(robot.n)])


def counterbalance_energy(robot: Any, q: Any) -> np.ndarray:
    """Energy of the gas, ``-F_0 L ln(1 - dl / L)``, 0 at dead centre. As `q` [rad]: [J]."""
    return np.array([_gas(robot, i, q[i])[1] for i in range(robot.n)])


COUNTERBALANCE = DriveOption(
    link=lambda robot, q, _: LinkTorque(counterbalance_torque(robot, q), counterbalance_energy(robot, q)),
    revolute_only=("F_cb",),
    conditions=(
        Condition("r_cb", "r_cb > 0", lambda robot: robot.r_cb, "The crank has a length."),
        Condition(
            "D_cb",
            "D_cb > r_cb",
            lambda robot: robot.D_cb - robot.r_cb,
            "The pivot is further from the axis than the crank.",
        ),
        Condition(
            "L_cb",
            "L_cb > 2*r_cb",
            lambda robot: robot.L_cb - 2.0 * robot.r_cb,
            "The gas column is longer than its stroke.",
        ),
    ),
)
