"""A custom drive: a cubic spring with hysteresis, and a Stribeck curve that falls with the temperature."""

from dataclasses import dataclass

import numpy as np

from vdfmu.drive import (
    POSITIVE,
    Array,
    DriveOption,
    OptionState,
    Parallel,
    Spring,
    dahl_energy,
    dahl_loss,
    dahl_rate,
    row,
    sgn,
)


@dataclass(frozen=True, eq=False, kw_only=True)
class CubicRows:
    """Parameters of the spring, table [joints.cubic]."""

    K_1: Array = row("cubic", "stiffness", "stiffness of the spring at rest, link-side", "", 1e12, POSITIVE)
    x_1: Array = row("cubic", "position", "torsion at which it is four times as stiff", "", 1e6, POSITIVE, default=1e-2)
    K_c: Array = row("cubic", "stiffness", "stiffness of the hysteresis, link-side", "", 1e12, POSITIVE, default=2e4)
    f_h3: Array = row("cubic", "torque", "torque at which the hysteresis slips", "", 1e9, POSITIVE, default=2.0)


def torsion(robot, tau_s):
    """Return x of ``tau_s = K_1 (x + x^3 / x_1^2)``, with the hyperbolic form of Cardano's root."""
    side, scale = sgn(tau_s), 2.0 * robot.x_1 / np.sqrt(3.0)
    s = 3.0 * side * tau_s / (robot.K_1 * scale)
    u = np.expm1(np.log1p(s + s * s / (1.0 + np.sqrt(1.0 + s * s))) / 3.0)
    return side * scale * 0.5 * (u + u / (1.0 + u))


def cubic_spring(spring, robot, tau_s):
    """Torsion, its slope, and energy, in place of the harmonic drive's."""
    x = torsion(robot, tau_s)
    share = (x / robot.x_1) ** 2
    return Spring(x, 1.0 / (robot.K_1 * (1.0 + 3.0 * share)), 0.5 * robot.K_1 * x * x * (1.0 + 0.5 * share))


CUBIC = DriveOption(
    state=OptionState("tau_c", "torque", "torque of the hysteresis", "its start, without equilibrium"),
    spring=cubic_spring,
    parallel=lambda robot, stretch, tau_c: Parallel(
        tau_c, dahl_loss(stretch, tau_c, robot.f_h3), dahl_energy(robot.K_c, tau_c)
    ),
    rate=lambda robot, motion, tau_c: dahl_rate(robot.K_c, motion.stretch, tau_c, robot.f_h3),
)


@dataclass(frozen=True, eq=False, kw_only=True)
class WarmRows:
    """Parameters of the friction, table [joints.warm]."""

    T_s: Array = row("warm", "K", "rise of temperature that lowers dry friction to 1/e", "", 1e9, POSITIVE)
    T_0: Array = row("warm", "K", "temperature of the surroundings", "", 1e4, 0.0, default=293.15)
    C_f: Array = row("warm", "J/K", "heat capacity of the joint", "", 1e9, POSITIVE, default=500.0)
    G_f: Array = row("warm", "W/K", "heat flow to the surroundings", "", 1e6, 0.0, default=2.0)


def warm_friction(friction, robot, sliding, T_f):
    """Stribeck and Coulomb friction at a temperature; along a planned motion it is that of the surroundings."""
    if T_f is None:
        return friction
    return friction._replace(dry=friction.dry * np.exp((robot.T_0 - T_f) / robot.T_s))


WARM = DriveOption(
    state=OptionState("T_f", "K", "temperature of the joint", "start temperature", start=lambda robot: robot.T_0),
    friction=warm_friction,
    rate=lambda robot, motion, T_f: (motion.loss - robot.G_f * (T_f - robot.T_0)) / robot.C_f,
    rest=lambda robot, tau_s: None,
)
