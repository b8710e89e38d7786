"""End stops of a joint and the torque and speed of its motor. Not in the paper; off by default."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from vdfmu.arm.drive.option import Array, Condition, DriveOption, LinkTorque, row
from vdfmu.base.measure import POSITIVE
from vdfmu.compiler.scalar import clip


@dataclass(frozen=True, eq=False, kw_only=True)
class LimitsRows:
    """Parameters of the end stops and the motor's limits."""

    limits: bool = False
    # fmt: off
    q_min: Array = row("limits", "position", "lower end stop", "", 1e6, foreign="lower", start=-1e6)
    q_max: Array = row("limits", "position", "upper end stop", "", 1e6, foreign="upper", start=1e6)
    stop_stiffness: Array = row(
        "limits", "stiffness", "stiffness of the end stops, link-side", "", 1e12, POSITIVE, start=1.0)
    stop_damping: Array = row(
        "limits", "per velocity", "damping of the end stops divided by stiffness and depth", "", 1e6, 0.0,
        hint="Give 0 for stops without loss.")
    tau_stall: Array = row(
        "limits", "N.m", "largest torque of the motor, motor-side", "", 1e9, POSITIVE, foreign="effort", start=1e9)
    kappa_dot_max: Array = row(
        "limits", "velocity", "no-load speed of the motor divided by ell", "", 1e9, POSITIVE, foreign="velocity",
        start=1e9)
    full_speed: Array = row(
        "limits", "1", "share of the no-load speed up to which the motor has its largest torque", "", 0.99, 0.0,
        default=0.0, fold="zeros", foreign="velocity",
        hint="Give 0 for a line from standstill, 0.95 for a drive that limits the speed.", start=0.9)


def _positive(x: Any) -> Any:
    """Return max(x, 0), exactly."""
    return 0.5 * (x + abs(x))


def stop_torque(robot: Any, q: Any, q_dot: Any) -> Any:
    """Torque of the end stops on the links: (n,) [N m or N], link-side. They push and never pull.

    ``k delta max(0, 1 + c delta_dot)`` for a depth delta beyond q_min or q_max (Hunt and Crossley 1975): a spring with
    damping proportional to the depth, so that the torque does not jump at contact. A link that arrives with a speed v
    of less than about 1 / c leaves with ``v (1 - 2/3 c v)``, to first order. `q`, `q_dot`: (n,) [rad or m, per s].
    """
    below, above = _positive(robot.q_min - q), _positive(q - robot.q_max)
    damping = robot.stop_damping * q_dot
    return robot.stop_stiffness * (below * _positive(1.0 - damping) - above * _positive(1.0 + damping))


def stop_energy(robot: Any, q: Any) -> Any:
    """Elastic energy of the end stops, ``k delta^2 / 2``: (n,) [J]."""
    below, above = _positive(robot.q_min - q), _positive(q - robot.q_max)
    return 0.5 * robot.stop_stiffness * (below * below + above * above)


def motor_torque(robot: Any, tau: Any, kappa_dot: Any) -> Any:
    """Torque of the motor for a command `tau`: (n,) [N m], motor-side; `kappa_dot` in rad/s or m/s.

    A driving torque is limited to tau_stall up to the share `full_speed` of the no-load speed. Above it the limit falls
    linearly to 0 at the no-load speed. A braking torque is limited to tau_stall. With a share near 1 the limits of
    torque and speed form a rectangle.
    """
    speed = kappa_dot / robot.kappa_dot_max
    forward, backward = (clip((1.0 - s) / (1.0 - robot.full_speed), 0.0, 1.0) for s in (speed, -speed))
    return clip(tau, -robot.tau_stall * backward, robot.tau_stall * forward)


def at_limits(robot: Any, tau: Any, kappa_dot: Any, q: Any) -> tuple[Any, Any, Any]:
    """Whether motors are at their largest torque, are limited by speed, and end stops push; `tau` is the command."""
    size = abs(motor_torque(robot, tau, kappa_dot))
    less, full = size < abs(tau), size >= robot.tau_stall
    return less & full, less & ~full, (q < robot.q_min) | (q > robot.q_max)


def motor_rectangle(robot: Any, most: Any) -> tuple[Any, Any]:
    """Largest rectangle under each torque-speed line: speed up to `most` [rad/s or m/s] and motor torque [N m], (n,).

    For a line from standstill to the no-load speed, the rectangle has half of both.
    """
    speed = clip(clip(robot.full_speed, 0.5, 1.0) * robot.kappa_dot_max, 0.0, most)
    return speed, motor_torque(robot, robot.tau_stall, speed)


LIMITS = DriveOption(
    link=lambda robot, q, q_dot: LinkTorque(
        0.0 if q_dot is None else stop_torque(robot, q, q_dot), stop_energy(robot, q)
    ),
    conditions=(
        Condition("q_max", "q_max > q_min", lambda robot: robot.q_max - robot.q_min, "The joint moves between them."),
    ),
    motor=lambda tau, robot, kappa_dot, state: motor_torque(robot, tau, kappa_dot),
)
