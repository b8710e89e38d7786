"""The version of the package, and the version of its files' layout."""

__version__ = "0.1.0"
FORMAT = 1
"""Version of robot, scenario and system files and of ``summary.json``: their key ``format``, 1 by default.

A layout that an older vdfmu would misread or reject gets the next number, and readers for older numbers are kept.
"""
