"""The law of the package's PDController as a user writes it, in a file of its own: what a traced unit costs."""

from vdfmu.unit import JOINTS, Choice, Input, Output, Parameter, RobotParameters, Unit, clip


class OwnController(Unit):
    """Proportional-derivative controller."""

    q_d = Input("position", JOINTS, "desired position")
    q_d_dot = Input("velocity", JOINTS, "desired velocity")
    q = Input("position", JOINTS, "position of the link")
    q_dot = Input("velocity", JOINTS, "velocity of the link")
    kappa_dot = Input("velocity", JOINTS, "velocity of the rotor")
    tau_m = Input("N.m", JOINTS, "feedforward torque, motor-side")
    kappa_dot_d = Input("velocity", JOINTS, "desired velocity of the rotor")
    tau = Output("N.m", JOINTS, "motor torque, motor-side")
    tau_e = Output("torque", JOINTS, "feedback torque, link-side")
    K_p = Parameter("stiffness", JOINTS, "proportional gain", start=1000.0, minimum=0.0, tunable=True)
    K_v = Parameter("damping", JOINTS, "derivative gain", start=20.0, minimum=0.0, tunable=True)
    tau_max = Parameter("N.m", JOINTS, "limit of the motor torque", start=1e12, minimum=0.0, tunable=True)
    velocity = Choice("kappa_dot", "q_dot", "mixed", text="velocities of the derivative term")
    robot = RobotParameters("ell")

    def outputs(self) -> None:
        """Feedforward and feedback."""
        v_d = self.kappa_dot_d if self.velocity == "kappa_dot" else self.q_d_dot
        v = self.q_dot if self.velocity == "q_dot" else self.kappa_dot
        self.tau_e = self.K_v * (v_d - v) + self.K_p * (self.q_d - self.q)
        self.tau = clip(self.tau_m + self.tau_e / self.robot.ell, -self.tau_max, self.tau_max)
