"""Observers and filters for what a robot measures, one unit a file."""
