"""The unit EmergencyStop: motors without torque, then brakes."""

from __future__ import annotations

from vdfmu.arm.signals import MEASURED
from vdfmu.compiler.unit import JOINTS, Input, Parameter, RobotParameters, Sampled, Unit, clip, minimum, where
from vdfmu.compiler.unit.declaration import NO_LIMIT

_STIFF, _DAMPED = 0.05, 0.4


class EmergencyStop(Unit):
    """Emergency stop of all joints: the motors' torque ends, and brakes on the rotors engage, sampled.

    From the first sample with ``stop`` above 0.5, or from t_stop, the motors have no torque. T_b later the brakes
    engage and stay engaged. A brake is Coulomb friction: a bristle holds the rotor in place up to the torque tau_b and
    slips beyond it, and kappa_b follows::

        tau = clip(K (kappa_b - kappa) - D kappa_dot, -tau_b, tau_b)
        K = 0.05 I_m / period^2,  D = 0.4 I_m / period

    So tau_b slows down a slipping rotor. A resting rotor does not creep: a load tau_l turns it by tau_l / K. K and D
    are those of the stiffest brake that does not oscillate even with an additional sample of delay. tau_b must exceed
    the motor torques that hold the arm's weight, or the arm falls.
    """

    tau_c = Input("N.m", JOINTS, "requested torque, motor-side")
    kappa = Input(*MEASURED["kappa"])
    kappa_dot = Input(*MEASURED["kappa_dot"])
    stop = Input("1", text="above 0.5: stop")
    t_stop = Parameter("s", text="time of a stop", start=NO_LIMIT)
    T_b = Parameter("s", text="time until the brakes engage", start=0.05, minimum=0.0)
    tau_b = Parameter("N.m", JOINTS, "torque of the brake, motor-side", start=1.0, minimum=0.0)
    period = Parameter("s", text="time between samples", start=1e-3, minimum=1e-6)
    t_b = Sampled("s", text="time at which the brakes engage")
    phase = Sampled("1", text="0: motors, 1: no torque, 2: brakes")
    kappa_b = Sampled("position", JOINTS, "rotor position at which the bristle of the brake has no torque")
    tau = Sampled("N.m", JOINTS, "torque on the rotor, motor-side")
    robot = RobotParameters("I_m")

    def start(self) -> None:
        """With the commanded torque."""
        self.t_b, self.phase, self.kappa_b, self.tau = NO_LIMIT, 0.0, self.kappa, self.tau_c

    def update(self) -> None:
        """Remember the stop, then the torque of the phase."""
        early = 0.5 * self.period  # times are rounded
        asked = where(self.stop > 0.5, 1.0, where(self.t >= self.t_stop - early, 1.0, 0.0))
        self.t_b = minimum(self.t_b, where(asked > 0.5, self.t + self.T_b, NO_LIMIT))
        braked, stopped = self.t >= self.t_b - early, self.t_b < NO_LIMIT
        self.phase = where(braked, 2.0, where(stopped, 1.0, 0.0))
        K, damping = _STIFF * self.robot.I_m / self.period**2, _DAMPED * self.robot.I_m / self.period * self.kappa_dot
        held = clip(K * (self.kappa_b - self.kappa) - damping, -self.tau_b, self.tau_b)
        self.tau = where(braked, held, where(stopped, 0.0, self.tau_c))
        self.kappa_b = where(braked, self.kappa + (held + damping) / K, self.kappa)
