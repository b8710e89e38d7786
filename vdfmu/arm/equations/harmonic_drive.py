"""Harmonic drive: positions (1), and the deformation D(torque), the inverse of the torque estimation (2)-(3)."""

from __future__ import annotations

from typing import Any

import numpy as np

from vdfmu.compiler.scalar import sgn


def wave_generator_position(theta_c: Any, theta_f: Any, ell: Any) -> Any:
    """Position of the wave generator, ``theta_w = (ell + 1) theta_c - ell theta_f``, Eq. (1).

    `theta_c` and `theta_f` [rad] are the positions of the circular spline and the flexspline. With the circular spline
    fixed the ratio is -ell, with the flexspline fixed ell + 1. Deviation: everywhere else the paper takes the ratio as
    +ell, and so do the other functions here.
    """
    return (ell + 1.0) * theta_c - ell * theta_f


def wave_generator_deformation(tau_w: Any, robot: Any) -> Any:
    """Link-side deformation of the wave generator, second term of (3), under motor-side `tau_w` [N m]."""
    side = sgn(tau_w)  # multiplied by tau_w it is |tau_w|, with a slope at 0
    return side / (robot.c_w * robot.ell * robot.K_w0) * -np.expm1(-robot.c_w * (side * tau_w))


def kinematic_error(robot: Any, kappa: Any) -> Any:
    """Kinematic error theta_err of (3), ``A sin(2 ell kappa + phase)`` : (n,) [rad or m], link-side.

    The paper does not define theta_err. Harmonic drives show two periods per turn of the wave generator.
    """
    return robot.theta_err_amplitude * np.sin(2.0 * robot.ell * kappa + robot.theta_err_phase)


def kinematic_error_slope(robot: Any, kappa: Any) -> Any:
    """Slope of the kinematic error, ``d theta_err / d kappa`` : (n,) [-]."""
    phase = 2.0 * robot.ell * kappa + robot.theta_err_phase
    return 2.0 * robot.ell * robot.theta_err_amplitude * np.cos(phase)


def deformation(robot: Any, tau_s: Any) -> Any:
    """Deformation ``D(tau_s) = kappa - q - theta_err``, the inverse of (2)-(3) with ``tau_w = tau_s / ell``.

    D (n,) [rad or m], link-side, is explicit, odd and strictly increasing, whereas (2)-(3) is implicit in the torque.
    `tau_s` (n,) [N m or N], link-side, is the paper's tau_f.
    """
    flexspline = np.arctan(robot.c_f * tau_s) / (robot.c_f * robot.K_f0)
    return flexspline + wave_generator_deformation(tau_s / robot.ell, robot)


def deformation_derivative(robot: Any, tau_s: Any) -> Any:
    """Compliance ``D'(tau_s) > 0`` : (n,) [rad/(N m) or m/N], link-side."""
    flexspline = 1.0 / (robot.K_f0 * (1.0 + (robot.c_f * tau_s) ** 2))
    return flexspline + np.exp(-robot.c_w / robot.ell * abs(tau_s)) / (robot.ell**2 * robot.K_w0)


def spring_energy(robot: Any, tau_s: Any) -> Any:
    """Elastic energy of every drive, the integral of ``t D'(t)`` from 0 to tau_s: (n,) [J]."""
    t = robot.c_f * tau_s
    a = robot.c_w * abs(tau_s) / robot.ell
    flexspline = np.log1p(t * t) / (2.0 * robot.c_f**2 * robot.K_f0)
    wave_generator = -(np.expm1(-a) + a * np.exp(-a)) / (robot.c_w**2 * robot.K_w0)
    return flexspline + wave_generator
