"""A class in numpy becomes functions, C and an FMU. Nothing here knows a robot."""

DOORS = (
    "c.functions", "c.loaded", "c.text", "fmu.build", "fmu.content", "fmu.description", "fmu.python.slave",
    "fmu.python.wrapper", "functions.sources", "functions.traced", "scalar", "unit", "unit.declaration",
    "unit.evaluate", "unit.interface", "unit.load",
    "unit.new", "unit.solver", "wasm",
)  # fmt: skip
"""Modules that other rooms import."""
