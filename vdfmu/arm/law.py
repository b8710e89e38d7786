"""Common parts of control laws: desired motion, limited motor torque, and equilibrium of the arm."""

from __future__ import annotations

from typing import Any

import numpy as np

from vdfmu.arm.equations.flexible_joint import rotor_position
from vdfmu.arm.equations.inverse_dynamics import AT_REST, Base
from vdfmu.arm.equations.pd import pd_control
from vdfmu.arm.equations.plant import equilibrium_torque
from vdfmu.arm.signals import DESIRED, MEASURED, base_motion, gain, small_motion, torque_limit
from vdfmu.compiler.scalar import clip
from vdfmu.compiler.unit import JOINTS, Input, Output, Parameter, RobotParameters, Sampled, Terminal, Unit

TORQUE = ("N.m", JOINTS, "motor torque, motor-side")
_TERMINALS = (
    Terminal("desired", "left", tuple(DESIRED), "Desired motion of the joints"),
    Terminal("feedforward", "bottom", ("tau_m", "kappa_dot_d"), "Torques and rotors along the desired motion"),
    Terminal("joints", "right", ("tau", *MEASURED), "Motor torques and motion of the joints"),
    Terminal("base", "top", ("R_S", "V_S", "A_S"), "Motion of the base"),
)


class Law(Unit):
    """Base class of control laws: each adds its variables and passes its torque to :meth:`command`."""

    sampled = True
    q_d = Input(*DESIRED["q_d"])
    kappa_dot = Input(*MEASURED["kappa_dot"])
    tau: Any = Output(*TORQUE)
    tau_max = torque_limit()
    robot = RobotParameters()

    def __init_subclass__(cls, **kwargs: Any) -> None:
        super().__init_subclass__(**kwargs)
        members = [(t, tuple(name for name in t.groups if name in cls.declared)) for t in _TERMINALS]
        cls.terminals = tuple(Terminal(t.name, t.side, names, t.description) for t, names in members if names)

    def command(self, torque: Any) -> None:
        """Command a torque (n,) [N m or N], link-side, from the motors, within tau_max."""
        self.tau = clip(torque / self.robot.ell, -self.tau_max, self.tau_max)

    def experiment(self) -> None:
        """Linear approximation of the motion of an arm near its start."""
        phase = self.t + 0.4 * np.arange(self.n)
        motion = small_motion(self.t, self.n, self.experiment_stop)
        near = {
            "q": motion.q_d - 1e-4 * np.cos(phase), "q_dot": motion.q_d_dot + 1e-3 * np.sin(phase),
            "kappa": motion.q_d + 1e-3 * np.sin(phase), "kappa_dot": motion.q_d_dot + 1e-3 * np.cos(phase),
            "tau_s": 0.1 * np.sin(phase), "kappa_dot_d": motion.q_d_dot, "tau_m": 0.05 * np.sin(phase + 2.0 * self.t),
        }  # fmt: skip
        for name, value in (motion._asdict() | near).items():
            if name in self.declared:
                setattr(self, name, value)


class GravityLaw(Law):
    """Base of control laws that hold the arm at its desired position."""

    q_d_dot = Input(*DESIRED["q_d_dot"])
    R_S = base_motion()[0]

    def rest(self) -> tuple[Any, Any]:
        """Spring torque [N m or N], link-side, and rotor position [rad or m] that hold the arm at q_d, each (n,)."""
        base = Base(self.R_S) if self.robot.moving_base else AT_REST
        torque = equilibrium_torque(self.robot, self.q_d, base=base)
        return torque, rotor_position(self.robot, self.q_d, torque)


class SampledPD(Law):
    """Base of sampled PD controllers with feedforward, Eq. (58), and an additional torque."""

    q = Input(*MEASURED["q"])
    kappa_dot_d = Input("velocity", JOINTS, "desired velocity of the rotor divided by ell")
    tau_m = Input("N.m", JOINTS, "feedforward torque, motor-side")
    K_p = gain("stiffness", "proportional gain, link-side, Eq. (58)", 1000.0)
    K_v = gain("damping", "derivative gain, link-side, Eq. (58)", 20.0)
    period = Parameter("s", text="time between samples", start=1e-3, minimum=1e-6)
    tau = Sampled(*TORQUE)
    robot = RobotParameters("ell")

    def pd(self, added: Any) -> Any:
        """Torque of the motors including `added`, (n,) [N m] each, motor-side; the first is limited to tau_max."""
        return pd_control(
            self.K_p,
            self.K_v,
            self.robot.ell,
            self.tau_max,
            self.q_d,
            self.kappa_dot_d,
            self.q,
            self.kappa_dot,
            self.tau_m + added,
        ).tau
