"""Linearises an arm at rest at a pose, or a system at a time of its run, with names and units."""

from __future__ import annotations

import os
from collections.abc import Generator, Iterable, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any, Unpack

import numpy as np
import numpy.typing as npt

from vdfmu.arm.drive.limits import motor_torque
from vdfmu.arm.drive.options import OPTIONS, dry_friction
from vdfmu.arm.equations.flexible_joint import state_names
from vdfmu.arm.robot import Robot, robot_argument
from vdfmu.arm.robot.parameters import PARAMETERS
from vdfmu.arm.units.plant import Plant
from vdfmu.base.errors import UsageError
from vdfmu.base.files import temporary_folder
from vdfmu.base.option import checks_types
from vdfmu.base.state_space import StateSpace
from vdfmu.compiler.unit.evaluate import Evaluation, evaluation, state_space
from vdfmu.compiler.unit.interface import interface_of
from vdfmu.engine.linear.linearise import LinearSystem, linear_system
from vdfmu.engine.options import CouplingOptions
from vdfmu.study.run.prepare import scenario_of
from vdfmu.system.package.write import cached_fmus, write_ssp
from vdfmu.system.scenario import Scenario
from vdfmu.system.scenario.values import system_values


def without_dry_friction(unit: Evaluation) -> None:
    """Set the parameters of Coulomb, Stribeck and mesh friction to their smallest allowed values, mostly 0."""
    for name in dry_friction(unit.interface.groups):
        unit.group(name)[:] = PARAMETERS[name].smallest


def least_dry_friction(values: Mapping[str, Any]) -> dict[str, float]:
    """Return the full names of the parameters of :func:`without_dry_friction` among a unit's values."""
    groups = {name: name.partition("[")[0] for name in values}
    dry = dry_friction({*groups.values()})
    return {name: PARAMETERS[group].smallest or 0.0 for name, group in groups.items() if group in dry}


def fast_states(states: Iterable[str], dry: bool) -> npt.NDArray[np.intp]:
    """Return indices of the plant's states without the slow temperatures, and without bristles unless `dry`."""
    still = {
        option.state.name
        for option in OPTIONS.values()
        if option.state and (option.state.slow or (option.replaces_dry_friction and not dry))
    }
    return np.array([i for i, name in enumerate(states) if name.split("[")[0] not in still], dtype=np.intp)


_INPUTS = ("tau", "F_e")
_OUTPUTS = ("kappa", "p_O")
"""Outputs in addition to the states."""


@checks_types
def linearize(
    system: Robot | Scenario | str | os.PathLike[str],
    at: npt.ArrayLike,
    *,
    dry: bool = False,
    sampled: bool = False,
    opened: Sequence[str] = (),
    algorithm: str | None = None,
    parameters: Mapping[str, Any] | None = None,
    backend: str | None = None,
) -> StateSpace:
    """Linearise the plant of an arm at rest at a pose, or a complete system at a time of its run.

    The linearisation is exact. Motors and springs hold an arm against gravity. Its states are q, q_dot, kappa_dot
    and tau_s; inputs are the motor torques tau and the wrench F_e of the arm on its surroundings; outputs are the
    states, the rotors' positions kappa and the end effector's p_O, all as in the unit Plant.

    A system is linearised with the directional derivatives of its FMUs and closed connections. All inputs of the FMUs
    are inputs of the linear system; for a connected one this is a disturbance added to the signal. See
    :mod:`vdfmu.engine.linear.system`.

    Parameters
    ----------
    system : Robot, Scenario, str or path
        An arm; or a scenario, given by name or file, or an ``.ssp``.
    at : (n,) [rad or m], or float [s]
        Positions of the joints, or the time.
    dry : bool
        For an arm: whether to keep Coulomb and Stribeck friction, with the slope of their regularisation (54) at rest.
        Viscous friction is always kept.
    sampled : bool
        For a system: whether to linearise from one communication point to the next, with the master's delays, instead
        of in continuous time.
    opened : sequence of str
        For a system: inputs whose connections are cut; the signals that fed them become the last outputs.
    algorithm : str
        For a system: master algorithm, by default its own.
    parameters : mapping of str to value
        For a system: values of parameters, ``{"controller.K_p[1]": 2000}``.
    backend : "python" or "native"
        For a scenario: kind of FMU, by default "native" if there is a C compiler.

    Returns
    -------
    StateSpace
        With the names and units of its states, inputs and outputs.

    Raises
    ------
    UsageError
        For a pose of anything but a robot; for a wrong number of positions or positions that are not finite; for an arm
        with limits that is beyond an end stop or too heavy for its motors; for FMUs without derivatives.
    CosimError
        If the run to the time fails.

    Examples
    --------
    >>> system = vdfmu.linearize(vdfmu.load_robot("planar_2dof"), at=(0.3, -0.5))
    >>> system.A.shape, system.inputs[:2], system.states[4:6], system.state_units[4:6]
    ((8, 8), ('tau[1]', 'tau[2]'), ('kappa_dot[1]', 'kappa_dot[2]'), ('rad/s', 'rad/s'))
    """
    try:
        place = np.asarray(at, dtype=float)
    except (TypeError, ValueError):
        raise UsageError(f"linearize: at: expected positions of the joints, or a time in s, got {at!r:.60}.") from None
    if not isinstance(system, Robot) and place.ndim == 0:
        if dry:
            raise UsageError("linearize: dry: applies only to an arm; in a system set its friction parameters instead.")
        linear = linearized(system, float(place), algorithm=algorithm, parameters=parameters, backend=backend)
        return linear.sampled(opened) if sampled else linear.continuous(opened)
    options = dict(sampled=sampled, opened=opened, algorithm=algorithm, parameters=parameters, backend=backend)
    if names := [name for name, value in options.items() if value]:
        raise UsageError(f"linearize: {', '.join(names)}: only for systems at a time.")
    try:
        plant = _at_rest(robot_argument(system), at)
    except UsageError as error:
        if isinstance(system, Robot):
            raise
        raise UsageError(f"{error} For a scenario or a package give a time in s instead of positions.") from None
    if not dry:
        without_dry_friction(plant)
    return state_space(plant, _INPUTS, (*state_names(plant.interface.robot), *_OUTPUTS))


