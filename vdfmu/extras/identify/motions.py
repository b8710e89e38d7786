"""Kinds of motions that this extra adds to the table ``[motion]`` of a scenario."""

from vdfmu.extras.identify.excitation import multisine, sweep
from vdfmu.extras.identify.minimum_time import fastest

MOTIONS = (fastest, sweep, multisine)
