"""The unit PlantPrismaticJoint: a prismatic joint of an arm, with its drive."""

from __future__ import annotations

from typing import ClassVar

from vdfmu.extras.decompose.units.plant_joint import PlantJoint, plant_variables


class PlantPrismaticJoint(PlantJoint):
    """A prismatic joint with its drive, in an arm that is wired from its links and joints: see the unit PlantJoint.

    It moves along z of {B}: q is in m, torques of link and spring are forces, ell is in rad/m.
    """

    joint_type: ClassVar[str] = "prismatic"
    vars().update(plant_variables("prismatic"))
