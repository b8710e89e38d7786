"""Kinds of motions that this extra adds to the table ``[motion]`` of a scenario."""

from vdfmu.extras.paths.cartesian import circle, line

MOTIONS = (line, circle)
