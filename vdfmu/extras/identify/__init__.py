"""Identifies the parameters of an arm from a log: logs, base parameters, estimation, robot files, suitable motions."""

from typing import TYPE_CHECKING

from vdfmu.base.extras import lazy

if TYPE_CHECKING:
    from vdfmu.extras.identify.excitation import multisine, sweep
    from vdfmu.extras.identify.fit import Identified, identified_robot, identify, score
    from vdfmu.extras.identify.log import Log, read_log
    from vdfmu.extras.identify.minimum_time import fastest
    from vdfmu.extras.identify.motion_choice import SensorNoise, design
    from vdfmu.extras.identify.stiffness import Stiffness, identify_stiffness
    from vdfmu.extras.identify.stiffness_design import stiffness_experiment

__all__ = [
    "Identified",
    "Log",
    "SensorNoise",
    "Stiffness",
    "design",
    "fastest",
    "identified_robot",
    "identify",
    "identify_stiffness",
    "multisine",
    "read_log",
    "score",
    "stiffness_experiment",
    "sweep",
]
_NAMES = {
    "excitation": ("multisine", "sweep"),
    "fit": ("Identified", "identified_robot", "identify", "score"),
    "log": ("Log", "read_log"),
    "minimum_time": ("fastest",),
    "motion_choice": ("SensorNoise", "design"),
    "stiffness": ("Stiffness", "identify_stiffness"),
    "stiffness_design": ("stiffness_experiment",),
}
__getattr__ = lazy(__name__, _NAMES)
