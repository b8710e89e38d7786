"""The unit ArmBase: what the first joint of an arm stands on."""

from __future__ import annotations

import numpy as np

from vdfmu.arm.units.pieces._piece import Piece, gravity, numbers, rate, velocity
from vdfmu.compiler.unit import Output, Terminal


class ArmBase(Piece):
    """Base at rest in {I}, of an arm that is wired from its links and joints.

    A body that stands on it, or any number of joints, takes its velocity, which is 0, and its gravity vector.
    """

    V_C = velocity(Output, "of the base, 0")
    V_C_dot = rate(Output, "of the base, 0")
    g_C = gravity(Output, "in {I}")
    vars().update(numbers("robot", names=("gravity",)))
    terminals = (Terminal("tip_side", "right", ("V_C", "V_C_dot", "g_C"), "Motion of the cutting point"),)

    def outputs(self) -> None:
        """Rest under gravity."""
        self.V_C, self.V_C_dot, self.g_C = np.zeros(6), np.zeros(6), self.one().gravity
