"""Results of a run: in memory, on disk, and as tables and pictures."""
