"""Joint torque from the positions on both sides of the drive, Eq. (2)-(3), as printed and in a consistent form."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from vdfmu.arm.equations.harmonic_drive import (
    deformation,
    deformation_derivative,
    kinematic_error,
    wave_generator_deformation,
)
from vdfmu.compiler.scalar import clip, sgn

_PASSES = 16


class Estimates(NamedTuple):
    """Spring torque as printed, `tau_f_hat`, and consistent, `tau_s_hat`, each (n,) [N m or N, link-side]."""

    tau_f_hat: Any
    tau_s_hat: Any


def estimate_torque(robot: Any, delta: Any, tau_w: Any, tau_hat_max: Any) -> Any:
    """Flexspline torque from measured deformation and motor torque, Eq. (2)-(3): (n,) [N m or N], link-side.

    Deviation: the angle is limited to that of `tau_hat_max`, so that the pole of the tangent is out of reach.

    Parameters
    ----------
    delta : (n,) [rad or m] total deformation without the kinematic error, ``kappa - q - theta_err``
    tau_w : (n,) [N m] torque at the wave generator, motor-side
    tau_hat_max : (n,) [N m or N] largest estimate, link-side
    """
    largest = np.arctan(robot.c_f * tau_hat_max)
    angle = robot.c_f * robot.K_f0 * (delta - wave_generator_deformation(tau_w, robot))
    return clip(np.tan(clip(angle, -largest, largest)) / robot.c_f, -tau_hat_max, tau_hat_max)


def torque_of_deformation(robot: Any, delta: Any, tau_hat_max: Any) -> Any:
    """Spring torque at the deformation `delta`: the inverse of D, limited to ``+- tau_hat_max`` as above.

    The wave generator carries ``tau_s / ell``. For positive torques D is increasing and concave, so Newton's method
    from below stays below and converges. It starts from the larger of two lower bounds: with the stiffness at rest, and
    with a fully wound wave generator. For catalogue drives four iterations reach rounding; with every parameter varied
    over four decades or more, 16 reach 2e-10 of the torque.
    """
    size = clip(abs(delta), 0.0, deformation(robot, tau_hat_max))
    wound_up = clip(size - 1.0 / (robot.c_w * robot.ell * robot.K_w0), 0.0, size)
    tau_s = np.tan(robot.c_f * robot.K_f0 * wound_up) / robot.c_f
    at_rest = size / deformation_derivative(robot, 0.0 * size)
    tau_s = clip(tau_s, at_rest, tau_hat_max)
    for _ in range(_PASSES):
        tau_s = tau_s + (size - deformation(robot, tau_s)) / deformation_derivative(robot, tau_s)
        tau_s = clip(tau_s, 0.0, tau_hat_max)
    return sgn(delta) * tau_s


def torque_estimates(robot: Any, q: Any, kappa: Any, tau: Any, tau_hat_max: Any) -> Estimates:
    """Estimate the spring torques in two ways.

    As printed, the wave generator carries the motor's torque `tau` [N m], so the estimate includes the torques of rotor
    inertia and friction. In the consistent form it carries the spring's own torque, and the motor's is not needed.
    """
    delta = kappa - q - kinematic_error(robot, kappa)
    return Estimates(estimate_torque(robot, delta, tau, tau_hat_max), torque_of_deformation(robot, delta, tau_hat_max))
