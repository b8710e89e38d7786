"""Turns a scenario into a system: its files, its package for other tools, and its reference solution by scipy."""
