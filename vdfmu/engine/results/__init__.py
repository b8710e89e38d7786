"""Results of a run: in memory, on disk, as tables and pictures."""
