"""Runs side by side: the program of a system in C, with a parameter set in each lane of a vector."""
