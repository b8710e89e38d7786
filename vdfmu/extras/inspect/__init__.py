"""Checks of an FMU beyond ten steps: its reference results, and every call that it declares."""
