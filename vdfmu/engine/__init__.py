"""The engine: reading, checking and running of any system of FMUs. It knows nothing of robots.

It imports nothing of the package but errors, files, processes and units of measurement.
"""

DOORS = (
    "federation", "fmu.variables", "inspect.inspection", "inspect.trial", "package.archive", "package.join",
    "package.limits", "package.parse", "package.read", "package.system",
)  # fmt: skip
"""Modules for the rooms above."""
