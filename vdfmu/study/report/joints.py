"""Units in which the values of joints are shown, by type of joint."""

from __future__ import annotations

from typing import NamedTuple

from vdfmu.base.measure import shown_as, unit_of


class JointUnit(NamedTuple):
    """Units of one type of joint, and the factor of positions from rad or m."""

    joint_type: str
    position: str
    factor: float
    torque: str
    noun: str


UNITS = {
    kind: JointUnit(kind, *shown_as("position", kind), unit_of("torque", kind), noun)
    for kind, noun in (("revolute", "torque"), ("prismatic", "force"))
}
"""Type of a joint to its units."""
