"""The compiled program of a system: its calculations in their order, and the module of a page."""
