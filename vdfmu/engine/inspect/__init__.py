"""Checks of FMUs and packages, by ``vdfmu check``."""
