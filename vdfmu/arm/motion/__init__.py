"""Motions calculated before the run, as polynomials for a unit that replaces a scenario's trajectory."""

from vdfmu.arm.motion.cartesian import circle, line
from vdfmu.arm.motion.excitation import multisine, sweep
from vdfmu.arm.motion.joint_space import samples, waypoints
from vdfmu.arm.motion.minimum_time import fastest
from vdfmu.arm.motion.polynomial import Motion, joined, rest
from vdfmu.arm.motion.read import KINDS, OF_FILE, check_motion, load_motion, read_motion  # noqa: F401

__all__ = [
    "Motion", "circle", "fastest", "joined", "line", "load_motion", "multisine", "rest", "samples", "sweep",
    "waypoints",
]  # fmt: skip
