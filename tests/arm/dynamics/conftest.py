"""Pinocchio models built from a `Robot`, without the equations of vdfmu."""

import numpy as np
import pinocchio as pin
import pytest

from vdfmu.arm.robot import Robot


def build_pinocchio_model(robot: Robot) -> pin.Model:
    """Return the rigid arm as a Pinocchio model."""
    # Every joint turns about or slides along its own z axis in a frame placed by `rotation` and `offset` in the
    # parent's. The link's inertia is about its centre of mass, in both. Pinocchio's gravity points down, Eq. (62)'s
    # up.
    model = pin.Model()
    model.gravity = pin.Motion(-np.asarray(robot.gravity, dtype=float), np.zeros(3))
    parent = 0
    for i, joint_type in enumerate(robot.joint_types):
        joint = pin.JointModelRZ() if joint_type == "revolute" else pin.JointModelPZ()
        parent = model.addJoint(parent, joint, pin.SE3(robot.rotation[i], robot.offset[i]), f"joint_{i + 1}")
        body = pin.Inertia(float(robot.mass[i]), np.array(robot.centroid[i]), np.array(robot.inertia[i]))
        model.appendBodyToJoint(parent, body, pin.SE3.Identity())
    if robot.payload:  # a body of its own
        body = pin.Inertia(float(robot.payload_mass), np.array(robot.payload_centroid), np.array(robot.payload_inertia))
        model.appendBodyToJoint(parent, body, pin.SE3(robot.tool_rotation, robot.tool_offset))
    return model


def external_force(robot: Robot, F_e: np.ndarray) -> list[pin.Force]:
    """Return the wrench of the surroundings on the arm: -F_e, moved from {O} to the last joint."""
    forces = [pin.Force.Zero() for _ in range(robot.n + 1)]
    tool = pin.SE3(robot.tool_rotation, robot.tool_offset)
    forces[-1] = tool.act(pin.Force(-F_e[:3], -F_e[3:]))
    return forces


@pytest.fixture(scope="session")
def pinocchio_model():
    return build_pinocchio_model


@pytest.fixture(scope="session")
def pinocchio_force():
    return external_force
