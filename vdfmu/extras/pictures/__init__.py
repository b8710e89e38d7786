"""Pictures of runs and motions in files, by matplotlib."""
