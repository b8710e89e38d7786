"""Parameter studies: runs at many points, on one machine or several, and what comes of them."""
