"""An arm on a moving base, and under a load with a mass, against Pinocchio: a free joint before the first one."""

import dataclasses
from typing import NamedTuple

import numpy as np
import pinocchio as pin
import pytest

from vdfmu.equations.attachment import Base, Ends, moving_base, point_acceleration, tool_acceleration
from vdfmu.equations.forward_dynamics import apparent_load, forward_dynamics
from vdfmu.equations.inverse_dynamics import inverse_dynamics, joint_torques, link_forces, link_motion
from vdfmu.equations.kinematics import tool_transform
from vdfmu.equations.plant import equilibrium_torque, plant_derivative, plant_outputs
from vdfmu.equations.rigid_body import mass_matrix
from vdfmu.equations.spatial import rotation_z

from ..conftest import random_inertia, random_rotation

# 1e-10 of the largest: both sides round some 5000 times at conditions of the mass matrix of up to 1e4.
CLOSE = 1e-10


class Ride(NamedTuple):
    """Motion of a base: rotation in {I}, velocity in {S}, acceleration as of a point and angular, in {S}."""

    R_S: np.ndarray
    V_S: np.ndarray
    A_S: np.ndarray


def rides(count, seed):
    random = np.random.default_rng(seed)
    return [
        Ride(random_rotation(random), random.normal(size=6), 3.0 * random.normal(size=6)) for _ in range(count)
    ]


class Flying:
    """The arm as a Pinocchio model with a free joint as its root."""

    def __init__(self, robot, pinocchio_model, load=None):
        arm = pinocchio_model(robot)
        if load is not None:
            body = pin.Inertia(load[0], load[1], load[2])
            arm.appendBodyToJoint(arm.njoints - 1, body, pin.SE3(np.eye(3), np.array(robot.tool_offset)))
        root = pin.Model()
        root.addJoint(0, pin.JointModelFreeFlyer(), pin.SE3.Identity(), "base")
        root.addFrame(pin.Frame("mount", 1, 0, pin.SE3.Identity(), pin.FrameType.OP_FRAME))
        self.model = pin.appendModel(root, arm, root.getFrameId("mount"), pin.SE3.Identity())
        self.model.gravity = arm.gravity  # which that does not take over
        self.data = self.model.createData()
        self.robot = robot

    def _vectors(self, ride, state):
        quaternion = pin.Quaternion(ride.R_S)
        q = np.concatenate([np.zeros(3), quaternion.coeffs(), np.zeros(self.model.nq - 7)])
        v = np.concatenate([ride.V_S, np.zeros(self.robot.n)])
        for i, name in enumerate(self.model.names[2:]):
            joint = self.model.joints[self.model.getJointId(name)]
            q[joint.idx_q], v[joint.idx_v] = state.q[i], state.q_dot[i]
        return q, v

    def _forces(self, F_e):
        forces = [pin.Force.Zero() for _ in range(self.model.njoints)]
        tool = pin.SE3(np.eye(3), np.array(self.robot.tool_offset))
        forces[-1] = tool.act(pin.Force(-F_e[:3], -F_e[3:]))
        return forces

    def inverse(self, ride, state, q_ddot):
        """Wrench of the base on the arm, and joint torques."""
        q, v = self._vectors(ride, state)
        turning = np.concatenate([np.cross(ride.V_S[3:], ride.V_S[:3]), np.zeros(3)])
        a = np.concatenate([ride.A_S - turning, q_ddot])  # its acceleration is the derivative of coordinates
        both = pin.rnea(self.model, self.data, q, v, a, self._forces(state.F_e))
        return both[:6], both[6:]


@pytest.mark.parametrize("coupled", [False, True])
def test_torques_and_mount_wrench_agree_with_a_free_root(chain, draw, pinocchio_model, coupled):
    flying = Flying(chain, pinocchio_model)
    for state, ride in zip(draw(chain, 20, seed=11), rides(20, 12), strict=True):
        F_S, tau = flying.inverse(ride, state, state.q_ddot)
        base = moving_base(chain, ride.R_S, ride.V_S[3:], ride.A_S)
        if coupled:  # the velocity of the frame in which forces are written does not count
            base = Base(base.g_S, ride.V_S, ride.A_S - point_acceleration(ride.V_S, np.zeros(6)))
        found = inverse_dynamics(chain, state.q, state.q_dot, state.q_ddot, state.F_e, base=base)
        np.testing.assert_allclose(found, tau, rtol=0, atol=CLOSE * np.abs(tau).max())
        M_S, F_S0 = apparent_load(
            chain, state.q, state.q_dot, tau, state.F_e, ends=Ends(moving_base(chain, *ride[:1], ride.V_S[3:], ride.A_S))
        )
        np.testing.assert_allclose(M_S @ ride.A_S + F_S0, F_S, rtol=0, atol=CLOSE * np.abs(F_S).max())
        np.testing.assert_allclose(M_S, M_S.T, rtol=0, atol=1e-13 * np.abs(M_S).max())
