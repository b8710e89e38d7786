"""Checks of an FMU beyond ten steps: the reference results in it, and every call that it declares."""
