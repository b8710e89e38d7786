"""A scenario becomes a system: its files, its package for other tools, and its reference by scipy."""
