"""Parameters of an arm from a log of its motion: logs, base parameters, estimation, robot files of it."""

from typing import TYPE_CHECKING

from vdfmu.base.extras import lazy

if TYPE_CHECKING:
    from vdfmu.extras.identify.fit import Identified, identified_robot, identify, score
    from vdfmu.extras.identify.log import Log, read_log
    from vdfmu.extras.identify.motion_choice import SensorNoise, design

__all__ = ["Identified", "Log", "SensorNoise", "design", "identified_robot", "identify", "read_log", "score"]
_FIT = ("Identified", "identified_robot", "identify", "score")
__getattr__ = lazy(__name__, {"motion_choice": ("SensorNoise", "design"), "fit": _FIT, "log": ("Log", "read_log")})
