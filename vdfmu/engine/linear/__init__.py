"""Linearised systems of FMUs: matrices, margins of loops, and the growth of disturbances along a run."""
