"""Motions that are computed before the run: functions that make one, and ``load_motion``, which reads one."""

from typing import Any

from vdfmu.arm.motion import *  # noqa: F403
from vdfmu.arm.motion import __all__ as __all__

_MOVED = {"circle": "paths", "fastest": "identify", "line": "paths", "multisine": "identify", "sweep": "identify"}
"""Motions of extras."""


def __getattr__(name: str) -> Any:
    """Name the extra that a motion moved to."""
    if extra := _MOVED.get(name):
        raise ImportError(f"vdfmu.motion.{name} moved. Write: from vdfmu.extras.{extra} import {name}")
    raise AttributeError(f"module 'vdfmu.motion' has no attribute {name!r}")
