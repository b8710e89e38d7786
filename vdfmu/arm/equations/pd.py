"""Proportional-derivative feedback, Eq. (58), and the motor torque that the controller commands."""

from __future__ import annotations

from typing import Any, NamedTuple

from vdfmu.compiler.scalar import clip


class Command(NamedTuple):
    """Motor torque `tau` (n,) [N m, motor-side] and feedback torque `tau_e` (n,) [N m or N, link-side]."""

    tau: Any
    tau_e: Any


def pd_control(
    K_p: Any, K_v: Any, ell: Any, tau_max: Any, q_d: Any, velocity_d: Any, q: Any, velocity: Any, tau_m: Any
) -> Command:
    """Feedforward plus feedback, Eq. (58) and Fig. 9.

    ``tau = tau_m + tau_e / ell`` with ``tau_e = K_v (v_d - v) + K_p (q_d - q)``.

    Deviation: the paper uses the link velocity, v = q_dot and v_d = q_d_dot. With elastic joints that is non-collocated
    and unstable at useful gains, so the rotor's velocity v = kappa_dot is the default. Its reference is the rotor's
    velocity along the desired motion, v_d = kappa_dot_d, because q_d_dot does not include the winding of the spring,
    and the feedback would apply ``K_v (kappa_dot_d - q_d_dot)`` on the exact motion.

    Parameters
    ----------
    K_p, K_v : (n,) [N m/rad, N m s/rad] (N/m, N s/m for prismatic joints), link-side
    ell : (n,) [- or rad/m]
    tau_max : (n,) [N m] limit of the motor torque, motor-side; may be infinite
    q_d, q : (n,) [rad or m]
    velocity_d, velocity : (n,) [rad/s or m/s] kappa_dot_d or q_d_dot, and kappa_dot or q_dot
    tau_m : (n,) [N m] feedforward, motor-side
    """
    tau_e = K_v * (velocity_d - velocity) + K_p * (q_d - q)
    tau = clip(tau_m + tau_e / ell, -tau_max, tau_max)
    return Command(tau, tau_e)
