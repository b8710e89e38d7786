"""Types of arrays."""

from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

Floats = NDArray[np.float64]


def distinct(values: ArrayLike) -> NDArray[Any]:
    """Return the distinct values of an array in their order, as `numpy.unique`, which imports masked arrays for it."""
    found = np.sort(values, axis=None)
    return found[np.append(True, found[1:] != found[:-1])[: found.size]]
