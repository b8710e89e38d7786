"""State feedback whose gains follow from weights: what a search varies of the unit StateFeedback."""

from __future__ import annotations

from functools import lru_cache
from typing import Any

import numpy as np

from vdfmu.arm.units.laws.state_feedback import StateFeedback
from vdfmu.compiler.unit import JOINTS, Parameter
from vdfmu.study.analysis.lqr import StateGains, state_gains


@lru_cache(maxsize=8)
def _found(robot: Any, period: float, *weights: tuple[float, ...]) -> StateGains:
    q_pose, error, rate, torque = map(np.array, weights)
    return state_gains(robot, q_pose, error=error, rate=rate, torque=torque, step=period)


def _gain(name: str, unit: str, text: str) -> Parameter:
    def start(robot: Any, period: Any, q_pose: Any, error: Any, rate: Any, torque: Any) -> Any:
        weights = (tuple(np.asarray(one, float).tolist()) for one in (q_pose, error, rate, torque))
        return getattr(_found(robot, float(period), *weights), name)

    return Parameter(unit, (JOINTS, JOINTS), text, start=start, tunable=True)


class OptimalStateFeedback(StateFeedback):
    """Feedback of the whole state of links and rotors, with gravity, with gains that are optimal at q_pose.

    Each weight is the size of an error that counts as equally bad: of a link, a rotor, a motor; see
    :func:`vdfmu.study.analysis.lqr.state_gains`.
    """

    q_pose = Parameter("position", JOINTS, "pose at which the gains are optimal")
    error = Parameter("position", JOINTS, "error of the link", start=1e-3, minimum=1e-9)
    rate = Parameter("velocity", JOINTS, "velocity of the rotor divided by ell", start=0.02, minimum=1e-9)
    torque = Parameter("N.m", JOINTS, "torque of the motor, motor-side", start=0.01, minimum=1e-9)
    period = Parameter("s", text="communication step", start=1e-3, minimum=1e-6)
    K_q = _gain("K_q", "stiffness", "gain of the link positions, link-side")
    K_q_dot = _gain("K_q_dot", "damping", "gain of the link velocities, link-side")
    K_kappa = _gain("K_kappa", "stiffness", "gain of the rotor positions, link-side")
    K_kappa_dot = _gain("K_kappa_dot", "damping", "gain of the rotor velocities, link-side")
