"""A class in numpy becomes functions, C and an FMU. Nothing here knows a robot."""

DOORS = (
    "fmu.build", "fmu.content", "fmu.description",
    "unit", "unit.declaration", "unit.evaluate", "unit.interface", "unit.load", "unit.new", "unit.solver",
)  # fmt: skip
"""Modules that the rooms above may import."""
