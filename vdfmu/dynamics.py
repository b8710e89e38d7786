"""Kinematics and dynamics of the rigid links of a robot: torques, accelerations, matrices, poses."""

from vdfmu.arm.dynamics import (
    forward_dynamics,
    forward_kinematics,
    gravity_torque,
    inverse_dynamics,
    jacobian,
    mass_matrix,
)

__all__ = ["forward_dynamics", "forward_kinematics", "gravity_torque", "inverse_dynamics", "jacobian", "mass_matrix"]
