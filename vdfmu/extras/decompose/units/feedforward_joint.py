"""The unit FeedforwardJoint: one joint in the feedforward of its arm."""

from __future__ import annotations

from typing import Any

import numpy as np

from vdfmu.arm.equations.desired_drive import desired_jets, drive_motion
from vdfmu.arm.equations.feedforward import (
    FeedbackGains,
    drive_torques,
    feedforward_torque,
    required_motion,
    required_rotor_forces,
)
from vdfmu.arm.equations.flexible_joint import axial_torques, link_torques, rotor_forces, rotor_reaction
from vdfmu.arm.equations.inverse_dynamics import Base, ChainMotion, driven_acceleration, driven_velocity, joint_torques
from vdfmu.arm.equations.kinematics import joint_placement
from vdfmu.arm.equations.spatial import force_transform, joint_axis
from vdfmu.arm.equations.trajectory import Desired
from vdfmu.arm.signals import DESIRED, MEASURED
from vdfmu.arm.world.attachment import turning_gravity
from vdfmu.compiler.scalar import derivative, jets
from vdfmu.compiler.unit import Choice, Input, Output, Parameter, Terminal
from vdfmu.compiler.unit.declaration import Variables
from vdfmu.extras.decompose.units._piece import (
    JOINT,
    Piece,
    coupling,
    desired_ports,
    friction_choice,
    numbers,
    of_joint,
    row_pair,
)


def feedforward_variables(kind: str) -> dict[str, Any]:
    """Return the variables of a joint that depend on its type, and its gains."""
    gains = {
        "Lambda": ("1/s", "gain of the required velocity, Eq. (12)", 1.0),
        "k_vq": ("damping_m", "gain of the link velocity, motor-side, Eq. (26)", 0.0001),
        "k_vkappa": ("damping_m", "gain of the rotor velocity, motor-side, Eq. (27)", 0.05),
    }
    return {
        **{name: of_joint(Input, signal, kind) for name, signal in DESIRED.items()},
        **{name: of_joint(Input, MEASURED[name], kind) for name in ("q", "q_dot", "kappa_dot")},
        "tau_s": of_joint(Output, MEASURED["tau_s"], kind),
        "kappa_dot_d": of_joint(Output, ("velocity", (), "desired velocity of the rotor divided by ell"), kind),
        **{
            name: of_joint(Parameter, (unit, (), text), kind, start=start, minimum=0.0, tunable=True)
            for name, (unit, text, start) in gains.items()
        },
        **numbers(*JOINT, joint_type=kind),
    }


