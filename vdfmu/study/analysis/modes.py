"""Natural frequencies, damping and shapes of the modes of an arm at rest, with motors free or held."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from vdfmu.arm.robot import Robot, robot_argument
from vdfmu.base.arrays import Floats
from vdfmu.base.errors import UsageError
from vdfmu.base.option import checks_types
from vdfmu.base.state_space import StateSpace
from vdfmu.engine.linear.loops import Complex
from vdfmu.study.analysis.arm_space import fast_states, linearize
from vdfmu.system.package.description import SystemDescription
from vdfmu.system.reference.wired import WiredUnits
from vdfmu.system.scenario import Scenario
from vdfmu.system.scenario.values import system_values

MOTORS = ("free", "held")
_STILL = 1e-6
"""Eigenvalues slower than this, relative to the fastest, do not oscillate: it is the rounding of a double
eigenvalue."""


@dataclass(frozen=True)
class Modes:
    """Modes of an arm at a pose: m oscillating ones, from low to high.

    Attributes
    ----------
    frequency : (m,) [Hz]
        ``|s| / 2 pi`` of an eigenvalue s.
    damping : (m,)
        Damping ratio ``-Re s / |s|``; negative for a mode that grows.
    links, rotors : (m, n) complex
        Displacements of links, and of rotors divided by ell [rad or m]; the largest of each mode is 1.
    share : (m, n)
        Share of each joint in the springs' largest energy.
    rates : (k,) [1/s]
        Real eigenvalues, which do not oscillate.
    """

    frequency: Floats
    damping: Floats
    links: Complex
    rotors: Complex
    share: Floats
    rates: Floats

    @property
    def joint(self) -> npt.NDArray[np.intp]:
        """Index of the joint whose spring has most of the energy, (m,)."""
        return self.share.argmax(axis=1)


def middle_pose(robot: Robot) -> list[float]:
    """Return 0 for each joint [rad or m], or the middle between end stops that exclude 0."""
    stops = zip(robot.q_min, robot.q_max, strict=True) if robot.limits else [(0.0, 0.0)] * robot.n
    return [0.0 if low <= 0.0 <= high else float(low + high) / 2.0 for low, high in stops]


@checks_types
def natural_modes(robot: Robot, q: npt.ArrayLike, *, motors: str = "free", dry: bool = False) -> Modes:
    """Modes of the plant of an arm, linearised at rest at a pose, where motors and springs hold it.

    Parameters
    ----------
    robot : Robot
    q : (n,) [rad or m]
        Positions of the joints.
    motors : str
        ``free``: the motors keep their torque and the rotors move. ``held``: brakes lock the rotors.
    dry : bool
        Whether to keep Coulomb and Stribeck friction, with the slope of their regularisation (54) at rest. With it most
        modes of free rotors creep.

    Returns
    -------
    Modes

    Raises
    ------
    UsageError
        See :func:`vdfmu.linearize`; for other `motors`.
    """
    if motors not in MOTORS:
        raise UsageError(f"motors: expected {' or '.join(MOTORS)}, got {motors!r}.")
    return modes_of(linearize(robot_argument(robot), q, dry=dry), motors, dry)


def modes_of(system: StateSpace, motors: str, dry: bool) -> Modes:
    """Return the modes of an arm that :func:`vdfmu.linearize` made linear."""
    keep = fast_states(system.states, dry)
    groups = [system.states[i].split("[")[0] for i in keep]
    n, m = groups.count("q"), len(groups)
    A, B = system.A[np.ix_(keep, keep)], system.B[keep, :n]
    currents = np.flatnonzero(np.array(groups) == "i_m")
    if currents.size:  # they turn the rotors
        B = A[:, currents]
    links, speeds, rotors, springs = np.split(np.arange(4 * n), 4)
    stiffness = -np.diag(A[np.ix_(springs, speeds)])  # tau_s_dot = K (kappa_dot (1 - theta_err') - q_dot)
    states = np.eye(m)  # from states of the motion
    if motors == "held":
        brakes = -np.linalg.solve(B[rotors], A[rotors])
        moving = np.delete(np.arange(m), np.concatenate([rotors, springs, currents]))
        states = states[:, moving]
        states[springs, links] = -stiffness
        A = (A @ states + B @ (brakes @ states))[moving]
    s: Any
    s, vectors = np.linalg.eig(A)
    turning = np.abs(s.imag) > _STILL * np.abs(s).max()
    keep = np.flatnonzero(turning & (s.imag > 0.0))
    keep = keep[np.argsort(np.abs(s[keep]))]
    pole, x = s[keep], (states @ vectors[:, keep]).T
    shapes: Any = np.hstack([x[:, links], x[:, rotors] / pole[:, None]])
    largest = np.abs(shapes).argmax(axis=1)[:, None]
    shapes = shapes / np.take_along_axis(shapes, largest, axis=1)
    energy = np.abs(x[:, springs]) ** 2 / stiffness
    return Modes(
        np.abs(pole) / (2.0 * np.pi),
        -pole.real / np.abs(pole),
        shapes[:, :n],
        shapes[:, n:],
        energy / energy.sum(axis=1, keepdims=True),
        np.sort(s[~turning].real),
    )


def desired_motion(scenario: Scenario, outputs: Sequence[str], points: int) -> tuple[Floats, Floats]:
    """Return evenly spaced times (m,) [s] and outputs of ``trajectory``, (k, m, n). UsageError if one is missing."""
    system = WiredUnits(SystemDescription(scenario, system_values(scenario)))
    trajectory = system.units.get("trajectory")
    if lacking := [name for name in outputs if trajectory is None or name not in trajectory.interface.groups]:
        raise UsageError(f"expected a system with a component trajectory that has an output {', '.join(lacking)}.")
    assert trajectory is not None
    system.start()
    run = system.python(system.evaluate)
    times, rows = np.linspace(0.0, scenario.stop, points), []
    for t in times:
        run(t)
        rows.append([trajectory.group(name).copy() for name in outputs])
    return times, np.array(rows).transpose(1, 0, 2)
