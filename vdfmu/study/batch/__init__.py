"""Runs of our own units side by side: one compiled program steps several parameter sets, each in a lane of vectors."""
