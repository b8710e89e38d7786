"""The unit PlantPrismaticJoint: a prismatic joint of an arm, with its drive."""

from __future__ import annotations

from typing import ClassVar

from vdfmu.compiler.unit.declaration import Variables
from vdfmu.extras.decompose.units.plant_joint import PlantJoint, plant_variables


class PlantPrismaticJoint(PlantJoint):
    """A prismatic joint with its drive, for an arm that is connected from links and joints: see the unit PlantJoint.

    It moves along z of {B}: q is in m, torques of link and spring are forces, ell is in rad/m.
    """

    joint_type: ClassVar[str] = "prismatic"
    of_joint_type = Variables(plant_variables("prismatic"))
