"""The unit ComputedTorque: the inverse dynamics of the rigid arm, with feedback in accelerations."""

from __future__ import annotations

from vdfmu.arm.equations.flexible_joint import axial_torques, link_torques, rotor_forces
from vdfmu.arm.equations.inverse_dynamics import joint_torques, link_forces, link_motion
from vdfmu.arm.law import Law
from vdfmu.arm.signals import DESIRED, MEASURED, base_motion, base_of, gain
from vdfmu.compiler.unit import Input


class ComputedTorque(Law):
    """Computed torque of the rigid arm.

    ::

        a   = q_d_ddot + k_v (q_d_dot - q_dot) + k_p (q_d - q)             accelerations of the links
        a_k = q_d_ddot + k_v (q_d_dot - kappa_dot) + k_p (q_d - q)         and of the rotors
        tau = [ID(q, q_dot, a) + K_v (q_d_dot - kappa_dot)] / ell + I_m a_k     limited to -tau_max .. tau_max

    ID is the inverse dynamics, with rotors that move by kappa_dot and a_k, (11). On an arm with stiff joints and
    without friction the error has the poles of p^2 + k_v p + k_p, if K_v = 0. On springs, damping of the rotors must
    use their own velocity, so a_k contains kappa_dot, and K_v adds to it. k_p acts across the springs, so keep
    sqrt(k_p) well below the first mode of the arm with free motors. Friction is not compensated: the error is about its
    torque divided by k_p and the inertia of joint and rotor.

    Source: B. Siciliano, L. Sciavicco, L. Villani, G. Oriolo, "Robotics: Modelling, Planning and Control", 2009,
    section 8.5.2; the rotors' own velocity is added here.
    """

    q_d_dot = Input(*DESIRED["q_d_dot"])
    q_d_ddot = Input(*DESIRED["q_d_ddot"])
    q = Input(*MEASURED["q"])
    q_dot = Input(*MEASURED["q_dot"])
    R_S, V_S, A_S = base_motion()
    k_p = gain("1/s2", "stiffness of the error", 2500.0)
    k_v = gain("1/s", "damping of the error", 100.0)
    K_v = gain("damping", "gain of the rotor velocity, link-side", 20.0)

    def outputs(self) -> None:
        """Torque of the motors."""
        a, a_k = (
            self.q_d_ddot + self.k_v * (self.q_d_dot - velocity) + self.k_p * (self.q_d - self.q)
            for velocity in (self.q_dot, self.kappa_dot)
        )
        motion = link_motion(self.robot, self.q, self.q_dot, a, base_of(self))
        F_Dk = rotor_forces(self.robot, motion, self.kappa_dot, a_k)
        links = joint_torques(self.robot, link_forces(self.robot, motion, F_Dk=F_Dk)) - link_torques(self.robot, self.q)
        rotors = self.robot.ell * axial_torques(F_Dk)
        self.command(links + rotors + self.K_v * (self.q_d_dot - self.kappa_dot))
