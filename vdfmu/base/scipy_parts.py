"""Modules of scipy without the others of their packages, which take 0.1 to 0.3 s to import."""

from __future__ import annotations

import sys
import warnings
from collections.abc import Callable
from contextlib import suppress
from importlib import import_module
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np
import scipy

from vdfmu.base.arrays import Floats


def scipy_part(name: str) -> Any:
    """Return a module of scipy by its full name; its package, whole, for a scipy that has no such module."""
    package = name.rpartition(".")[0]
    stand_in = ModuleType(package)
    stand_in.__path__ = [str(Path(path, *package.split(".")[1:])) for path in scipy.__path__]
    sys.modules.setdefault(package, stand_in)
    try:
        with suppress(ImportError):
            return import_module(name)
    finally:
        if sys.modules[package] is stand_in:
            del sys.modules[package]
    return import_module(package)


def odeint(rate: Callable[[float, Floats], Floats], x: Floats, times: Floats, **options: Any) -> tuple[Floats, str]:
    """Return LSODA's solution from `x` on at times, the first the start, one a row, and why it failed, if it did."""
    options |= {"full_output": 1, "tfirst": 1}
    with suppress(TypeError, ValueError):  # a scipy whose parts are others
        states, _, state = scipy_part("scipy.integrate._odepack").odeint(rate, x, times, **options)
        if state == 2 and np.isfinite(states[-1]).all():
            return states, ""
    from scipy.integrate import odeint as whole

    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        states, info = whole(rate, x, times, **options)
    solved = info["message"] == "Integration successful." and np.isfinite(states[-1]).all()
    return states, "" if solved else info["message"]
