"""Everything that you need to write a drive: options with their laws, and Dahl's element, a spring that slips."""

from vdfmu.arm.drive.dahl import dahl_energy, dahl_loss, dahl_rate
from vdfmu.arm.drive.option import (
    Array,
    Condition,
    DriveOption,
    Friction,
    JointMotion,
    LinkTorque,
    OptionState,
    Parallel,
    Sliding,
    Spring,
    row,
)
from vdfmu.base.measure import POSITIVE
from vdfmu.compiler.scalar import clip, sgn

__all__ = [
    "POSITIVE",
    "Array",
    "Condition",
    "DriveOption",
    "Friction",
    "JointMotion",
    "LinkTorque",
    "OptionState",
    "Parallel",
    "Sliding",
    "Spring",
    "clip",
    "dahl_energy",
    "dahl_loss",
    "dahl_rate",
    "row",
    "sgn",
]
