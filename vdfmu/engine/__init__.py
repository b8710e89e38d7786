"""The engine: reading, checking and running of any system of FMUs. It knows nothing of robots.

It imports nothing of the package but errors, files, processes and units of measurement.
"""

DOORS = (
    "algorithms", "container", "fmu.access", "fmu.variables", "inspect.inspection", "inspect.trial",
    "linear.growth", "linear.linearise", "linear.loops", "linear.system", "masters.components", "masters.observer",
    "masters.sampled", "options", "package.archive", "package.join", "package.limits", "package.parse",
    "package.read", "package.system", "package.writing", "package_run", "plan.check", "plan.grid", "plan.inputs",
"results.csv_file", "results.figure", "results.folder", "results.formats", "results.mat_file", "results.parquet",
    "results.picture", "results.results", "results.verdict", "rules", "run",
)  # fmt: skip
"""Modules that other rooms import."""
