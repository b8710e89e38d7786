"""The unit FeedforwardTool: the end of an arm in its feedforward."""

from __future__ import annotations

import numpy as np

from vdfmu.arm.equations.kinematics import tool_transform
from vdfmu.arm.signals import wrench
from vdfmu.compiler.unit import Output, Terminal
from vdfmu.compiler.unit.declaration import Variables
from vdfmu.extras.decompose.units._piece import TOOL, Piece, desired_forces, numbers


class FeedforwardTool(Piece):
    """The desired wrench of the end of an arm, Eq. (44).

    ::

        F_B = U_BO F_e_d        its derivatives assumed to be 0
    """

    F_e_d = wrench("to be exerted on the surroundings")
    forces = Variables(desired_forces("B", Output))
    robot_parameters = Variables(numbers("robot", names=TOOL))
    terminals = (
        Terminal("base_side", "left", ("F_B_d", "F_B_r"), "Forces at the last link"),
        Terminal("end_effector", "right", ("F_e_d",), "Desired wrench of the end effector"),
    )

    def outputs(self) -> None:
        """Transform the wrench to the frame of the last link."""
        self.F_B_r = tool_transform(self.robot_of_joint()) @ self.F_e_d
        self.F_B_d = np.stack([self.F_B_r, np.zeros(6), np.zeros(6), self.F_B_r])
