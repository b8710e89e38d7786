"""A wall that the end effector may touch."""

import numpy as np

from vdfmu.arm.equations.kinematics import end_effector_pose
from vdfmu.arm.equations.mapping import jacobian
from vdfmu.unit import JOINTS, Input, Output, Parameter, RobotParameters, Unit, maximum, where


class Wall(Unit):
    """Plane wall: a spring and a damper that push, and never pull, along the normal of the wall.

    With the depth d of the end effector behind the plane, and its rate::

        N   = max(0, k d + c d_dot) for d > 0, else 0
        F_e = N normal, in {O}: the force of the arm on the wall
    """

    sampled = False
    q = Input("position", JOINTS, "position of the link")
    q_dot = Input("velocity", JOINTS, "velocity of the link")
    F_e = Output(3 * ("N",) + 3 * ("N.m",), 6, "Wrench of the arm on the wall in {O}")
    depth = Output("m", text="Depth of the end effector behind the plane")
    normal = Parameter("1", 3, "Direction into the wall in {I}, of length 1", start=[1.0, 0.0, 0.0])
    distance = Parameter("m", text="Distance of the plane from the origin of {I}, along the normal", start=10.0)
    k = Parameter("N/m", text="Stiffness", start=2e4, minimum=0.0)
    c = Parameter("N.s/m", text="Damping", start=100.0, minimum=0.0)
    robot = RobotParameters()

    def outputs(self) -> None:
        p_O, R_O = end_effector_pose(self.robot, self.q)
        V_O = jacobian(self.robot, self.q) @ self.q_dot
        into_wall = R_O.T @ self.normal
        self.depth = self.normal @ p_O - self.distance
        push = self.k * self.depth + self.c * (into_wall @ V_O[:3])
        N = where(self.depth > 0.0, maximum(push, 0.0), 0.0)
        self.F_e = np.concatenate([N * into_wall, np.zeros(3)])
