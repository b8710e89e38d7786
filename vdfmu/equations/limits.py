"""End stops of a joint and the torque-speed line of its motor. Not in the paper; off by default."""

from __future__ import annotations

from typing import Any

from vdfmu.scalar.generic import clip


def _positive(x: Any) -> Any:
    """Return x where it is positive, else 0: exact."""
    return 0.5 * (x + abs(x))


def stop_torque(robot: Any, q: Any, q_dot: Any) -> Any:
    """Torque of the end stops on the links, which push and never pull: (n,) [N m or N], link-side.

    ``k delta max(0, 1 + c delta_dot)`` for a depth delta beyond q_min or q_max (Hunt and Crossley 1975): a spring whose
    damping grows with the depth, so that the torque has no jump at contact. A link that arrives with a speed v of
    less than about 1 / c leaves with ``v (1 - 2/3 c v)``, to first order.

    Parameters
    ----------
    q, q_dot : (n,) [rad or m, per s]
    """
    below, above = _positive(robot.q_min - q), _positive(q - robot.q_max)
    damping = robot.stop_damping * q_dot
    return robot.stop_stiffness * (below * _positive(1.0 - damping) - above * _positive(1.0 + damping))


def stop_energy(robot: Any, q: Any) -> Any:
    """Elastic energy of the end stops, ``k delta^2 / 2``: (n,) [J]."""
    below, above = _positive(robot.q_min - q), _positive(q - robot.q_max)
    return 0.5 * robot.stop_stiffness * (below * below + above * above)


def motor_torque(robot: Any, tau: Any, kappa_dot: Any) -> Any:
    """Torque that the motor gives where `tau` is asked for: (n,) [N m], motor-side.

    Driving, the torque ends at ``tau_stall (1 - |kappa_dot| / kappa_dot_max)``, and at 0 beyond the no-load speed;
    braking, at tau_stall.

    Parameters
    ----------
    tau : (n,) [N m] motor-side
    kappa_dot : (n,) [rad/s or m/s]
    """
    speed = kappa_dot / robot.kappa_dot_max
    forward, backward = (clip(1.0 - s, 0.0, 1.0) for s in (speed, -speed))
    return clip(tau, -robot.tau_stall * backward, robot.tau_stall * forward)
