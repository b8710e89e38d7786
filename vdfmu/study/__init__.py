"""Whole studies: a scenario run, compared and reported, for the command line and the Python API."""

DOORS = (
    "analysis.arm_space", "analysis.bode", "analysis.loops", "analysis.modes", "analysis.reach", "analysis.reach_file",
    "connected", "identify.design", "identify.fit", "identify.log", "identify.verdict",
    "judgement", "options", "report.drawings", "report.page", "report.robot_page", "report.sheets",
    "report.shown_run", "run.scenario_run", "runs", "sweeps.sweep", "tuning.tune", "verdict",
)  # fmt: skip
"""Modules that other rooms import."""
