"""The unit PlantLink: a link of an arm."""

from __future__ import annotations

from vdfmu.arm.equations.rigid_body import bias_force, mass_matrix
from vdfmu.compiler.unit import Input, Output, Terminal
from vdfmu.compiler.unit.declaration import Variables
from vdfmu.extras.decompose.units._piece import Piece, apparent, numbers, plant_ports


class PlantLink(Piece):
    """A link, Eq. (47), (59)-(62), for an arm that is connected from links and joints; see the unit PlantJoint.

    ::

        M_B = M + M_C + M_D        p_B = C_B V_B + G_B + p_C + p_D

    Two joints, or a joint and a tool, can be attached to it; unconnected M and p are 0.
    """

    ports = Variables(plant_ports("B", Input, Output) | plant_ports("C", Output, Input) | apparent("D", Input))
    link_parameters = Variables(numbers("link"))
    terminals = (
        Terminal("base_side", "left", tuple(plant_ports("B", Input, Output)), "Cutting point {B}"),
        Terminal("tip_side", "right", tuple(plant_ports("C", Output, Input)), "Cutting point {C}"),
    )

    def outputs(self) -> None:
        """Pass on the motion, the apparent mass and the bias force."""
        m_B, r_B, I_B = self.robot_of_joint().body(0)
        self.V_C, self.V_C_dot, self.g_C = self.V_B, self.V_B_dot, self.g_B
        self.M_B = mass_matrix(m_B, r_B, I_B) + self.M_C + self.M_D
        self.p_B = bias_force(m_B, r_B, I_B, self.g_B, self.V_B) + self.p_C + self.p_D
