"""The motor's winding and its current loop, limited by voltage and current. Not in the paper; off by default."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from vdfmu.arm.drive.option import Array, DriveOption, OptionState, row
from vdfmu.base.measure import POSITIVE
from vdfmu.compiler.scalar import clip


@dataclass(frozen=True, eq=False, kw_only=True)
class WindingRows:
    """Parameters of the winding."""

    winding: bool = False
    # fmt: off
    k_t: Array = row(
        "winding", "N.m/A", "torque constant of the motor, and its back-EMF in V.s/rad", "", 1e6, POSITIVE)
    R_w: Array = row("winding", "Ohm", "resistance of the winding", "", 1e9, 0.0)
    L_w: Array = row("winding", "H", "inductance of the winding", "", 1e6, POSITIVE)
    U_max: Array = row("winding", "V", "largest voltage", "", 1e9, POSITIVE)
    i_max: Array = row("winding", "A", "largest current", "", 1e9, POSITIVE)
    w_i: Array = row("winding", "1/s", "bandwidth of the current loop", "", 1e9, POSITIVE)


def winding_voltage(robot: Any, tau: Any, kappa_dot: Any, i_m: Any) -> Any:
    """Voltage (n,) [V] of a current loop that compensates the winding and follows with its bandwidth.

    When the voltage saturates at speed, current and torque lag behind. `tau` (n,) [N m] is the commanded torque,
    motor-side; its current is limited to i_max. `kappa_dot` is in rad/s or m/s, `i_m` in A.
    """
    wanted = clip(tau / robot.k_t, -robot.i_max, robot.i_max)
    free = robot.L_w * robot.w_i * (wanted - i_m) + _drop(robot, kappa_dot, i_m)
    return clip(free, -robot.U_max, robot.U_max)


def current_rate(robot: Any, tau: Any, kappa_dot: Any, i_m: Any) -> Any:
    """Rate of the current, ``L i_dot = u - R i - k_t ell kappa_dot``: (n,) [A/s]. Parameters as above."""
    return (winding_voltage(robot, tau, kappa_dot, i_m) - _drop(robot, kappa_dot, i_m)) / robot.L_w


def _drop(robot: Any, kappa_dot: Any, i_m: Any) -> Any:
    """Voltage across the resistance plus back-EMF."""
    return robot.R_w * i_m + robot.k_t * robot.ell * kappa_dot


WINDING = DriveOption(
    state=OptionState("i_m", "A", "current of the motor", "start current, without equilibrium"),
    motor=lambda tau, robot, kappa_dot, i_m: robot.k_t * i_m,
    rate=lambda robot, motion, i_m: current_rate(robot, motion.tau, motion.kappa_dot, i_m),
    rest=lambda robot, tau_s: tau_s / (robot.ell * robot.k_t),
)
