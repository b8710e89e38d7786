"""Whole studies: a scenario run, compared and reported, for the command line and the Python API."""

DOORS = (
    "analysis.arm_space", "analysis.bode", "analysis.loops", "analysis.modes", "analysis.reach", "analysis.reach_file",
    "connected", "judgement", "options", "report.drawings", "report.page", "report.robot_page", "report.sheets",
    "report.shown_run", "run.prepare", "runs", "sweeps.sweep", "verdict",
)  # fmt: skip
"""Modules that other rooms import."""
