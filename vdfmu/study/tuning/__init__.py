"""Tuning: parameters of a scenario that make a stated cost smallest, over a spread of robots and within limits."""
