"""Whole studies: a scenario run, compared and reported, for the command line and the Python API."""

DOORS = (
    "connected", "options", "referee", "report.drawings", "report.page", "report.sheets", "report.shown_run",
    "run.scenario_run", "runs", "view.live", "view.robot",
)  # fmt: skip
"""Modules that rooms above import."""
