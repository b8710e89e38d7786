"""Motions that are worked out before the run: functions that make one, and ``load_motion``, which reads one."""

from typing import Any

from vdfmu.arm.motion import *  # noqa: F403
from vdfmu.arm.motion import __all__ as __all__


def __getattr__(name: str) -> Any:
    """Return what a deprecated name is now."""
    from vdfmu.base.words import renamed

    return renamed(__name__, globals(), name)
