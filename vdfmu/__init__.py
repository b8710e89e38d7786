"""Dynamics of serial manipulators with flexible joints, packaged as co-simulation FMUs."""

__version__ = "0.1.0"
