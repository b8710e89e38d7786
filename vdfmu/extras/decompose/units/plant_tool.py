"""The unit PlantTool: the end of an arm that is wired from its links and joints."""

from __future__ import annotations

from vdfmu.arm.equations.kinematics import tool_transform
from vdfmu.arm.signals import WRENCH, wrench
from vdfmu.compiler.unit import Input, Output, Terminal
from vdfmu.compiler.unit.declaration import Variables
from vdfmu.extras.decompose.units._piece import TOOL, Piece, numbers, six_vector


class PlantTool(Piece):
    """The wrench of the end of an arm on its surroundings, Eq. (44).

    ::

        p_B = U_BO F_e
    """

    F_e: Input = wrench("of the arm on its surroundings")
    p_B = six_vector(Output, WRENCH, "Force on the surroundings", "Moment on the surroundings", "B")
    robot_parameters = Variables(numbers("robot", names=TOOL))
    terminals = (
        Terminal("base_side", "left", ("p_B",), "Force at the last link"),
        Terminal("end_effector", "right", ("F_e",), "Wrench of the end effector"),
    )

    def outputs(self) -> None:
        """Transform the wrench to the frame of the last link."""
        self.p_B = tool_transform(self.robot_of_joint()) @ self.F_e