class FeedforwardJoint(Piece):
    """A revolute joint in the feedforward of its arm, Eq. (12)-(27), (48)-(53); see the unit Feedforward.

    Towards the tip it passes velocities to its link, and towards the base the forces that the link requires::

        V_B = z q_dot + U_AB' V_A         (29)-(31), desired, with three derivatives; measured; required, (48)-(49)
        F_A = U_AB F_B                    (46), (52)-(53), desired, with two derivatives; required
        tau_s = z' F_B + xi_l             of the desired motion; kappa and tau_m follow as in Feedforward

    Mode 0, inverse, uses only the desired forces; mode 1, vdc, also uses the required ones.
    """

    ports = Variables(desired_ports("A", Input, Output) | desired_ports("B", Output, Input))
    tau_m = Output("N.m", text="Feedforward torque, motor-side")
    mode = Choice("inverse", "vdc", text="0: inverse (exact inverse of the plant), 1: vdc (required velocities)")
    friction = friction_choice()
    rotor_coupling = coupling()
    of_joint_type = Variables(feedforward_variables("revolute"))
    terminals = (
        Terminal("base_side", "left", tuple(desired_ports("A", Input, Output)), "Cutting point {A}"),
        Terminal("tip_side", "right", tuple(desired_ports("B", Output, Input)), "Cutting point {B}"),
    )

    def outputs(self) -> None:
        """Forward pass, backward pass, and the drive."""
        robot = self.robot_of_joint(friction=self.friction, rotor_coupling=self.rotor_coupling)
        z = joint_axis(self.joint_type)
        desired = Desired(*(np.array([getattr(self, name)]) for name in DESIRED))
        q_d, q_d_dot, q_d_ddot = desired_jets(desired)
        R_AB, p_AB = joint_placement(robot, 0, q_d[0])
        U_AB = force_transform(R_AB, p_AB)
        (v_A, v_A_dot), (V, V_dot) = row_pair(self.V_A_d), self.V_A_d[:2]
        v_B = driven_velocity(z, U_AB, v_A, q_d_dot[0])
        v_B_dot = driven_acceleration(z, U_AB, v_A_dot, v_B, q_d_dot[0], q_d_ddot[0])
        self.V_B_d = np.stack([derivative(v_B, 0), *(derivative(v_B_dot, k) for k in range(3))])
        self.g_B_d = derivative(R_AB.T @ turning_gravity(self.g_A_d, V, V_dot), 0)
        F_B_d, F_B_k = jets(*self.F_B_d[:3]), self.F_B_d[3]
        motion = ChainMotion([U_AB], [v_B], [v_B_dot], Base(V_S=v_A, V_S_dot=v_A_dot))
        F_A_d = U_AB @ F_B_d + rotor_reaction(robot, 0, rotor_forces(robot, motion, q_d_dot, q_d_ddot)[0])
        drive = drive_motion(robot, q_d, q_d_dot, joint_torques(robot, [F_B_d]))
        motion = motion._replace(base=Base(V_S=V, V_S_dot=V_dot))
        F_Dk = rotor_forces(robot, motion, drive.kappa_dot, drive.kappa_ddot)
        F_A_k = derivative(U_AB, 0) @ F_B_k + rotor_reaction(robot, 0, F_Dk[0])
        self.F_A_d = np.stack([*(derivative(F_A_d, k) for k in range(3)), F_A_k])
        self.kappa_dot_d = drive.kappa_dot[0]

        # along the measured motion
        q, q_dot, kappa_dot = (np.array([x]) for x in (self.q, self.q_dot, self.kappa_dot))
        gains = FeedbackGains(*(np.array([x]) for x in (self.Lambda, 0.0, self.k_vq, self.k_vkappa)))
        asked = required_motion(gains, desired, drive, q, q_dot)
        R_AB, p_AB = joint_placement(robot, 0, self.q)
        U_AB = force_transform(R_AB, p_AB)
        self.V_B = driven_velocity(z, U_AB, self.V_A, self.q_dot)
        V_B_r = driven_velocity(z, U_AB, self.V_A_r, asked.q_dot_r[0])
        self.V_B_r = V_B_r
        self.V_B_r_dot = driven_acceleration(z, U_AB, self.V_A_r_dot, V_B_r, self.q_dot, asked.q_ddot_r[0])
        self.g_B = R_AB.T @ self.g_A
        links = ChainMotion([U_AB], [self.V_B], [], Base(V_S=self.V_A))
        links_r = ChainMotion([U_AB], [V_B_r], [self.V_B_r_dot], Base(V_S=self.V_A_r, V_S_dot=self.V_A_r_dot))
        F_D_r_star = required_rotor_forces(robot, links, links_r, kappa_dot, asked)
        self.F_A_r = U_AB @ self.F_B_r + rotor_reaction(robot, 0, F_D_r_star[0])
        if self.mode == "inverse":
            with_rotors = joint_torques(robot, [F_B_k]) - link_torques(robot, desired.q_d) + drive.xi_l
            tau_s = with_rotors if self.rotor_coupling else drive.tau_s
            tau_m = feedforward_torque(robot, axial_torques(F_Dk), tau_s, drive.xi_m)
        else:
            tau_q = joint_torques(robot, [self.F_B_r]) - link_torques(robot, q)
            friction, tau_kr = (drive.xi_l, drive.xi_m), axial_torques(F_D_r_star)
            tau_t, tau_m = drive_torques(robot, gains, asked, tau_q, tau_kr, friction, q_dot, kappa_dot)
            tau_s = robot.ell * tau_t
        self.tau_m, self.tau_s = tau_m[0], tau_s[0]
