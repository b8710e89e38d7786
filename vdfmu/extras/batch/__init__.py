"""Points of a study side by side: all units of a scenario as one program, compiled for the lanes of a processor."""
