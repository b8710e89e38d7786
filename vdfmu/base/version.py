"""The version of the package, and of the layout of its files."""

__version__ = "0.1.0"
FORMAT = 1
"""Layout of robot, scenario and system files and of ``summary.json``: their key ``format``, by default 1.

If an older vdfmu would misread or reject a new layout, the layout gets the next number, and readers for older numbers
are kept.
"""
