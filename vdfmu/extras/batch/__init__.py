"""Runs points of a study side by side: all units of a scenario as one program, compiled for a processor's lanes."""
