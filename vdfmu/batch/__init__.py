"""Runs of our own units side by side: one compiled program steps several parameter sets at once, in lanes of vectors."""
