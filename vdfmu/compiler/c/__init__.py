"""C of traced functions and of units, and its compilation for each platform."""
