"""Dynamics of serial manipulators with flexible joints, packaged as co-simulation FMUs.

Python API
----------
``load_robot``, ``load_scenario``
    A shipped robot or scenario by name, or a file by path.
``load_motion``
    A motion of a file, worked out for a robot; ``vdfmu.motion`` has functions that make one.
``robot_from_urdf``, ``robot_from_mjcf``
    An arm of a file of another tool.
``inverse_dynamics``, ``forward_dynamics``, ``gravity_torque``, ``mass_matrix``, ``jacobian``, ``forward_kinematics``
    Rigid links, link-side torques, one state or a batch.
``linearize``, ``natural_modes``
    An arm at rest at a pose as a linear system, and its natural frequencies, damping and mode shapes.
``build_fmus``, ``write_ssp``, ``write_osp``, ``write_container``
    The four units as FMUs, the system that wires them as a package or for libcosim, and the system as one FMU.
``run``
    A whole scenario: co-simulation, references, comparison, files.
``animate``
    The arm of a run, moving, in a notebook or a file.
``simulate``, ``load_ssp``
    The master, for systems of FMUs of FMI 2.0 and 3.0.
``federate``
    The same in several processes, on one or several machines.
``Simulator``
    The same for many runs of one system, whose components stay loaded.
``sweep``
    A scenario or package at many points: a table that outlives all that may happen.
``tune``
    Parameters of a scenario that make a stated cost smallest.
``LiveView``, ``RobotView``
    A run while it goes on, and a robot with sliders, in a browser.
``package_limit``
    How much may be unpacked of a package.
"""

from importlib import import_module
from typing import TYPE_CHECKING, Any

__version__ = "0.1.0"

if TYPE_CHECKING:
    from vdfmu.analysis.modes import Modes, natural_modes
    from vdfmu.analysis.space import linearize
    from vdfmu.dynamics import (
        forward_dynamics,
        forward_kinematics,
        gravity_torque,
        inverse_dynamics,
        jacobian,
        mass_matrix,
    )
    from vdfmu.engine.cosim import Results, Simulator, simulate
    from vdfmu.engine.cosim.container import write_container
    from vdfmu.engine.federation import federate
    from vdfmu.engine.space import StateSpace
    from vdfmu.engine.ssp import load_ssp
    from vdfmu.engine.ssp.limits import package_limit
    from vdfmu.errors import VdfmuError
    from vdfmu.fmu import build_fmus
    from vdfmu.model import Robot, load_robot, robot_names
    from vdfmu.motion.read import load_motion
    from vdfmu.report.animation import Animation, animate
    from vdfmu.robots import robot_from_mjcf, robot_from_urdf
    from vdfmu.scenario import Scenario, load_scenario, scenario_names
    from vdfmu.ssp.osp import write_osp
    from vdfmu.ssp.write import write_ssp
    from vdfmu.study.run import run
    from vdfmu.sweeps.run import sweep
    from vdfmu.sweeps.table import Sweep
    from vdfmu.tuning.run import tune
    from vdfmu.view.live import LiveView
    from vdfmu.view.robot import RobotView

_NAMES = {
    "vdfmu.analysis.modes": ("Modes", "natural_modes"),
    "vdfmu.analysis.space": ("linearize",),
    "vdfmu.analysis.run": ("run",),
    "vdfmu.dynamics": (
        "forward_dynamics", "forward_kinematics", "gravity_torque", "inverse_dynamics", "jacobian", "mass_matrix",
    ),
    "vdfmu.engine.cosim": ("Results", "Simulator", "simulate"),
    "vdfmu.engine.cosim.container": ("write_container",),
    "vdfmu.engine.federation": ("federate",),
    "vdfmu.engine.space": ("StateSpace",),
    "vdfmu.engine.ssp": ("load_ssp",),
    "vdfmu.engine.ssp.limits": ("package_limit",),
    "vdfmu.errors": ("VdfmuError",),
    "vdfmu.fmu": ("build_fmus",),
    "vdfmu.model": ("Robot", "load_robot", "robot_names"),
    "vdfmu.motion.read": ("load_motion",),
    "vdfmu.report.animation": ("Animation", "animate"),
    "vdfmu.robots": ("robot_from_mjcf", "robot_from_urdf"),
    "vdfmu.scenario": ("Scenario", "load_scenario", "scenario_names"),
    "vdfmu.ssp.osp": ("write_osp",),
    "vdfmu.ssp.write": ("write_ssp",),
    "vdfmu.sweeps.run": ("sweep",),
    "vdfmu.sweeps.table": ("Sweep",),
    "vdfmu.tuning.run": ("tune",),
    "vdfmu.view.live": ("LiveView",),
    "vdfmu.view.robot": ("RobotView",),
}  # fmt: skip
_WHERE = {name: module for module, names in _NAMES.items() for name in names}

__all__ = [
    "Animation", "LiveView", "Modes", "Results", "Robot", "RobotView", "Scenario", "Simulator", "StateSpace", "Sweep",
    "VdfmuError", "__version__", "animate", "build_fmus", "federate", "forward_dynamics", "forward_kinematics",
    "gravity_torque", "inverse_dynamics", "jacobian", "linearize", "load_motion", "load_robot", "load_scenario",
    "load_ssp", "mass_matrix", "natural_modes", "package_limit", "robot_from_mjcf", "robot_from_urdf", "robot_names",
    "run", "scenario_names", "simulate", "sweep", "tune", "write_container", "write_osp", "write_ssp",
]  # fmt: skip


def __getattr__(name: str) -> Any:
    """Import a name of the API when it is first used, so that an FMU does not load the master or the plots."""
    if name not in _WHERE:
        raise AttributeError(f"module 'vdfmu' has no attribute {name!r}")
    value = globals()[name] = getattr(import_module(_WHERE[name]), name)
    return value


def __dir__() -> list[str]:
    """Names of the API."""
    return sorted(__all__)
