"""Turns equations into fast functions: traced once and cached, with derivatives, and a step of the solver."""
