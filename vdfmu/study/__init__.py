"""Whole studies: a scenario run, compared and reported, for the command line and the Python API."""
