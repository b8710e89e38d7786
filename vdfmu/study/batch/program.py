"""The compiled communication steps of a system, as a worker gets them."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from vdfmu.base.arrays import Floats

LANES = 8
"""Most lanes that a processor has."""


@dataclass(frozen=True)
class BatchProgram:
    """The compiled communication steps of a system."""

    libraries: tuple[bytes, ...]
    """See :data:`vdfmu.study.batch.make.LEVELS`, as many as the platform has."""
    memory: Floats
    """Values before the start, (m,)."""
    parameters: Mapping[str, tuple[int, float, float]]
    """Variables that a point may set, ``component.variable``: place, least and largest value."""
    signals: Mapping[str, tuple[int, str]]
    """Signals that can be recorded: place and unit."""
    optional: list[list[int]]
    """Places set by calls that run only if one of these places is recorded."""
    fed: npt.NDArray[np.int64]
    """Places of the inputs from outside, (k,)."""
    course: Floats
    """Their values in the steps, (n, k)."""
    points: Floats
    """Begin of each step [s], (n,)."""
    sizes: Floats
    """Length of each step [s], (n,)."""
    time: Floats
    """Times of the rows [s], (n + 1,)."""
