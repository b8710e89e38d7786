"""How joints are grouped and named in pictures: by unit, letters of panels."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

from vdfmu.arm.robot import Robot
from vdfmu.base.measure import JOINT_UNITS, JointUnit


class Group(NamedTuple):
    """Joints that share a unit, counted from 0; `suffix` names their type where there is more than one."""

    unit: JointUnit
    joints: list[int]
    suffix: str


def group_joints(robot: Robot, joints: Sequence[int]) -> list[Group]:
    """Return `joints` by unit, revolute first; units of no joint are left out."""
    members = {unit: [i for i in joints if robot.joint_types[i] == unit.joint_type] for unit in JOINT_UNITS.values()}
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
