"""Whole studies: a scenario run, compared and reported; what the command line and the Python API share."""
