"""Compiles a class in numpy into functions, C and an FMU. Nothing in this package depends on robots."""
