"""The unit PlantLink: a link of an arm."""

from __future__ import annotations

from vdfmu.arm.equations.rigid_body import bias_force, link_body, mass_matrix
from vdfmu.arm.units._signals import MASS
from vdfmu.arm.units.pieces._piece import Piece, force, gravity, numbers, rate, velocity
from vdfmu.compiler.unit import Input, Output, Terminal


class PlantLink(Piece):
    """A link, Eq. (47), (59)-(62), in an arm that is wired from its links and joints; see the unit PlantJoint.

    ::

        M_B = M + M_C + M_D        p_B = C_B V_B + G_B + p_C + p_D

    Two joints can hang on it, or one and a tool; M and p that nothing is connected to are 0.
    """

    V_B = velocity(Input, "in {B}")
    V_B_dot = rate(Input, "in {B}")
    g_B = gravity(Input, "in {B}")
    M_C = Input(*MASS, "Apparent mass matrix of what hangs on the link in {B}")
    p_C = force(Input, "on what hangs on the link at V_B_dot = 0 in {B}")
    M_D = Input(*MASS, "Apparent mass matrix of what else hangs on the link in {B}")
    p_D = force(Input, "on what else hangs on the link at V_B_dot = 0 in {B}")
    V_C = velocity(Output, "in {B}")
    V_C_dot = rate(Output, "in {B}")
    g_C = gravity(Output, "in {B}")
    M_B = Output(*MASS, "Apparent mass matrix of the link and what hangs on it in {B}")
    p_B = force(Output, "on the link and what hangs on it at V_B_dot = 0 in {B}")
    vars().update(numbers("link"))
    terminals = (
        Terminal("base_side", "left", ("V_B", "V_B_dot", "g_B", "M_B", "p_B"), "Cutting point {B}"),
        Terminal("tip_side", "right", ("V_C", "V_C_dot", "g_C", "M_C", "p_C"), "Cutting point towards the tip"),
    )

    def outputs(self) -> None:
        """Hand on the motion, and apparent mass and bias force."""
        body = link_body(self.one(), 0)
        self.V_C, self.V_C_dot, self.g_C = self.V_B, self.V_B_dot, self.g_B
        self.M_B = mass_matrix(*body) + self.M_C + self.M_D
        self.p_B = bias_force(*body, self.g_B, self.V_B) + self.p_C + self.p_D
