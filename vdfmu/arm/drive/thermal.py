"""Temperature of a joint, heated by its losses, and the viscous friction that falls with it. Off by default."""

from __future__ import annotations

from typing import Any

import numpy as np


def viscosity(robot: Any, T_j: Any = None) -> Any:
    """Viscous friction ``f_v exp(-(T - T_ref) / T_v)``: (n,) [N m s/rad or N s/m], link-side.

    The law of Bittencourt et al. (2010) for the joint of an industrial robot.

    Parameters
    ----------
    T_j : (n,) [K], optional
        Temperature; default that of the surroundings.
    """
    if not robot.thermal:
        return robot.f_v
    T = robot.T_amb if T_j is None else T_j
    return robot.f_v * np.exp((robot.T_ref - T) / robot.T_v)


def temperature_rate(robot: Any, loss: Any, T_j: Any) -> Any:
    """Rate of the temperature, ``C T_dot = loss - G (T - T_amb)``: (n,) [K/s].

    Parameters
    ----------
    loss : (n,) [W] power that friction and hysteresis turn into heat
    T_j : (n,) [K]
    """
    return (loss - robot.G_th * (T_j - robot.T_amb)) / robot.C_th


def ambient(robot: Any) -> Any:
    """Temperature of the surroundings: (n,) [K]."""
    return robot.T_amb
