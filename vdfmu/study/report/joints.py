"""How joints are grouped and named in pictures: units by type of joint, letters of panels."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

from vdfmu.arm.robot import Robot


class JointUnit(NamedTuple):
    """How the values of one type of joint are shown: units, and the factor from rad or m."""

    joint_type: str
    position: str
    factor: float
    torque: str
    noun: str


class Group(NamedTuple):
    """Joints that share a unit, counted from 0; `suffix` names their type where there is more than one."""

    unit: JointUnit
    joints: list[int]
    suffix: str


UNITS = {
    "revolute": JointUnit("revolute", "deg", 180.0 / math.pi, "N.m", "torque"),
    "prismatic": JointUnit("prismatic", "mm", 1e3, "N", "force"),
}
"""Type of a joint to how it is shown."""


def group_joints(robot: Robot, joints: Sequence[int]) -> list[Group]:
    """Return `joints` by unit, revolute first; units of no joint are left out."""
    members = {unit: [i for i in joints if robot.joint_types[i] == unit.joint_type] for unit in UNITS.values()}
    present = {unit: found for unit, found in members.items() if found}
    return [Group(unit, found, f", {unit.joint_type}" if len(present) > 1 else "") for unit, found in present.items()]


def panel_letter(place: int) -> str:
    """Return (a), (b), ... (z), (aa), ... for the places from 0."""
    text = ""
    place += 1
    while place:
        place, digit = divmod(place - 1, 26)
        text = chr(ord("a") + digit) + text
    return f"({text})"
