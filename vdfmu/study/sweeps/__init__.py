"""Parameter studies: runs at many points, on one or several machines, and their results."""
