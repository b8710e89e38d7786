"""A class in numpy becomes functions, C and an FMU. Nothing here knows a robot."""

DOORS = (
    "c.compile", "c.functions", "c.loaded", "c.platforms", "c.text", "functions.sources", "functions.traced", "scalar",
    "targets", "wasm",
)  # fmt: skip
"""Modules that the rooms above may import."""
