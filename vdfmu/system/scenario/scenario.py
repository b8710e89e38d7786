"""A scenario: a robot, the motion asked of it, its controller and how the run is stepped."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from vdfmu.arm.robot import Robot
from vdfmu.arm.robot.parameters import PARAMETERS
from vdfmu.base.arrays import Floats
from vdfmu.base.errors import UsageError
from vdfmu.engine.options import CouplingOptions, SimulatorOptions
from vdfmu.system.scenario.resolved import ROBOT_WAY_OUT, ResolvedSystem, resolve
from vdfmu.system.scenario.system_file import SystemFile

_TINY = 1e-12
"""Share of the inertia that an unknown payload keeps: one of zeros would be another structure."""
FACTOR_FIELDS = tuple(row.name for row in PARAMETERS.values() if row.fold != "always")
"""Fields of the robot that a plant factor may scale."""


@dataclass(frozen=True, eq=False)
class Scenario:
    """All that one run needs.

    Parameters
    ----------
    name, description : str
    system : SystemFile
        The components and their connections.
    robot : Robot or None
        The nominal robot, which the feedforward knows, with the friction arrangement of the scenario if its file
        names one; None where no component takes it.
    stop, step : float [s]
        End of the run, and communication step.
    master : str
        Name of an algorithm of `vdfmu.engine.algorithms`.
    adaptive : float or None
        Largest relative error of a coupled signal in a step; None for steps of the given length.
    tolerance : float
        Relative tolerance of the plant's solver.
    plant_factors : mapping of str to float or (n,) array
        Field of the robot to its factor: plant = nominal * factor.
    sections : mapping of str to mapping
        Component to the values that the file sets: a group of variables, or one of them, ``K_p`` or ``K_p[1]``, to its
        value, or values. :func:`vdfmu.system.scenario.values.system_values` reads them.
    paper : mapping
        Values of the paper: `source` and lists that start at joint 1. Empty if it reports nothing.
    payload_known : bool
        Whether other components than the plant know of the robot's payload.
    inputs : path, sequence of paths or mapping, optional
        Signals for inputs that nothing is connected to; see :func:`vdfmu.engine.run.simulate`.
    input_hold : bool, optional
        Whether they hold until the next row.
    notes : tuple of str
        Notes of whoever made the scenario.
    file : str
        Its file, if it is not a shipped one.
    options : CouplingOptions
        Those of its runs that have no field here.
    """

    name: str
    description: str
    system: SystemFile
    robot: Robot | None
    stop: float
    step: float
    master: str
    adaptive: float | None
    tolerance: float
    plant_factors: Mapping[str, Floats | float]
    sections: Mapping[str, Mapping[str, Any]]
    paper: Mapping[str, Any]
    inputs: Any = None
    input_hold: bool = False
    payload_known: bool = True
    notes: tuple[str, ...] = ()
    file: str = field(default="", compare=False)
    options: CouplingOptions = field(default_factory=CouplingOptions)

    @property
    def coupling(self) -> SimulatorOptions:
        """How the master couples the components."""
        return {**self.options, "algorithm": self.master, "adaptive": self.adaptive}

    @property
    def resolved(self) -> ResolvedSystem:
        """The components of the system for the robot."""
        return resolve(self.system, self.robot)

    @property
    def arm(self) -> Robot:
        """The robot, for what cannot do without; UsageError if there is none."""
        if self.robot is None:
            raise UsageError(f"scenario {self.name} has no robot. {ROBOT_WAY_OUT}")
        return self.robot

    @property
    def plant_robot(self) -> Robot:
        """The robot that the plant simulates: the nominal one with the factors applied."""
        return apply_factors(self.arm, self.plant_factors)

    @property
    def known_robot(self) -> Robot:
        """The robot that the other components know: the nominal one, without a payload that is not known."""
        robot = self.arm
        if self.payload_known or not robot.payload:
            return robot
        return robot.with_parameters(payload_mass=0.0, payload_inertia=_TINY * robot.payload_inertia)


def apply_factors(robot: Robot, factors: Mapping[str, Floats | float]) -> Robot:
    """Return the robot with fields scaled; a factor of shape (n,) has one entry a joint."""
    scaled: dict[str, Floats] = {}
    for key, factor in factors.items():
        nominal = getattr(robot, key)
        per_joint = np.asarray(factor, dtype=float)
        scaled[key] = nominal * per_joint.reshape(per_joint.shape + (1,) * (nominal.ndim - per_joint.ndim))
    return robot.with_parameters(**scaled) if scaled else robot
