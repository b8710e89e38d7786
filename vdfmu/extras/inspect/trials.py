"""Trials that this extra adds when ``vdfmu check`` runs an FMU."""

from vdfmu.extras.inspect.abilities import try_abilities
from vdfmu.extras.inspect.reference import try_references

TRIALS = {"the comparison with the reference results": try_references, "the calls that it declares": try_abilities}
"""Names in messages, and functions of the path, of start and step [s], and of the watch of calls."""
