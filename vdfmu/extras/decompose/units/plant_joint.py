"""The unit PlantJoint: a joint of an arm, with its drive."""

from __future__ import annotations

from typing import Any

import numpy as np

from vdfmu.arm.equations.flexible_joint import (
    PlantState,
    driven_rotor_forces,
    link_torques,
    plant_torques,
    rotor_acceleration,
    rotor_position,
    rotor_reaction,
    spring_rate,
)
from vdfmu.arm.equations.forward_dynamics import accelerate, eliminate, handed_on
from vdfmu.arm.equations.inverse_dynamics import Base, ChainMotion, driven_velocity, joint_torques
from vdfmu.arm.equations.kinematics import joint_placement
from vdfmu.arm.equations.spatial import cross_motion, force_transform, joint_axis
from vdfmu.arm.signals import MEASURED, WRENCH
from vdfmu.compiler.unit import Derivative, Input, Output, Parameter, State, Switch, Terminal
from vdfmu.compiler.unit.declaration import Variables
from vdfmu.extras.decompose.units._piece import (
    JOINT,
    Piece,
    coupling,
    friction_choice,
    numbers,
    of_joint,
    plant_ports,
    six_vector,
)


def plant_variables(kind: str) -> dict[str, Any]:
    """Return the variables of a joint that depend on its type."""
    states = {name: of_joint(State, MEASURED[name], kind) for name in ("q", "q_dot", "kappa_dot", "tau_s")}
    starts = {
        f"{name}_0": of_joint(Parameter, (MEASURED[name][0], (), f"start {MEASURED[name][2]}"), kind) for name in states
    }
    return {
        **states,
        **{f"der_{name}": Derivative(state) for name, state in states.items()},
        "kappa": of_joint(Output, MEASURED["kappa"], kind),
        **starts,
        **numbers(*JOINT, joint_type=kind),
    }


class PlantJoint(Piece):
    """A revolute joint with its drive, Eq. (2)-(11), (54)-(56), for an arm that is connected from links and joints.

    Towards the tip it passes on velocity and acceleration, and towards the base the apparent mass and the bias force of
    the bodies on it, which need the force ``M V_dot + p`` at a cutting point. ``c`` is the part of V_B_dot that is
    quadratic in velocities::

        V_B = z q_dot + U_AB' V_A                                           (29)-(31)
        M_A = U_AB M_a U_AB'       p_A = U_AB [p_B + M_a c + M_B z u / d]   d = z' M_B z, u = tau_s - xi_l - z' p_B
        M_a = M_B - M_B z z' M_B / d
        q_ddot = [u - z' M_B (U_AB' V_A_dot + c)] / d      V_B_dot = U_AB' V_A_dot + c + z q_ddot

    Drive and friction are as in the unit Plant. No output depends on itself through its neighbours: velocities depend
    on states and velocities, M and p on these, accelerations on M and p. Unless equilibrium is false, the springs start
    with the torque that holds the bodies on the joint, including the rotors' reaction.
    """

    tau = Input("N.m", text="Motor torque, motor-side")
    ports = Variables(plant_ports("A", Input, Output) | plant_ports("B", Output, Input, np.eye(6)))
    F_A = six_vector(Output, WRENCH, "Force on the joint", "Moment on the joint", "A")
    F_B = six_vector(Output, WRENCH, "Force on the arm beyond the joint", "Moment on the arm beyond the joint", "B")
    P_A = Output("W", text="Virtual power flow V' F at the cutting point {A}, towards the tip")
    P_B = Output("W", text="Virtual power flow V' F at the cutting point {B}, towards the tip")
    of_joint_type = Variables(plant_variables("revolute"))
    friction = friction_choice()
    rotor_coupling = coupling()
    equilibrium = Switch(
        True, "Start with the spring torque that holds the arm beyond the joint, and the rotor at the link's velocity"
    )
    terminals = (
        Terminal("base_side", "left", tuple(plant_ports("A", Input, Output)), "Cutting point {A}"),
        Terminal("tip_side", "right", tuple(plant_ports("B", Output, Input)), "Cutting point {B}"),
        Terminal("joints", "top", ("tau", *MEASURED), "Motor torque and motion of the joint"),
    )
    experiment_stop = 0.2

    def start(self) -> None:
        """Rest, or the start values."""
        self.q, self.q_dot = self.q_0, self.q_dot_0
        if self.equilibrium:
            self.kappa_dot = self.q_dot_0
            robot = self.robot_of_joint()
            self.tau_s = (joint_torques(robot, [self.p_B]) - link_torques(robot, np.array([self.q_0])))[0]
        else:
            self.kappa_dot, self.tau_s = self.kappa_dot_0, self.tau_s_0

    def _state(self) -> PlantState:
        """Return the state, (1,) each."""
        q, q_dot, kappa_dot, tau_s = (np.array([x]) for x in (self.q, self.q_dot, self.kappa_dot, self.tau_s))
        return PlantState(q, q_dot, kappa_dot, tau_s)

    def _drive(self) -> tuple[Any, Any, Any]:
        """Return the robot of this joint, and torques on link and rotor, (1,) each."""
        robot = self.robot_of_joint(friction=self.friction, rotor_coupling=self.rotor_coupling)
        return robot, *plant_torques(robot, self._state(), np.array([self.tau]))

    def _motion(self, robot: Any, tau_l: Any, tau_k: Any) -> dict[str, Any]:
        """Return the signals at the cutting points by name, and the joint's accelerations."""
        z, placement = joint_axis(self.joint_type), joint_placement(robot, 0, self.q)
        U_AB = force_transform(*placement)
        V_B = driven_velocity(z, U_AB, self.V_A, self.q_dot)
        c_B = cross_motion(V_B) @ (z * self.q_dot)
        joint = eliminate(z, self.M_B, self.p_B, tau_l[0])
        M_A, p_A = handed_on(placement, U_AB, self.M_B, self.p_B, c_B, joint)
        q_ddot, V_B_dot = accelerate(z, U_AB, self.V_A_dot, c_B, joint)
        F_B = self.M_B @ V_B_dot + self.p_B
        motion = ChainMotion([U_AB], [V_B], [V_B_dot], Base(V_S=self.V_A, V_S_dot=self.V_A_dot))
        F_D = rotor_reaction(robot, 0, driven_rotor_forces(robot, motion, [self.kappa_dot], tau_k)[0])  # (4), (10)-(11)
        F_A = U_AB @ F_B + F_D
        return {
            "V_B": V_B,
            "V_B_dot": V_B_dot,
            "g_B": placement[0].T @ self.g_A,
            "M_A": M_A,
            "p_A": p_A + F_D,
            "F_A": F_A,
            "F_B": F_B,
            "P_A": self.V_A @ F_A,
            "P_B": V_B @ F_B,
            "der_q_dot": q_ddot,
            "der_kappa_dot": rotor_acceleration(robot, tau_k, motion)[0],
        }

    def outputs(self) -> None:
        """Velocities, apparent mass and bias force, accelerations, forces."""
        robot, *torques = self._drive()
        for name, value in self._motion(robot, *torques).items():
            if not name.startswith("der"):
                setattr(self, name, value)
        state = self._state()
        self.kappa = rotor_position(robot, state.q, state.tau_s)[0]

    def derivatives(self) -> None:
        """Link, rotor and spring."""
        robot, *torques = self._drive()
        motion = self._motion(robot, *torques)
        self.der_q, self.der_q_dot, self.der_kappa_dot = self.q_dot, motion["der_q_dot"], motion["der_kappa_dot"]
        self.der_tau_s = spring_rate(robot, self._state())[0]
