"""The master algorithms, and how many steps a run may have."""

__all__ = ["ALGORITHMS", "CONTINUOUS", "MOST_STEPS"]

ALGORITHMS = ("gauss-seidel", "jacobi", "extrapolated", "iterative")
CONTINUOUS = ("extrapolated", "iterative")
"""Those that take the coupled signals as continuous, between the communication points too."""
MOST_STEPS = 10**9
"""Communication steps of a run: 11 days at 1 kHz."""
