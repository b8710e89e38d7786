"""The paper's arm: its numbers, equations, units and motions."""

DOORS = (
    "drive.counterbalance", "drive.limits", "drive.options", "dynamics", "equations.flexible_joint",
    "equations.friction", "equations.harmonic_drive", "equations.kinematics", "equations.plant", "equations.rigid_body",
    "equations.trajectory", "fmus", "imports", "motion", "robot", "robot.catalogue", "robot.parameters",
    "robot.plausible", "units", "units._played", "units.feedforward", "units.plant",
)  # fmt: skip
"""Modules for the rooms above."""
