"""A scenario becomes a system: its files, its package for other tools, and its reference by scipy."""

DOORS = (
    "inspect_source", "package.description", "package.drawing", "package.write", "program", "reference.reference",
    "reference.wired", "scenario", "scenario.check", "scenario.decomposed", "scenario.replace",
    "scenario.schema", "scenario.values",
)  # fmt: skip
"""Modules that other rooms import."""
