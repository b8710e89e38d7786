"""The unit FeedforwardPrismaticJoint: one prismatic joint in the feedforward of its arm."""

from __future__ import annotations

from typing import ClassVar

from vdfmu.compiler.unit.declaration import Variables
from vdfmu.extras.decompose.units.feedforward_joint import FeedforwardJoint, feedforward_variables


class FeedforwardPrismaticJoint(FeedforwardJoint):
    """A prismatic joint in the feedforward of its arm: see the unit FeedforwardJoint.

    It moves along z of {B}: q is in m, torques of link and spring are forces, ell is in rad/m.
    """

    joint_type: ClassVar[str] = "prismatic"
    of_joint_type = Variables(feedforward_variables("prismatic"))
