"""Parameters of an arm from a log of its motion: logs, base parameters, estimation, robot files, and such motions."""

from typing import TYPE_CHECKING

from vdfmu.base.extras import lazy

if TYPE_CHECKING:
    from vdfmu.extras.identify.excitation import multisine, sweep
    from vdfmu.extras.identify.fit import Identified, identified_robot, identify, score
    from vdfmu.extras.identify.log import Log, read_log
    from vdfmu.extras.identify.minimum_time import fastest
    from vdfmu.extras.identify.motion_choice import SensorNoise, design

__all__ = [
    "Identified",
    "Log",
    "SensorNoise",
    "design",
    "fastest",
    "identified_robot",
    "identify",
    "multisine",
    "read_log",
    "score",
    "sweep",
]
_NAMES = {
    "excitation": ("multisine", "sweep"),
    "fit": ("Identified", "identified_robot", "identify", "score"),
    "log": ("Log", "read_log"),
    "minimum_time": ("fastest",),
    "motion_choice": ("SensorNoise", "design"),
}
__getattr__ = lazy(__name__, _NAMES)
