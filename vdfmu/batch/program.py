"""The compiled communication steps of a system, as a worker gets them."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

__all__ = ["LANES", "Program"]

LANES = 8
"""Most lanes that a processor has."""


@dataclass(frozen=True)
class Program:
    """The compiled communication steps of a system.

    Attributes
    ----------
    libraries : tuple of bytes
        As of :data:`vdfmu.batch.make.LEVELS`, as many as the platform has.
    memory : (m,) array
        Values before the start.
    parameters : dict of str to (place, least, largest)
        What a point may set, ``component.variable``, and its limits.
    signals : dict of str to (place, unit)
        What can be recorded.
    optional : list of list of int
        Places that a call sets which runs where one of them is recorded.
    fed : (k,) places of inputs from outside
    course : (n, k) their values over the steps
    points, sizes : (n,) begin and length of the communication steps [s]
    time : (n + 1,) of the rows [s]
    """

    libraries: tuple[bytes, ...]
    memory: npt.NDArray[np.float64]
    parameters: Mapping[str, tuple[int, float, float]]
    signals: Mapping[str, tuple[int, str]]
    optional: list[list[int]]
    fed: npt.NDArray[np.int64]
    course: npt.NDArray[np.float64]
    points: npt.NDArray[np.float64]
    sizes: npt.NDArray[np.float64]
    time: npt.NDArray[np.float64]
