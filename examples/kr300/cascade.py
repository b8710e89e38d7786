"""The cascade of the axes of the KR 300, as its records show it."""

from vdfmu.arm.equations.plant import equilibrium_torque
from vdfmu.unit import JOINTS, Derivative, Input, Output, Parameter, RobotParameters, State, Unit


class Cascade(Unit):
    """P controller of the position, measured behind the gears, around a PI controller of the motor speed.

    ::

        e     = q_d - (q - T_q kappa_dot)                               encoders delayed by T_q
        w_dot = (kappa_dot_d + (tau_ff + K_p e) / K_v - w) / T          filtered command of the speed
        z_dot = K_v (w - kappa_dot) f_n                                 f_n = 1 / T_n
        tau   = K_v (w - kappa_dot) + z

    Without integrator, filter and delay, and with kappa instead of q, this is the law of the repository's
    ident_functions/nonlinear_differential_model.m, tau_ff + K_v (kappa_dot_d - kappa_dot) + K_p (q_d - kappa). Its
    tau_ff counts from the torque at the start, here z. There K_v is u K_vel k_T / (2 pi sqrt(2)), of the ratio
    u, the gain K_vel in As of current over turns of the motor, and k_T in N.m over the current's root mean square.
    """

    q_d = Input("position", JOINTS, "desired position")
    kappa_dot_d = Input("velocity", JOINTS, "desired velocity of the rotor divided by ell")
    tau_ff = Input("N.m", JOINTS, "torque in addition to the torque at the start, motor-side")
    q = Input("position", JOINTS, "position of the link")
    kappa_dot = Input("velocity", JOINTS, "velocity of the rotor divided by ell")
    tau = Output("N.m", JOINTS, "motor torque, motor-side")
    w = State("velocity", JOINTS, "filtered command of the velocity")
    z = State("N.m", JOINTS, "torque of the integrator, motor-side")
    w_dot = Derivative(w)
    z_dot = Derivative(z)
    q_0 = Parameter("position", JOINTS, "position of the links at which the arm is held at the start")
    K_p = Parameter("N.m/rad", JOINTS, "gain of the position, motor-side torque over link-side angle", minimum=0.0)
    K_v = Parameter("N.m.s/rad", JOINTS, "gain of the velocity, as K_p", start=1000.0, minimum=1e-9)
    f_n = Parameter("1/s", JOINTS, "frequency of the integrator: the inverse of its time", minimum=0.0)
    T = Parameter("s", text="Time of the filter", start=0.01, minimum=1e-6)
    T_q = Parameter("s", text="Delay of the encoders behind the gears", minimum=0.0)
    robot = RobotParameters()

    def start(self) -> None:
        self.w = 0.0 * self.q_0
        self.z = equilibrium_torque(self.robot, self.q_0) / self.robot.ell

    def outputs(self) -> None:
        self.tau = self.K_v * (self.w - self.kappa_dot) + self.z

    def derivatives(self) -> None:
        e = self.q_d - self.q + self.T_q * self.kappa_dot
        self.w_dot = (self.kappa_dot_d + (self.tau_ff + self.K_p * e) / self.K_v - self.w) / self.T
        self.z_dot = self.K_v * (self.w - self.kappa_dot) * self.f_n
