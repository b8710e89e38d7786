"""Dynamics of serial manipulators with flexible joints, packaged as co-simulation FMUs.

Python API
----------
``build``
    One FMU: of a class of Unit, a file with one, or a unit of this package.
``connect``, ``load``
    A system of FMUs as one object, of FMUs and connections, or of a package, an FMU or a scenario.
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
``build_fmus``, ``write_ssp``, ``write_container``
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
``ArmEnv``, ``ArmVectorEnv``
    A scenario as an environment of gymnasium, for one arm or many.
``LiveView``, ``RobotView``
    A run while it goes on, and a robot with sliders, in a browser.
``package_limit``
    How much may be unpacked of a package.
"""

from importlib import import_module
from typing import TYPE_CHECKING, Any

from vdfmu.base.version import __version__

if TYPE_CHECKING:
    from vdfmu.arm.dynamics import (
        forward_dynamics,
        forward_kinematics,
        gravity_torque,
        inverse_dynamics,
        jacobian,
        mass_matrix,
    )
    from vdfmu.arm.fmus import build, build_fmus
    from vdfmu.arm.imports import robot_from_mjcf, robot_from_urdf
    from vdfmu.arm.motion.read import load_motion
    from vdfmu.arm.robot import Robot, load_robot, robot_names
    from vdfmu.base.errors import VdfmuError
    from vdfmu.base.state_space import StateSpace
    from vdfmu.engine.container import write_container
    from vdfmu.engine.federation import federate
    from vdfmu.engine.package import load_ssp
    from vdfmu.engine.package.limits import package_limit
    from vdfmu.engine.run import Results, Simulator, simulate
    from vdfmu.study.analysis.arm_space import linearize
    from vdfmu.study.analysis.modes import Modes, natural_modes
    from vdfmu.study.connected import System, connect, load
    from vdfmu.study.environment.arm import ArmEnv, ArmVectorEnv
    from vdfmu.study.report.page import Animation, animate
    from vdfmu.study.runs import run
    from vdfmu.study.sweeps.sweep import Sweep, sweep
    from vdfmu.study.tuning.tune import tune
    from vdfmu.study.view.live import LiveView
    from vdfmu.study.view.robot import RobotView
    from vdfmu.system.package.write import write_ssp
    from vdfmu.system.scenario import Scenario, load_scenario, scenario_names

_NAMES = {
    "vdfmu.study.analysis.modes": ("Modes", "natural_modes"),
    "vdfmu.study.analysis.arm_space": ("linearize",),
    "vdfmu.study.runs": ("run",),
    "vdfmu.arm.dynamics": (
        "forward_dynamics", "forward_kinematics", "gravity_torque", "inverse_dynamics", "jacobian", "mass_matrix",
    ),
    "vdfmu.engine.run": ("Results", "Simulator", "simulate"),
    "vdfmu.engine.container": ("write_container",),
    "vdfmu.engine.federation": ("federate",),
    "vdfmu.base.state_space": ("StateSpace",),
    "vdfmu.engine.package": ("load_ssp",),
    "vdfmu.engine.package.limits": ("package_limit",),
    "vdfmu.base.errors": ("VdfmuError",),
    "vdfmu.arm.fmus": ("build", "build_fmus"),
    "vdfmu.study.connected": ("System", "connect", "load"),
    "vdfmu.arm.robot": ("Robot", "load_robot", "robot_names"),
    "vdfmu.arm.motion.read": ("load_motion",),
    "vdfmu.study.report.page": ("Animation", "animate"),
    "vdfmu.arm.imports": ("robot_from_mjcf", "robot_from_urdf"),
    "vdfmu.system.scenario": ("Scenario", "load_scenario", "scenario_names"),
    "vdfmu.system.package.write": ("write_ssp",),
    "vdfmu.study.sweeps.sweep": ("Sweep", "sweep"),
    "vdfmu.study.tuning.tune": ("tune",),
    "vdfmu.study.environment.arm": ("ArmEnv", "ArmVectorEnv"),
    "vdfmu.study.view.live": ("LiveView",),
    "vdfmu.study.view.robot": ("RobotView",),
}  # fmt: skip
_WHERE = {name: module for module, names in _NAMES.items() for name in names}

__all__ = [
    "Animation", "ArmEnv", "ArmVectorEnv", "LiveView", "Modes", "Results", "Robot", "RobotView", "Scenario",
    "Simulator", "StateSpace", "Sweep", "System", "VdfmuError", "__version__", "animate", "build", "build_fmus",
    "connect", "federate", "forward_dynamics", "forward_kinematics", "gravity_torque", "inverse_dynamics", "jacobian",
    "linearize", "load", "load_motion", "load_robot", "load_scenario", "load_ssp", "mass_matrix", "natural_modes",
    "package_limit", "robot_from_mjcf", "robot_from_urdf", "robot_names", "run", "scenario_names", "simulate", "sweep",
    "tune", "write_container", "write_ssp",
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
