"""Margins of stability of the sampled loop of an arm: plant linearised along the motion, feedback held over a step.

At each time the plant is linearised on the desired motion, discretised exactly for inputs that are held over
a communication step, and closed by ``u[k] = K x[k - d]`` with d samples of delay. Joint i's loop is opened at its
motor, see `vdfmu.engine.linear.loops`.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from vdfmu.base.arrays import Floats
from vdfmu.base.errors import UsageError
from vdfmu.base.state_space import Linear
from vdfmu.compiler.unit.unit import state_space
from vdfmu.engine.linear.loops import Loop, Margins, of_positions
from vdfmu.study.analysis.arm_space import fast_states, feedback, without_dry_friction
from vdfmu.system.package.description import SystemDescription
from vdfmu.system.reference.wired import WiredUnits
from vdfmu.system.scenario import Scenario
from vdfmu.system.scenario.values import system_values

_DESIRED = {
    "q": "trajectory.q_d",
    "q_dot": "trajectory.q_d_dot",
    "kappa_dot": "feedforward.kappa_dot_d",
    "tau_s": "feedforward.tau_s",
}
"""States of the plant to the signals that hold them along the desired motion."""
_TIMES = 11


class ArmLoops:
    """The loop of a scenario with trajectory, feedforward, controller and plant along its desired motion.

    Coulomb and Stribeck friction of the plant are left out: near standstill its slope damps far more than all else, and
    in slow motion it takes damping away. Viscous friction stays.

    There is one of `loops` for each of `times`, by default eleven, evenly spread from the start to the end. A rate of
    up to `growth` [1/s] still counts as stable: a weakly damped mode of the arm may grow slowly at some places of a
    motion that soon passes them. UsageError if the system has other units, or feedback with states.
    """

    def __init__(
        self,
        scenario: Scenario,
        settings: Mapping[str, Any] | None = None,
        *,
        times: Sequence[float] | Floats | None = None,
        growth: float = 0.0,
    ) -> None:
        system = self._system = WiredUnits(SystemDescription(scenario, system_values(scenario, settings)))
        units, run = system.units, system.python(system.evaluate)
        wanted = [tuple(signal.split(".")) for signal in ("plant.tau", *_DESIRED.values())]
        lacking = [f"{u}.{g}" for u, g in wanted if u not in units or g not in units[u].interface.groups]
        if lacking:
            raise UsageError(
                f"margins: expected a system with trajectory, feedforward and plant; there is no {', '.join(lacking)}."
            )
        system.start()
        system.memory[system.solver_x] = system.memory[system.x]
        plant = units["plant"]
        without_dry_friction(plant)
        table = plant.interface
        self._fast = fast_states((v.name for v in table.variables[table.states]), dry=False)
        self._x: list[Floats] = []
        self.loops: list[Loop] = []
        for t in np.linspace(0.0, scenario.stop, _TIMES) if times is None else times:
            for _ in range(2):  # the feedforward may see the plant's states
                run(t)
                desired = np.concatenate([units[u].group(g) for u, g in wanted[1:]])
                system.memory[system.solver_x[: desired.size]] = desired  # those of options stay at their start
            run(t)
            self._x.append(system.memory[system.solver_x])
            found = of_positions(state_space(plant, ("tau",)))
            moving = Linear(found.A[np.ix_(self._fast, self._fast)], found.B[self._fast])
            self.loops.append(Loop(float(t), moving, self._feedback(t), scenario.step, growth))

    def _feedback(self, t: float) -> Floats:
        return feedback(self._system, "plant", ("tau",), t)[:, self._fast]

    def margins(self, values: Mapping[str, float] | None = None, delay: int = 1) -> Margins:
        """Smallest margins of each joint over all times, with other `values`, ``component.variable``, but of the plant.

        The feedback comes `delay` samples late: 0 with an ordered algorithm, 1 with most importers.
        """
        system = self._system
        for name, value in (values or {}).items():
            component, _, variable = name.partition(".")
            unit = system.units[component]
            unit.memory[unit.interface.reference[variable]] = value
        each: list[Margins] = []
        for loop, x in zip(self.loops, self._x, strict=True):
            system.memory[system.solver_x] = x
            K = loop.K if values is None else self._feedback(loop.t)
            each.append(loop.margins(K, delay))
        modulus, gain, phase, left = np.min([m[:4] for m in each], axis=0)
        return Margins(modulus, gain, phase, left, max(m.radius for m in each))
