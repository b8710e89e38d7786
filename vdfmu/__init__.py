"""Robot arms with elastic joints by virtual decomposition, as FMUs with a scipy reference.

Python API
----------
``build``, ``connect``, ``load``
    One FMU of a unit; a system as an object, of FMUs and connections, or of a package, an FMU or a scenario.
``load_robot``, ``load_scenario``, ``load_motion``
    A robot, scenario or motion of a file, shipped ones by name.
``vdfmu.motion``, ``vdfmu.unit``, ``vdfmu.drive``, ``vdfmu.plugin``
    Functions that make motions, and what own units, drives and plugins are made of.
``robot_from_urdf``, ``robot_from_mjcf``, ``export_robot``
    An arm of a file of another tool, and a robot as such a file.
``inverse_dynamics``, ``forward_dynamics``, ``gravity_torque``, ``mass_matrix``, ``jacobian``, ``forward_kinematics``
    Rigid links, link-side torques, one state or a batch.
``linearize``, ``natural_modes``
    An arm at rest as a linear system, and its natural frequencies, damping and mode shapes.
``build_fmus``, ``write_ssp``, ``write_container``
    The units as FMUs, their system as a package or for libcosim, and the system as one FMU.
``run``, ``animate``
    A whole scenario: co-simulation, references, comparison, files; the moving arm of a run.
``simulate``, ``load_ssp``, ``Simulator``
    The master for systems of FMUs of FMI 2.0 and 3.0: one run, or many.
``sweep``
    A scenario or package at many points in a durable table.
``write_robot_page``
    The page of a robot, with sliders of its joints, for a browser.
``package_limit``
    Limit of the unpacked size of a package.
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
    from vdfmu.arm.export import export_robot
    from vdfmu.arm.fmus import build, build_fmus
    from vdfmu.arm.imports import robot_from_mjcf, robot_from_urdf
    from vdfmu.arm.motion.read import load_motion
    from vdfmu.arm.robot import Robot, load_robot, robot_names
    from vdfmu.base.errors import VdfmuError
    from vdfmu.base.state_space import StateSpace
    from vdfmu.engine.container import write_container
    from vdfmu.engine.package.limits import package_limit
    from vdfmu.engine.package.read import load_ssp
    from vdfmu.engine.run import Results, Simulator, simulate
    from vdfmu.study.analysis.arm_space import linearize
    from vdfmu.study.analysis.modes import Modes, natural_modes
    from vdfmu.study.connected import System, connect, load
    from vdfmu.study.report.page import Animation, animate
    from vdfmu.study.report.robot_page import write_robot_page
    from vdfmu.study.runs import run
    from vdfmu.study.sweeps.sweep import Sweep, sweep
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
    "vdfmu.base.state_space": ("StateSpace",),
    "vdfmu.engine.package.read": ("load_ssp",),
    "vdfmu.engine.package.limits": ("package_limit",),
    "vdfmu.base.errors": ("VdfmuError",),
    "vdfmu.arm.fmus": ("build", "build_fmus"),
    "vdfmu.arm.export": ("export_robot",),
    "vdfmu.study.connected": ("System", "connect", "load"),
    "vdfmu.arm.robot": ("Robot", "load_robot", "robot_names"),
    "vdfmu.arm.motion.read": ("load_motion",),
    "vdfmu.study.report.page": ("Animation", "animate"),
    "vdfmu.study.report.robot_page": ("write_robot_page",),
    "vdfmu.arm.imports": ("robot_from_mjcf", "robot_from_urdf"),
    "vdfmu.system.scenario": ("Scenario", "load_scenario", "scenario_names"),
    "vdfmu.system.package.write": ("write_ssp",),
    "vdfmu.study.sweeps.sweep": ("Sweep", "sweep"),
}  # fmt: skip
_MODULES = ("drive", "motion", "plugin", "unit")
_WHERE = {name: module for module, names in _NAMES.items() for name in names}

__all__ = [
    "Animation", "Modes", "Results", "Robot", "Scenario", "Simulator",
    "StateSpace", "Sweep", "System", "VdfmuError", "__version__", "animate", "build", "build_fmus", "connect",
    "export_robot", "forward_dynamics", "forward_kinematics", "gravity_torque", "inverse_dynamics", "jacobian",
    "linearize", "load", "load_motion", "load_robot", "load_scenario", "load_ssp", "mass_matrix", "natural_modes",
    "package_limit", "robot_from_mjcf", "robot_from_urdf", "robot_names", "run", "scenario_names", "simulate", "sweep",
    "write_container", "write_robot_page", "write_ssp",
]  # fmt: skip


def __getattr__(name: str) -> Any:
    """Import a name of the API when it is first used, so that an FMU does not load the master or the plots."""
    if name in _MODULES:
        return import_module(f"{__name__}.{name}")
    if name not in _WHERE:
        raise AttributeError(f"module 'vdfmu' has no attribute {name!r}")
    value = globals()[name] = getattr(import_module(_WHERE[name]), name)
    return value


def __dir__() -> list[str]:
    """Names of the API."""
    return sorted([*__all__, *_MODULES])
