"""The unit ArmBase: the base of an arm."""

from __future__ import annotations

import numpy as np

from vdfmu.compiler.unit import Input, Output, Terminal
from vdfmu.compiler.unit.declaration import Variables
from vdfmu.extras.decompose.units._piece import Piece, numbers, plant_ports


class ArmBase(Piece):
    """Base at rest in {I}, for an arm that is connected from links and joints.

    A body on it, or any number of joints, receives its zero velocity and its gravity vector.
    """

    ports = Variables({name: signal for name, signal in plant_ports("C", Output, Input).items() if name[0] in "Vg"})
    robot_parameters = Variables(numbers("robot", names=("gravity",)))
    terminals = (Terminal("tip_side", "right", ("V_C", "g_C", "V_C_dot"), "Cutting point {C}"),)

    def outputs(self) -> None:
        """Rest under gravity."""
        self.V_C, self.V_C_dot, self.g_C = np.zeros(6), np.zeros(6), self.robot_of_joint().gravity
