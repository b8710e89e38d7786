"""The unit Feedforward: torques along the desired motion."""

from __future__ import annotations

import numpy as np

from vdfmu.arm.equations.feedforward import FeedbackGains, feedforward_inverse, feedforward_vdc
from vdfmu.arm.equations.trajectory import Desired
from vdfmu.arm.signals import DESIRED, MEASURED, base_motion, base_of, gain, small_motion, wave_wrench, wrench
from vdfmu.compiler.unit import JOINTS, Choice, Input, Output, RobotParameters, Terminal, Unit


class Feedforward(Unit):
    """Feedforward torque by virtual decomposition, Eq. (12)-(28) and (48)-(53).

    Numbers in brackets are the paper's. Link-side quantities belong to the joint, motor-side quantities to the rotor;
    ell is the reduction ratio. For a prismatic joint read m for rad and N for N.m on the link side.

    Mode 0, inverse: the exact inverse of the plant along the desired motion::

        tau_s   = ID(q_d, q_d_dot, q_d_ddot, F_e_d) + xi_l(q_d_dot)      spring torques, with derivatives of F_e_d of 0
        kappa_d = q_d + D(tau_s) + theta_err(kappa_d)                    motion of the rotors
        tau_m   = I_m kappa_d_ddot + tau_s / ell + xi_m(kappa_d_dot)     motor torques, (27), (56)

    Mode 1, vdc: virtual decomposition control, from the desired and the measured motion::

        q_dot_r     = q_d_dot + Lambda (q_d - q)                         required velocity, (12)
        kappa_dot_r = q_dot_r + (kappa_d_dot - q_d_dot)                  of the rotors
        F*_B,r      = M_B V_B,r_dot + C_B V_B,r + G_B + K_V (V_B,r - V_B)        required net forces, (50)
        tau_t       = (z' F_B,r + xi_l) / ell + k_vq (q_dot_r - q_dot)   (26)
        tau_m       = tau_t + k_vkappa (kappa_dot_r - kappa_dot) + xi_m + I_m kappa_r_ddot       (27), (56)

    ID is the inverse dynamics of the links, (29)-(47) and (59)-(62); D the deformation of a drive and theta_err its
    kinematic error, (2)-(3); xi_l and xi_m friction on link and rotor, (54)-(55). Torques of counterbalances are
    subtracted from ID and z' F_B,r.

    The inverse is not exact in two cases. With rotor_coupling the rotors' own accelerations would need two more
    derivatives of q_d for each joint, which kappa_d does not contain; this matters in fast motions. Of the options it
    includes backlash, load loss and counterbalances, but not hysteresis, bristles, the winding, temperature, or limits.

    For a robot with moving_base the motion of the base is an input, and the derivatives of its acceleration A_S are
    assumed to be 0.
    """

    sampled = True
    chain = 9
    q_d = Input(*DESIRED["q_d"])
    q_d_dot = Input(*DESIRED["q_d_dot"])
    q_d_ddot = Input(*DESIRED["q_d_ddot"])
    q_d_dddot = Input(*DESIRED["q_d_dddot"])
    q_d_ddddot = Input(*DESIRED["q_d_ddddot"])
    q = Input(*MEASURED["q"])
    q_dot = Input(*MEASURED["q_dot"])
    kappa_dot = Input(*MEASURED["kappa_dot"])
    F_e_d = wrench("to be exerted on the surroundings")
    R_S, V_S, A_S = base_motion()
    tau_m = Output("N.m", JOINTS, "feedforward torque, motor-side")
    tau_s = Output(*MEASURED["tau_s"])
    kappa_dot_d = Output("velocity", JOINTS, "desired velocity of the rotor divided by ell")
    mode = Choice("inverse", "vdc", text="0: inverse (exact inverse of the plant), 1: vdc (required velocities)")
    Lambda = gain("1/s", "gain of the required velocity, Eq. (12)", 1.0)
    K_V = gain("1", "gain K_B of the link in SI units, times the unit matrix, Eq. (50)", 0.01)
    k_vq = gain("damping_m", "gain of the link velocity, motor-side, Eq. (26)", 0.0001)
    k_vkappa = gain("damping_m", "gain of the rotor velocity, motor-side, Eq. (27)", 0.05)
    robot = RobotParameters()
    terminals = (
        Terminal("desired", "left", tuple(DESIRED), "Desired motion of the joints"),
        Terminal("joints", "bottom", ("q", "q_dot", "kappa_dot"), "Motion of the joints"),
        Terminal("end_effector", "top", ("F_e_d",), "Desired wrench of the end effector"),
        Terminal("base", "top", ("R_S", "V_S", "A_S"), "Motion of the base"),
        Terminal(
            "feedforward", "right", ("tau_m", "tau_s", "kappa_dot_d"), "Torques and rotors along the desired motion"
        ),
    )

    def outputs(self) -> None:
        """Torques and rotor velocities of the mode."""
        desired = Desired(self.q_d, self.q_d_dot, self.q_d_ddot, self.q_d_dddot, self.q_d_ddddot)
        base = base_of(self)
        if self.mode == "inverse":
            torques = feedforward_inverse(self.robot, desired, self.F_e_d, base)
        else:
            gains = FeedbackGains(self.Lambda, self.K_V, self.k_vq, self.k_vkappa)
            torques = feedforward_vdc(self.robot, gains, desired, self.q, self.q_dot, self.kappa_dot, self.F_e_d, base)
        self.tau_m, self.tau_s, self.kappa_dot_d = torques

    def experiment(self) -> None:
        """Linear approximation of the motion of an arm near its start."""
        t, phase = self.t, 0.4 * np.arange(self.n)
        motion = small_motion(t, self.n, self.experiment_stop)
        self.q_d, self.q_d_dot, self.q_d_ddot, self.q_d_dddot, self.q_d_ddddot = motion
        self.q = motion.q_d - 1e-4 * np.cos(t + phase)
        self.q_dot = motion.q_d_dot + 1e-3 * np.sin(t + phase)
        self.kappa_dot = motion.q_d_dot + 1e-3 * np.cos(t + phase)
        self.F_e_d = wave_wrench(t)
