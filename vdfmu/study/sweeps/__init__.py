"""Parameter studies: runs at many points, on one machine or several, and their results."""
