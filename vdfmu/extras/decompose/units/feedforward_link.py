"""The unit FeedforwardLink: one link in the feedforward of its arm."""

from __future__ import annotations

import numpy as np

from vdfmu.arm.equations.feedforward import required_net_force
from vdfmu.arm.equations.rigid_body import net_force
from vdfmu.arm.world.attachment import turning_gravity
from vdfmu.compiler.scalar import derivative
from vdfmu.compiler.unit import Input, Output, Parameter, Terminal
from vdfmu.compiler.unit.declaration import Variables
from vdfmu.extras.decompose.units._piece import Piece, desired_forces, desired_ports, numbers, row_pair


class FeedforwardLink(Piece):
    """A link in the feedforward of its arm, Eq. (50)-(53); see the unit Feedforward.

    Towards the tip it passes on the velocities of its joint, and towards the base its own forces plus those of the
    bodies beyond::

        F_B = M_B V_B_dot + C_B V_B + G_B + F_C + F_D                      desired, with two derivatives, (44)-(47)
        F_B_r = M_B V_B_r_dot + C_B V_B_r + G_B + K_V (V_B_r - V_B) + F_C_r + F_D_r                        (50)-(53)

    Two joints can be attached to it; an unconnected force is 0.
    """

    ports = Variables(
        desired_ports("B", Input, Output) | desired_ports("C", Output, Input) | desired_forces("D", Input)
    )
    K_V = Parameter(
        "1", text="Gain K_B in SI units, times the unit matrix, Eq. (50)", start=0.01, minimum=0.0, tunable=True
    )
    link_parameters = Variables(numbers("link"))
    terminals = (
        Terminal("base_side", "left", tuple(desired_ports("B", Input, Output)), "Cutting point {B}"),
        Terminal("tip_side", "right", tuple(desired_ports("C", Output, Input)), "Cutting point {C}"),
    )

    def outputs(self) -> None:
        """Pass on velocities and forces."""
        m_B, r_B, I_B = body = self.robot_of_joint().body(0)
        self.V_C_d, self.g_C_d = self.V_B_d, self.g_B_d
        self.V_C, self.V_C_r, self.V_C_r_dot, self.g_C = self.V_B, self.V_B_r, self.V_B_r_dot, self.g_B
        g = turning_gravity(self.g_B_d, *self.V_B_d[:2])
        net, hanging = net_force(m_B, r_B, I_B, g, *row_pair(self.V_B_d)), self.F_C_d + self.F_D_d
        self.F_B_d = np.stack([derivative(net, k) for k in (0, 1, 2, 0)]) + hanging
        own_r = required_net_force(body, self.K_V, self.g_B, self.V_B, self.V_B_r, self.V_B_r_dot)
        self.F_B_r = own_r + self.F_C_r + self.F_D_r
