"""Computed torque control of the arm."""

from vdfmu.arm.equations.inverse_dynamics import inverse_dynamics
from vdfmu.unit import JOINTS, Input, Output, Parameter, RobotParameters, Unit


class ComputedTorque(Unit):
    """Computed torque: the inverse dynamics of the rigid arm for the desired motion, with feedback in accelerations.

    ::

        a   = q_d_ddot + k_v (q_d_dot - q_dot) + k_p (q_d - q)
        tau = ID(q, q_dot, a) / ell + K_v (q_d_dot - kappa_dot) / ell

    The springs are left out of the model; K_v, on the rotors' velocity, damps them.
    """

    q_d = Input("position", JOINTS, "desired position")
    q_d_dot = Input("velocity", JOINTS, "desired velocity")
    q_d_ddot = Input("acceleration", JOINTS, "desired acceleration")
    q = Input("position", JOINTS, "position of the link")
    q_dot = Input("velocity", JOINTS, "velocity of the link")
    kappa_dot = Input("velocity", JOINTS, "velocity of the rotor divided by ell")
    tau = Output("N.m", JOINTS, "motor torque, motor-side")
    k_p = Parameter("1/s2", JOINTS, "stiffness of the error", start=400.0, minimum=0.0, tunable=True)
    k_v = Parameter("1/s", JOINTS, "damping of the error", start=20.0, minimum=0.0, tunable=True)
    K_v = Parameter("damping", JOINTS, "damping of the rotor, link-side", start=20.0, minimum=0.0, tunable=True)
    robot = RobotParameters()

    def outputs(self) -> None:
        a = self.q_d_ddot + self.k_v * (self.q_d_dot - self.q_dot) + self.k_p * (self.q_d - self.q)
        torque = inverse_dynamics(self.robot, self.q, self.q_dot, a)
        self.tau = (torque + self.K_v * (self.q_d_dot - self.kappa_dot)) / self.robot.ell
