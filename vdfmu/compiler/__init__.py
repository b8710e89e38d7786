"""A class in numpy becomes functions, C and an FMU. Nothing in this package depends on robots."""
