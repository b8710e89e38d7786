"""Pages of several runs: their comparison, and the list of a folder of runs."""
