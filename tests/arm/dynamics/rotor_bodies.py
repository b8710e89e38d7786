"""An arm with its rotors as bodies of Pinocchio."""

import numpy as np
import pinocchio as pin

from tests.arm.dynamics.conftest import build_pinocchio_model, external_force


class RotorBodies:
    """Links and rotors as 2 n bodies: rotor i stands on link i-1 and turns by theta = ell kappa.

    Vectors of the model have the links first.
    """

    def __init__(self, robot):
        self.robot = robot
        self.model = build_pinocchio_model(robot)
        for i in range(robot.n):
            place = pin.SE3(np.array(robot.rotation[i]), np.array(robot.offset[i]))
            rotor = self.model.addJoint(i, pin.JointModelRZ(), place, f"rotor_{i + 1}")
            inertia = pin.Inertia(0.0, np.zeros(3), np.diag([0.0, 0.0, robot.I_m[i] / robot.ell[i]]))
            self.model.appendBodyToJoint(rotor, inertia, pin.SE3.Identity())
        self.data = self.model.createData()

    def accelerations(self, q, q_dot, theta, theta_dot, tau_links, tau_rotors, F_e):
        """Return accelerations of links and rotors by the articulated-body algorithm."""
        forces = external_force(self.robot, F_e) + [pin.Force.Zero() for _ in range(self.robot.n)]
        pairs = (q, theta), (q_dot, theta_dot), (tau_links, tau_rotors)
        a = pin.aba(self.model, self.data, *map(np.concatenate, pairs), forces)
        return a[: self.robot.n], a[self.robot.n :]
