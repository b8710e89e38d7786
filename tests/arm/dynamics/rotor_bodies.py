"""An arm with its rotors as bodies of Pinocchio."""

import numpy as np
import pinocchio as pin


class RotorBodies:
    """Links and rotors as 2 n bodies: rotor i stands on link i-1 and turns by theta = ell kappa."""

    def __init__(self, robot):
        self.robot = robot
        self.model = pin.Model()
        self.model.gravity = pin.Motion(-np.asarray(robot.gravity, dtype=float), np.zeros(3))
        parent, links, rotors = 0, [], []
        for i, joint_type in enumerate(robot.joint_types):
            place = pin.SE3(np.array(robot.rotation[i]), np.array(robot.offset[i]))
            rotor = self.model.addJoint(parent, pin.JointModelRZ(), place, f"rotor_{i + 1}")
            inertia = pin.Inertia(0.0, np.zeros(3), np.diag([0.0, 0.0, robot.I_m[i] / robot.ell[i]]))
            self.model.appendBodyToJoint(rotor, inertia, pin.SE3.Identity())
            joint = pin.JointModelRZ() if joint_type == "revolute" else pin.JointModelPZ()
            parent = self.model.addJoint(parent, joint, place, f"joint_{i + 1}")
            body = pin.Inertia(float(robot.mass[i]), np.array(robot.centroid[i]), np.array(robot.inertia[i]))
            self.model.appendBodyToJoint(parent, body, pin.SE3.Identity())
            links.append(parent)
            rotors.append(rotor)
        if robot.payload:
            load = pin.Inertia(
                float(robot.payload_mass), np.array(robot.payload_centroid), np.array(robot.payload_inertia)
            )
            self.model.appendBodyToJoint(parent, load, pin.SE3(robot.tool_rotation, robot.tool_offset))
        self.data = self.model.createData()
        self.links, self.rotors = ([self.model.joints[j].idx_v for j in numbers] for numbers in (links, rotors))
        self.tool = parent

    def vector(self, of_links, of_rotors):
        """Return values of links and rotors in the order of Pinocchio's model."""
        values = np.empty(self.model.nv)
        values[self.links], values[self.rotors] = of_links, of_rotors
        return values

    def accelerations(self, q, q_dot, theta, theta_dot, tau_links, tau_rotors, F_e):
        """Return accelerations of links and rotors by the articulated-body algorithm."""
        forces = [pin.Force.Zero() for _ in range(self.model.njoints)]
        forces[self.tool] = pin.SE3(self.robot.tool_rotation, self.robot.tool_offset).act(pin.Force(-F_e[:3], -F_e[3:]))
        a = pin.aba(
            self.model, self.data, self.vector(q, theta), self.vector(q_dot, theta_dot),
            self.vector(tau_links, tau_rotors), forces,
        )  # fmt: skip
        return a[self.links], a[self.rotors]
