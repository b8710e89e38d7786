"""Motions calculated before a run, as polynomials for a unit that replaces the scenario's trajectory."""

from vdfmu.arm.motion.joint_space import samples, waypoints
from vdfmu.arm.motion.polynomial import Motion, joined, rest
from vdfmu.arm.motion.read import check_motion as check_motion
from vdfmu.arm.motion.read import kinds as kinds
from vdfmu.arm.motion.read import load_motion
from vdfmu.arm.motion.read import read_motion as read_motion

__all__ = ["Motion", "joined", "load_motion", "rest", "samples", "waypoints"]
