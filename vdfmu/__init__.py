"""Robot arms with elastic joints by virtual decomposition, as FMUs with a scipy reference.

Python API
----------
``build``, ``connect``, ``load``
    Build the FMU of a unit; make a system from FMUs and connections, or load it from a package, an FMU or a scenario.
``System``, ``Results``
    A system with methods to run, check, judge, vary and write it; the signals and the summary of a run.
``run``, ``judge``, ``sweep``, ``animate``
    Run a whole scenario with references, verdict and page; estimate the coupling error of a package; tabulate many
    runs; show the arm of a run in a notebook.
``load_robot``, ``load_motion``
    A robot or a motion of a file, shipped robots by name.
``linearize``, ``natural_modes``
    Linearise an arm at rest or a system at a given time; compute natural frequencies, damping and mode shapes.
``vdfmu.dynamics``, ``vdfmu.motion``, ``vdfmu.unit``, ``vdfmu.drive``, ``vdfmu.plugin``
    Rigid-body dynamics, functions that make motions, and the building blocks of your own units, drives and plugins.
``VdfmuError``
    Base of all errors.
"""

from importlib import import_module
from typing import TYPE_CHECKING, Any

from vdfmu.base.version import __version__ as __version__

if TYPE_CHECKING:  # for checkers and editors, which do not read the table
    from vdfmu import drive as drive
    from vdfmu import dynamics as dynamics
    from vdfmu import motion as motion
    from vdfmu import plugin as plugin
    from vdfmu import unit as unit
    from vdfmu.arm.fmus import build as build
    from vdfmu.arm.motion.read import load_motion as load_motion
    from vdfmu.arm.robot import load_robot as load_robot
    from vdfmu.base.errors import VdfmuError as VdfmuError
    from vdfmu.engine.run import Results as Results
    from vdfmu.study.analysis.arm_space import linearize as linearize
    from vdfmu.study.analysis.modes import natural_modes as natural_modes
    from vdfmu.study.connected import System as System
    from vdfmu.study.connected import connect as connect
    from vdfmu.study.connected import load as load
    from vdfmu.study.judgement import judge as judge
    from vdfmu.study.report.page import animate as animate
    from vdfmu.study.runs import run as run
    from vdfmu.study.sweeps.sweep import sweep as sweep

_PLACES = {
    "Results": "vdfmu.engine.run",
    "System": "vdfmu.study.connected",
    "VdfmuError": "vdfmu.base.errors",
    "animate": "vdfmu.study.report.page",
    "build": "vdfmu.arm.fmus",
    "connect": "vdfmu.study.connected",
    "drive": "",
    "dynamics": "",
    "judge": "vdfmu.study.judgement",
    "linearize": "vdfmu.study.analysis.arm_space",
    "load": "vdfmu.study.connected",
    "load_motion": "vdfmu.arm.motion.read",
    "load_robot": "vdfmu.arm.robot",
    "motion": "",
    "natural_modes": "vdfmu.study.analysis.modes",
    "plugin": "",
    "run": "vdfmu.study.runs",
    "sweep": "vdfmu.study.sweeps.sweep",
    "unit": "",
}
"""Names of the API and their modules, imported at first use so that an FMU does not load the master; "" for modules."""
_MOVED = {
    **dict.fromkeys(("ArmEnv", "ArmVectorEnv", "Environment"), "extras.learn"),
    **dict.fromkeys(("export_robot", "robot_from_mjcf", "robot_from_urdf"), "extras.robots"),
    **dict.fromkeys(("Simulator", "simulate"), "engine.run"),
    **dict.fromkeys(("Scenario", "load_scenario", "scenario_names"), "system.scenario"),
    **dict.fromkeys(("Robot", "robot_names"), "arm.robot"),
    **dict.fromkeys(
        ("forward_dynamics", "forward_kinematics", "gravity_torque", "inverse_dynamics", "jacobian", "mass_matrix"),
        "dynamics",
    ),
    "Animation": "study.report.page",
    "Modes": "study.analysis.modes",
    "StateSpace": "base.state_space",
    "Sweep": "study.sweeps.sweep",
    "build_fmus": "arm.fmus",
    "load_ssp": "engine.package.read",
    "package_limit": "engine.package.archive",
    "tune": "extras.tune",
    "write_container": "extras.container",
    "write_robot_page": "extras.robots",
    "write_ssp": "system.package.write",
}
"""Names that this package had before, and their modules now."""
__all__ = [*_PLACES]  # pyright: ignore[reportUnsupportedDunderAll]


def __getattr__(name: str) -> Any:
    """Import a name of the API."""
    if name in _MOVED:
        raise AttributeError(f"vdfmu.{name} moved. Write: from vdfmu.{_MOVED[name]} import {name}")
    if name not in _PLACES:
        raise AttributeError(f"module 'vdfmu' has no attribute {name!r}")
    place = _PLACES[name]
    value = globals()[name] = getattr(import_module(place), name) if place else import_module(f"vdfmu.{name}")
    return value


def __dir__() -> list[str]:
    """Names of the API."""
    return sorted(__all__)
