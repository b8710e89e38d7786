"""The ends of an arm: a moving base, a load that has a mass. Not in the paper; off by default.

Virtual decomposition cuts a system into subsystems that know of each other what acts at the cutting point: a motion
one way, a wrench the other. Of what hangs on an arm the wrench depends on the acceleration of the cutting point,
``M_e A_O + F_e``, and the acceleration on the wrench. What is handed over is M_e and F_e: they need no acceleration.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from vdfmu.arm.equations.kinematics import tool_transform
from vdfmu.arm.equations.spatial import skew


class Base(NamedTuple):
    """Motion of the base frame {S} relative to an inertial frame in which its origin passes by at `V_S[:3]`.

    Forces are the same in all of them (Galilei): for these the linear velocity may be 0.
    """

    R_S: Any = np.eye(3)
    """(3, 3) rotation of {S} in {I}, in which the gravity vector of (62) is given."""
    V_S: Any = np.zeros(6)
    """(6,) [m/s, rad/s] velocity of {S} in {S}."""
    V_S_dot: Any = np.zeros(6)
    """(6,) [m/s2, rad/s2] derivative of the coordinates V_S."""


class Ends(NamedTuple):
    """Both ends of an arm."""

    base: Base = Base()
    M_e: Any = np.zeros((6, 6))
    """(6, 6) [kg, kg m, kg m2] apparent mass matrix of the load in {O}, symmetric; 0: its wrench is F_e alone."""


AT_REST = Base()
"""{S} is the inertial frame {I}, as in the paper: its zeros fold away in the generated code."""
FREE = Ends()
"""Base at rest, no load with a mass."""
NO_WRENCH = np.zeros(6)


def moving_base(R_S: np.ndarray, omega_S: Any, A_S: np.ndarray) -> Base:
    """Return the motion of a base for equations of forces, relative to the frame in which it has no linear velocity.

    Parameters
    ----------
    R_S : (3, 3) rotation of {S} in {I}
    omega_S : (3,) [rad/s] angular velocity of {S} in {S}
    A_S : (6,) [m/s2, rad/s2] acceleration of the origin of {S}, as of a point, and angular acceleration, in {S}
    """
    return Base(R_S, np.concatenate([np.zeros(3), omega_S]), A_S)


def point_acceleration(V: np.ndarray, V_dot: np.ndarray) -> np.ndarray:
    """Acceleration of the origin of a frame, as of a point, and angular acceleration: (6,) [m/s2, rad/s2] in the frame.

    The derivative of the coordinates lacks ``omega x v``, the turning of the frame itself.
    """
    return np.concatenate([V_dot[:3] + skew(V[3:]) @ V[:3], V_dot[3:]])


def tool_acceleration(robot: Any, V_B: np.ndarray, V_B_dot: np.ndarray) -> np.ndarray:
    """Acceleration A_O of the end-effector frame {O} in {O}, as :func:`point_acceleration` has it: (6,).

    Parameters
    ----------
    V_B, V_B_dot : (6,) [m/s, rad/s, and per s] of the last link
    """
    U_O = tool_transform(robot)
    return point_acceleration(U_O.T @ V_B, U_O.T @ V_B_dot)
