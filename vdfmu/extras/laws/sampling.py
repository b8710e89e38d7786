"""Common parts of devices: samples of the past, rounding, seeds."""

from __future__ import annotations

from typing import Any

import numpy as np

from vdfmu.compiler.scalar import LARGEST_SEED
from vdfmu.compiler.unit import Parameter

PAST = 16
"""Number of samples in the memory of a device, including the newest."""


def seed(start: int) -> Parameter:
    """Seed of the random numbers."""
    return Parameter(
        "1", text="seed of the random numbers, a whole number", start=start, minimum=0, maximum=LARGEST_SEED
    )


def whole(number: Any) -> Any:
    """Return a positive number if all are whole, for requirements."""
    return 0.5 - np.sum(np.abs(number - np.floor(number + 0.5)) > 0.0)


def shifted(past: Any, newest: Any) -> Any:
    """Return the past samples (.., m) with a new one (..) in front and without the oldest."""
    return np.concatenate([np.expand_dims(newest, -1), past[..., :-1]], axis=-1)


def rounded(value: Any, step: Any) -> Any:
    """Return the nearest multiple of a step, with halves rounded up."""
    return step * np.floor(value / step + 0.5)
