"""Cascade controllers of the axes and their motors with current control, of the Modelica Standard Library's r3."""

from vdfmu.arm.equations.flexible_joint import rotor_position
from vdfmu.arm.equations.plant import equilibrium_torque
from vdfmu.unit import JOINTS, Derivative, Input, Output, Parameter, RobotParameters, State, Unit

R_A = 250.0
"""Resistance of the armature [Ohm], of all motors."""


class Axis(Unit):
    """Position and speed controller, P and PI, and a motor whose current is controlled by an analog circuit.

    ::

        u       = ell (k_p (q_d - kappa) + q_d_dot - kappa_dot)           speed error of the motor
        z_dot   = u / T_s,   i_ref = k_s (z + u)                          PI of the speed
        v_C_dot = w / (0.04 D) (i - i_ref)                                integrator of the current
        i_dot   = 2 D w / R_A (-5 v_C - R_A i - k ell kappa_dot)          armature, with the back electromotive force
        tau     = k i

    So the current follows like a second-order system with the frequency w and the damping ratio D. The unit starts with
    the current that holds the arm.
    """

    q_d = Input("position", JOINTS, "desired position")
    q_d_dot = Input("velocity", JOINTS, "desired velocity")
    kappa = Input("position", JOINTS, "position of the rotor divided by ell")
    kappa_dot = Input("velocity", JOINTS, "velocity of the rotor divided by ell")
    tau = Output("N.m", JOINTS, "motor torque, motor-side")
    z = State("rad/s", JOINTS, "state of the speed controller")
    v_C = State("V", JOINTS, "voltage of the current controller's capacitor")
    i = State("A", JOINTS, "current")
    z_dot = Derivative(z)
    v_C_dot = Derivative(v_C)
    i_dot = Derivative(i)
    q_0 = Parameter("position", JOINTS, "position at which the arm is held at the start")
    k_p = Parameter("1/s", JOINTS, "gain of the position", start=5.0)
    k_s = Parameter("A.s/rad", JOINTS, "gain of the speed", start=0.5)
    T_s = Parameter("s", JOINTS, "time constant of the speed controller", start=0.05, minimum=1e-6)
    k = Parameter("N.m/A", JOINTS, "torque of the motor by its current", start=1.0, minimum=1e-6)
    w = Parameter("1/s", JOINTS, "frequency of the current", start=5000.0, minimum=1e-6)
    D = Parameter("1", JOINTS, "damping ratio of the current", start=0.6, minimum=1e-6)
    robot = RobotParameters()

    def start(self) -> None:
        torque = equilibrium_torque(self.robot, self.q_0)
        self.i = torque / (self.robot.ell * self.k)
        self.v_C = -R_A / 5.0 * self.i
        sag = rotor_position(self.robot, self.q_0, torque) - self.q_0
        self.z = self.i / self.k_s + self.robot.ell * self.k_p * sag

    def outputs(self) -> None:
        self.tau = self.k * self.i

    def derivatives(self) -> None:
        ell = self.robot.ell
        u = ell * (self.k_p * (self.q_d - self.kappa) + self.q_d_dot - self.kappa_dot)
        self.z_dot = u / self.T_s
        self.v_C_dot = self.w / (0.04 * self.D) * (self.i - self.k_s * (self.z + u))
        voltage = -5.0 * self.v_C - R_A * self.i - self.k * ell * self.kappa_dot
        self.i_dot = 2.0 * self.D * self.w / R_A * voltage
