"""Temperature of a joint, heated by its losses, and viscous friction that falls with it. Off by default."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from vdfmu.arm.drive.option import Array, DriveOption, OptionState, row
from vdfmu.base.measure import POSITIVE


@dataclass(frozen=True, eq=False, kw_only=True)
class ThermalRows:
    """Parameters of the temperature."""

    thermal: bool = False
    # fmt: off
    T_ref: Array = row("thermal", "K", "temperature at which the viscous friction is f_v", "", 1e4, 0.0)
    T_v: Array = row(
        "thermal", "K", "rise of temperature that reduces the viscous friction to 1/e", "", 1e9, POSITIVE,
        hint="For friction that does not depend on temperature give a large value such as 1e9.")
    T_amb: Array = row("thermal", "K", "temperature of the surroundings", "", 1e4, 0.0)
    C_th: Array = row("thermal", "J/K", "heat capacity of the joint", "", 1e9, POSITIVE)
    G_th: Array = row("thermal", "W/K", "heat flow to the surroundings per rise of temperature", "", 1e6, 0.0)


def warm_viscosity(f_v: Any, robot: Any, T_j: Any = None) -> Any:
    """Viscous friction ``f_v exp(-(T - T_ref) / T_v)``: (n,) [N m s/rad or N s/m], link-side.

    Law of Bittencourt et al. (2010) for the joint of an industrial robot. `f_v` is the friction at T_ref, `T_j`
    (n,) [K] the temperature, by default T_amb.
    """
    T = robot.T_amb if T_j is None else T_j
    return f_v * np.exp((robot.T_ref - T) / robot.T_v)


def temperature_rate(robot: Any, loss: Any, T_j: Any) -> Any:
    """Rate (n,) [K/s] of the temperature `T_j` [K] by the `loss` [W]: ``C T_dot = loss - G (T - T_amb)``."""
    return (loss - robot.G_th * (T_j - robot.T_amb)) / robot.C_th


THERMAL = DriveOption(
    state=OptionState(
        "T_j", "K", "temperature of the joint", "start temperature", lambda robot: robot.T_amb, minimum=0.0, slow=True
    ),
    friction=lambda friction, robot, sliding, T_j: friction._replace(f_v=warm_viscosity(friction.f_v, robot, T_j)),
    rate=lambda robot, motion, T_j: temperature_rate(robot, motion.loss, T_j),
    rest=lambda robot, tau_s: None,
)
