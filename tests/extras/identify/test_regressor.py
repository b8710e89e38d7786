"""The regressor and the base parameters: against Pinocchio, the recursion of the paper, and ranks."""

import dataclasses

import numpy as np
import pinocchio as pin
import pytest

import vdfmu
from tests.arm.dynamics.conftest import build_pinocchio_model
from vdfmu.arm.equations.flexible_joint import rotor_forces
from vdfmu.arm.equations.inverse_dynamics import joint_torques, link_forces, link_motion
from vdfmu.arm.equations.rigid_body import body_parameters
from vdfmu.extras.identify.problem import base_parameters, regressor

ROBOTS = ["manipulator_6dof", "planar_2dof", "slider_3dof"]


def states(n, count=5):
    random = np.random.default_rng(3)
    return [random.normal(size=(count, n)) for _ in range(5)]


@pytest.mark.parametrize("name", ROBOTS)
def test_the_regressor_is_pinocchios_and_with_rotors_gives_the_torques_of_the_recursion(name):
    robot = vdfmu.load_robot(name)
    model = build_pinocchio_model(robot)
    q, q_dot, q_ddot, *rotors = states(robot.n)
    mine = regressor(robot, q, q_dot, q_ddot, *rotors).links
    for k in range(len(q)):
        theirs = pin.computeJointTorqueRegressor(model, model.createData(), q[k], q_dot[k], q_ddot[k])
        # rounding of numbers up to 100
        np.testing.assert_allclose(mine[k], theirs, atol=1e-12)
    # (44)-(47) with the rotors' forces (7), (10)-(11).
    robot = dataclasses.replace(vdfmu.load_robot(name), rotor_coupling=True)
    q, q_dot, q_ddot, kappa_dot, kappa_ddot = states(robot.n)
    Y = regressor(robot, q, q_dot, q_ddot, kappa_dot, kappa_ddot)
    torques = Y.links @ body_parameters(robot) + Y.rotors @ (robot.I_m * robot.ell)
    for k in range(len(q)):
        motion = link_motion(robot, q[k], q_dot[k], q_ddot[k])
        forces = rotor_forces(robot, motion, kappa_dot[k], kappa_ddot[k])
        wanted = joint_torques(robot, link_forces(robot, motion, np.zeros(6), forces))
        # rounding of torques up to 100 N.m
        np.testing.assert_allclose(torques[k], wanted, atol=1e-11)
        axial = robot.I_m * robot.ell * (kappa_ddot[k] + Y.carried[k])
        np.testing.assert_allclose(axial / robot.ell, [F[5] for F in forces], atol=1e-12)


@pytest.mark.parametrize("name", ROBOTS)
def test_base_parameters_are_the_rank_of_the_regressor_and_give_the_same_torques(name):
    robot = vdfmu.load_robot(name)
    base = base_parameters(robot)
    if name == "planar_2dof":  # as textbooks have it, with l1 = 0.5 m
        assert base.names == ("mx1 + 0.5 m2", "my1", "Izz1 + 0.25 m2", "mx2", "my2", "Izz2")
        assert base.units == ("kg.m", "kg.m", "kg.m2", "kg.m", "kg.m", "kg.m2")
    Y = regressor(robot, *states(robot.n, 300)).links
    flat = Y.reshape(-1, Y.shape[-1])
    assert np.linalg.matrix_rank(flat, tol=1e-8 * np.linalg.norm(flat)) == len(base.names)
    phi = body_parameters(robot)
    # rounding of torques up to 100 N.m
    np.testing.assert_allclose(flat[:, base.columns] @ (base.matrix @ phi), flat @ phi, atol=1e-10)
