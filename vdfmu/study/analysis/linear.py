"""Parts left out of the linear model of an arm, and how its torques depend on its states through feedback."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from typing import Any

import numpy as np
import numpy.typing as npt

from vdfmu.arm.drive.options import OPTIONS, dry_friction
from vdfmu.arm.robot.parameters import PARAMETERS
from vdfmu.base.arrays import Floats
from vdfmu.base.errors import UsageError
from vdfmu.compiler.unit.evaluate import Evaluation
from vdfmu.system.reference.wired import WiredUnits


def without_dry_friction(unit: Evaluation) -> None:
    """Set parameters of Coulomb and Stribeck friction, and of the mesh's, to 0 or the smallest that they may be."""
    for name in dry_friction(unit.interface.groups):
        unit.group(name)[:] = PARAMETERS[name].smallest


def least_dry_friction(values: Mapping[str, Any]) -> dict[str, float]:
    """Return the parameters of :func:`without_dry_friction` by their full names, of those of a unit."""
    groups = {name: name.partition("[")[0] for name in values}
    dry = dry_friction({*groups.values()})
    return {name: PARAMETERS[group].smallest or 0.0 for name, group in groups.items() if group in dry}


def fast_states(states: Iterable[str], dry: bool) -> npt.NDArray[np.intp]:
    """Return indices of the plant's states except temperatures, which take minutes, and bristles unless `dry`."""
    still = {
        option.state.name
        for option in OPTIONS.values()
        if option.state and (option.state.slow or (option.replaces_dry_friction and not dry))
    }
    return np.array([i for i, name in enumerate(states) if name.split("[")[0] not in still], dtype=np.intp)


def feedback(system: WiredUnits, plant: str, inputs: Sequence[str], t: float) -> Floats:
    """Return how inputs of a unit depend on its states through all other units: K (m, n), ``u = K x``.

    Differences around the states that the solver's part of the memory holds; exact to rounding for units that are
    linear in what they measure. UsageError if another unit that the system evaluates has states.
    """
    others = [name for name in system.units if name != plant]
    moving = [name for name in others if system.units[name].x.size or system.units[name].interface.is_sampled]
    if moving:
        raise UsageError(
            f"{', '.join(moving)}: expected feedback without states, to linearise the loop at each time by itself."
        )
    run, unit = system.python(system.evaluate), system.units[plant]
    x = system.memory[system.solver_x]
    K = np.empty((sum(unit.argument(name).size for name in inputs), x.size))
    for j, center in enumerate(x):
        step = 1e-6 * (1.0 + abs(center))  # SI units: rounding and curvature are some 1e-9 of what matters
        ends: list[Floats] = []
        for sign in (1.0, -1.0):
            system.memory[system.solver_x[j]] = center + sign * step
            run(t)
            ends.append(np.concatenate([unit.argument(name) for name in inputs]))
        system.memory[system.solver_x[j]] = center
        K[:, j] = (ends[0] - ends[1]) / (2.0 * step)
    run(t)
    return K
