"""Checks of the arguments of motions, in the same words from Python and from files."""

from __future__ import annotations

from collections.abc import Callable
from functools import wraps
from inspect import signature
from typing import Any, ParamSpec, TypeVar

import numpy as np

from vdfmu.base.errors import UsageError
from vdfmu.base.toml_tables import shown

TEXTS = ("orientation", "law", "phases")
WHOLE = ("periods", "seed", "lines")
SINGLE = ("angle", "duration", "period", "periods", "seed", "smoothing", "speed", "tolerance")
NUMBERS = "a number, or a list or rows of them"
ONE = "one number"
P = ParamSpec("P")
R = TypeVar("R")


def of_numbers(make: Callable[P, R]) -> Callable[P, R]:
    """Have a function raise UsageError for arguments that are not numbers, with a line for each."""
    bound = signature(make).bind

    @wraps(make)
    def checked(*args: P.args, **kwargs: P.kwargs) -> R:
        try:
            given = bound(*args, **kwargs).arguments
        except TypeError:  # in Python's words, which name the function
            return make(*args, **kwargs)
        problems = [
            f"{name}: expected {expected}, got {shown(value)}."
            for name, value in given.items()
            if name != "robot" and (expected := _expected(name, value))
        ]
        if problems:
            raise UsageError("\n".join(problems))
        return make(*args, **kwargs)

    return checked


def _expected(name: str, value: Any) -> str:
    """Return what an argument should be, if it is something else."""
    if value is None or (name in TEXTS and isinstance(value, str)):
        return ""
    try:
        array = np.array(value)
    except ValueError:  # rows of different lengths
        return NUMBERS
    if array.size and array.dtype.kind not in "iuf":
        return ONE if name in SINGLE else NUMBERS
    return ONE if array.ndim and name in SINGLE else ""