def _at_rest(robot: Robot, at: npt.ArrayLike) -> Evaluation:
    """Return the plant at rest at a pose, where motors and springs hold it."""
    q = np.asarray(at, dtype=float)
    if q.shape != (robot.n,) or not np.isfinite(q).all():
        raise UsageError(f"{robot.name}: expected {robot.n} finite positions of the joints, got {at!r}.")
    plant = evaluation(interface_of(Plant, robot))
    plant.group("q_0")[:] = q
    plant.start()
    tau = plant.group("tau")
    tau[:] = plant.group("tau_s") / robot.ell
    if robot.limits:
        limited = motor_torque(robot, tau, np.zeros(robot.n))
        problems = [
            f"joint {i + 1} at {q[i]:g}: expected {robot.q_min[i]:g} to {robot.q_max[i]:g}, between its end stops."
            for i in np.flatnonzero((q < robot.q_min) | (q > robot.q_max))
        ] + [
            f"joint {i + 1}: expected a motor torque of at most {abs(limited[i]):.4g} N.m, but it takes "
            f"{abs(tau[i]):.4g} N.m to hold the arm."
            for i in np.flatnonzero(np.abs(tau) > np.abs(limited))
        ]
        if problems:
            raise UsageError("\n".join(f"{robot.name}: {problem}" for problem in problems))
    plant.outputs()
    return plant


@contextmanager
def packaged(
    system: Scenario | str | os.PathLike[str],
    parameters: Mapping[str, Any] | None = None,
    backend: str | None = None,
    algorithm: str | None = None,
    **coupling: Unpack[CouplingOptions],
) -> Generator[tuple[Path, dict[str, Any]]]:
    """Yield the package of a system, and its options for :class:`vdfmu.engine.run.Simulator`.

    The system is a scenario, its name or file, or an ``.ssp``. `parameters` are set in it, `backend` is the kind of a
    scenario's FMUs, and `algorithm` and `coupling` replace its options.
    """
    changes = {name: value for name, value in coupling.items() if value is not None}
    if not isinstance(system, Scenario) and Path(system).suffix.lower() == ".ssp":
        yield Path(system), {**changes, "parameters": parameters, "algorithm": algorithm}
        return
    system = scenario_of(system, names=parameters or ())
    values = system_values(system, parameters)
    with temporary_folder("vdfmu_") as folder:
        built = cached_fmus(system, folder, backend)
        defaults = (
            system.coupling if algorithm in (None, system.algorithm) else {**system.options, "algorithm": algorithm}
        )
        options = {**defaults, **changes, "inputs": system.inputs, "input_hold": system.input_hold}
        yield write_ssp(system, built, Path(folder) / "system.ssp", values, mixed=True), options


def linearized(
    system: Scenario | str | os.PathLike[str],
    at: float | None = None,
    *,
    algorithm: str | None = None,
    parameters: Mapping[str, Any] | None = None,
    backend: str | None = None,
) -> LinearSystem:
    """Linearise components, see :func:`packaged`, at a time of the run, by default at its start."""
    with packaged(system, parameters, backend, algorithm) as (package, options):
        return linear_system(package, at, **options)
