"""Whole studies: a scenario run, compared and reported; what the command line and the Python API share."""

from vdfmu.study.run import run

__all__ = ["run"]
