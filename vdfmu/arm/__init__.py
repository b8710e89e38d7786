"""The paper's arm: its numbers, equations, units and motions."""

DOORS = (
    "drive.counterbalance", "drive.dahl", "drive.limits", "drive.option", "drive.options", "dynamics",
    "equations.flexible_joint", "equations.friction", "equations.harmonic_drive", "equations.kinematics",
    "equations.plant", "equations.rigid_body", "equations.trajectory", "export", "fmus", "imports", "motion",
    "motion.read", "robot", "robot.catalogue", "robot.parameters", "robot.plain", "robot.plausible", "robot.visual",
    "units", "units._played", "units.feedforward", "units.plant",
)  # fmt: skip
"""Modules that other rooms import."""
