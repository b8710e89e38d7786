"""Motions that are worked out before the run: functions that make one, and ``load_motion``, which reads one."""

from vdfmu.arm.motion import *  # noqa: F403
from vdfmu.arm.motion import __all__ as __all__
