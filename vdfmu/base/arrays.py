"""Types of arrays, and their elements by name."""

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

Floats = NDArray[np.float64]


def with_named(numbers: ArrayLike, name: str, values: Mapping[str, Any]) -> Floats:
    """Return numbers, with those in `values` by the names of their elements, counted from 1: ``name[2,3]``."""
    found = np.array(numbers, dtype=np.float64)
    for place in np.ndindex(found.shape):
        index = ",".join(str(i + 1) for i in place)
        found[place] = values.get(f"{name}[{index}]" if index else name, found[place])
    return found
