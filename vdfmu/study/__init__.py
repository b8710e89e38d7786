"""Whole studies: a scenario run, compared and reported, for the command line and the Python API."""

DOORS = (
    "analysis.arm_space", "analysis.bode", "analysis.loops", "analysis.modes", "analysis.reach", "connected",
    "environment.environments", "identify.design", "identify.fit", "identify.log", "options", "sweeps.sweep",
    "tuning.tune",
)  # fmt: skip
"""Modules that the command line and the top level import."""
