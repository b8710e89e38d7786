"""The unit Screw: the wrench of a screw on the end effector that drives it."""

from __future__ import annotations

import numpy as np

from vdfmu.arm.signals import WRENCH, six, tool_inputs
from vdfmu.arm.world.contact import normal_force, screw_torque
from vdfmu.compiler.unit import Derivative, Output, Parameter, State, Terminal, Unit, clip, where


class Screw(Unit):
    """Screw that the end effector presses and turns, for a plant with coupled_tool.

    ::

        depth    = a' p_O - distance - pitch turn / (2 pi)    of the bit in the head, moving on as the screw turns
        N        = k depth max(0, 1 + c depth_dot)            axial force, for a depth above 0; else 0
        turn_dot = omega                                      while N > 0, else 0; omega: turning of {O} about a
        T        = (T_0 + T_1 turn) tanh(omega / omega_eps)         thread: grows with the turns that are in
                 + k_seat (turn - turn_seat) max(0, 1 + c_seat omega)       the head is seated, beyond turn_seat
                   and at most r_cam N: there the bit slips out of the head
        F_e      = [R_O' N a, R_O' T a]                       wrench of the arm on the screw, in {O}

    a is the direction of `axis`, into the material. A wrench that is held over a step h is stable for
    ``k h / 2 < d < 2 m / h``, as at a wall: along the axis with ``d = c N``, about it, with the arm's inertia for m, in
    the thread with ``d = (T_0 + T_1 turn) / omega_eps`` and no stiffness, at the seat with k_seat and c_seat T.
    """

    p_O, R_O, V_O = tool_inputs()
    turn = State("rad", text="turn of the screw")
    turn_dot = Derivative(turn)
    F_e = Output(*WRENCH, six("Force of the arm on the screw in {O}", "Moment of the arm on the screw in {O}"))
    N = Output("N", text="Axial force")
    T = Output("N.m", text="Torque about the axis")
    axis = Parameter("1", 3, "Direction into the material in {I}, of any norm, axis", start=[0.0, 0.0, -1.0])
    distance = Parameter("m", text="Distance of the head from the origin of {I} along the axis, at turn 0", start=10.0)
    pitch = Parameter("m", text="Advance of the screw per turn", start=1e-3, minimum=0.0)
    T_0 = Parameter("N.m", text="Torque where the thread begins", start=0.1, minimum=0.0, tunable=True)
    T_1 = Parameter("N.m/rad", text="Rise of the torque per turned angle", start=0.02, minimum=0.0, tunable=True)
    omega_eps = Parameter("rad/s", text="Speed that regularises the friction", start=1.0, minimum=1e-9)
    turn_seat = Parameter("rad", text="Turn at which the head is seated", start=20.0)
    k_seat = Parameter("N.m/rad", text="Rise of the torque per turned angle of a seated head", start=5.0, minimum=0.0)
    c_seat = Parameter("s/rad", text="Damping of the seated head divided by its torque", start=0.1, minimum=0.0)
    r_cam = Parameter("m", text="Largest torque on the head divided by the axial force", start=0.05, minimum=0.0)
    k = Parameter("N/m", text="Axial stiffness of head and bit", start=2e4, minimum=0.0, tunable=True)
    c = Parameter("s/m", text="Axial damping divided by stiffness and depth", start=2.0, minimum=0.0, tunable=True)
    terminals = (Terminal("end_effector", "left", ("p_O", "R_O", "V_O", "F_e"), "Motion and wrench of the tool"),)

    def requirements(self) -> dict[str, tuple[str, float]]:
        """Require an axis."""
        return {"axis": ("a direction", self.axis @ self.axis)}

    def _contact(self) -> tuple[np.ndarray, float, float]:
        """Return the axis in {O}, the axial force and the speed of the tool about the axis."""
        a = self.axis / np.sqrt(self.axis @ self.axis)
        a_O = self.R_O.T @ a
        speed = a_O @ self.V_O[3:]
        lead = self.pitch / (2.0 * np.pi)
        depth = a @ self.p_O - self.distance - lead * self.turn
        return a_O, normal_force(self.k, self.c, depth, a_O @ self.V_O[:3] - lead * speed), speed

    def outputs(self) -> None:
        """Wrench of the arm on the screw."""
        a_O, self.N, speed = self._contact()
        thread = screw_torque(self.T_0, self.T_1, self.omega_eps, self.turn, speed)
        seat = normal_force(self.k_seat, self.c_seat, self.turn - self.turn_seat, speed)
        self.T = clip(thread + seat, -self.r_cam * self.N, self.r_cam * self.N)
        self.F_e = np.concatenate([self.N * a_O, self.T * a_O])

    def derivatives(self) -> None:
        """Turn with the tool while it presses."""
        _, N, speed = self._contact()
        self.turn_dot = where(N > 0.0, speed, 0.0)

    def experiment(self) -> None:
        """Press and turn."""
        self.p_O = np.array([0.0, 0.0, -self.distance - 1e-3])
        self.V_O = np.array([0.0, 0.0, 0.0, 0.0, 0.0, -2.0 + np.sin(self.t)])
