"""Environments of gymnasium: an arm in the master, and many arms in lanes."""

from __future__ import annotations

from collections.abc import Mapping
from contextlib import ExitStack
from typing import Any

import numpy as np

from vdfmu.base.arrays import Floats
from vdfmu.base.errors import CosimError, UsageError
from vdfmu.engine.run import Simulator
from vdfmu.study.analysis.system import packaged
from vdfmu.study.batch.make import make_program
from vdfmu.study.batch.stepped import SteppedLanes
from vdfmu.study.environment.task import TrackingTask
from vdfmu.system.package.description import SystemDescription

try:
    import gymnasium
    from gymnasium.vector import AutoresetMode, VectorEnv
    from gymnasium.vector.utils import batch_space
except ImportError:
    raise UsageError("environments need gymnasium: pip install 'vdfmu[learn]'.") from None

_NOT_BEGUN = "step: expected reset() before the first step."
_FAILED = "the step was not solved; ArmEnv with the same parameters and actions says why"


def _spaces(task: TrackingTask) -> tuple[Any, Any]:
    """Return the spaces of actions and of what is seen."""
    return (
        gymnasium.spaces.Box(-task.limit, task.limit, dtype=np.float64),
        gymnasium.spaces.Box(-task.high, task.high, dtype=np.float64),
    )


class ArmEnv(gymnasium.Env[Floats, Floats]):
    """An arm under an agent's torques, which it is to move as the scenario says; over :class:`vdfmu.Simulator`.

    Parameters
    ----------
    scenario, **options
        See :class:`vdfmu.study.environment.task.TrackingTask`, which is `task`.

    Attributes
    ----------
    task : TrackingTask
        `signals` names the numbers that are seen, `units` their units of measurement; `inputs` the numbers of an
        action, `action_units` theirs.
    """

    metadata: dict[str, Any] = {"render_modes": []}

    def __init__(self, scenario: Any = "planar_tracking", **options: Any) -> None:
        self.task = TrackingTask(scenario, **options)
        self.action_space, self.observation_space = _spaces(self.task)
        scenario = self.task.scenario
        self._done = -1
        options = {"inputs": scenario.inputs, "input_hold": scenario.input_hold, "isolate": False}
        with ExitStack() as stack:
            package, _ = stack.enter_context(packaged(scenario))
            self._simulator = stack.enter_context(Simulator(package, **scenario.coupling, **options))
            self._held = stack.pop_all()

    def reset(
        self, *, seed: int | None = None, options: Mapping[str, Any] | None = None
    ) -> tuple[Floats, dict[str, Any]]:
        """Begin an episode; `options` may have ``parameters``, values by ``component.variable``."""
        super().reset(seed=seed)
        scenario = self.task.scenario
        given = self.task.drawn(self.np_random) | dict((options or {}).get("parameters", {}))
        self._done = 0
        self._simulator.reset(start=0.0, stop=scenario.stop, step=scenario.step, parameters=given)
        self._numbers = self._read()
        return self.task.clipped(self._numbers), {"parameters": given}

    def step(self, action: Floats) -> tuple[Floats, float, bool, bool, dict[str, Any]]:
        """Hold an action for `hold` communication steps."""
        if self._done < 0:
            raise UsageError(_NOT_BEGUN)
        action, info = self.task.limited(action), dict[str, Any]()
        self._done += 1
        try:
            self._simulator.set(self.task.action, action)
            self._simulator.step(self.task.hold)
            self._numbers = self._read()
        except CosimError as error:
            info["error"] = str(error)
        seen, reward, ended = self.task.outcome(self._numbers, action, self._done, not info)
        return seen, float(reward), bool(ended), not ended and self._done == self.task.length, info

    def _read(self) -> Floats:
        return np.array([self._simulator.get(name) for name in self.task.signals])

    def close(self) -> None:
        """Free the units."""
        self._held.close()


class ArmVectorEnv(VectorEnv[Floats, Floats, Floats]):
    """Many arms as :class:`ArmEnv`, stepped side by side by the batch engine; one that ended is reset by the next step.

    Parameters
    ----------
    num_envs : int
    scenario, **options
        See :class:`vdfmu.study.environment.task.TrackingTask`.

    Raises
    ------
    UsageError
        For systems that the batch engine cannot run, such as those with sampled units.
    """

    metadata: dict[str, Any] = {"render_modes": [], "autoreset_mode": AutoresetMode.NEXT_STEP}

    def __init__(self, num_envs: int = 8, scenario: Any = "planar_tracking", **options: Any) -> None:
        if num_envs < 1 or num_envs % 1:
            raise UsageError(f"num_envs: expected a whole number of at least 1, got {num_envs}.")
        self.num_envs, self.task, self._given = num_envs, TrackingTask(scenario, **options), None
        self.single_action_space, self.single_observation_space = _spaces(self.task)
        self.action_space = batch_space(self.single_action_space, num_envs)
        self.observation_space = batch_space(self.single_observation_space, num_envs)
        task = self.task
        program = make_program(SystemDescription(task.scenario), [*task.vary, *task.seeds])
        self._lanes = SteppedLanes(program, num_envs, task.inputs, task.signals)
        self._done, self._over = np.zeros(num_envs, np.intp), np.zeros(num_envs, np.bool_)

    def reset(
        self, *, seed: int | None = None, options: Mapping[str, Any] | None = None
    ) -> tuple[Floats, dict[str, Any]]:
        """Begin all episodes; `options` may have ``parameters`` of all of them."""
        super().reset(seed=seed)
        self._given = given = dict((options or {}).get("parameters", {}))
        self._begin(range(self.num_envs), given)
        return self.task.clipped(self._lanes.read()), {}

    def _begin(self, chosen: Any, given: dict[str, Any]) -> None:
        chosen = [int(i) for i in chosen]
        self._lanes.reset({i: self.task.drawn(self.np_random) | given for i in chosen})
        self._done[chosen], self._over[chosen] = 0, False
        if not self._lanes.good[chosen].all():
            raise CosimError("lanes", "initialization", 0.0, "parameters are refused; ArmEnv says why")

    def step(self, actions: Floats) -> tuple[Floats, Floats, Any, Any, dict[str, Any]]:
        """Hold an action of each arm for `hold` communication steps."""
        if self._given is None:
            raise UsageError(_NOT_BEGUN)
        actions, begun, info = self.task.limited(actions, (self.num_envs,)), self._over.copy(), dict[str, Any]()
        self._lanes.step(actions, self.task.hold)
        self._done += 1
        seen, rewards, ended = self.task.outcome(self._lanes.read(), actions, self._done, self._lanes.good)
        late = ~ended & (self._done == self.task.length)
        for i in np.flatnonzero(~self._lanes.good & ~begun):
            info = self._add_info(info, {"error": _FAILED}, int(i))
        self._over = ended | late
        if begun.any():
            self._begin(np.flatnonzero(begun), self._given)
            seen[begun] = self.task.clipped(self._lanes.read())[begun]
            rewards[begun], ended[begun], late[begun] = 0.0, False, False
        return seen, rewards, ended, late, info


gymnasium.register("vdfmu/Arm-v0", entry_point=ArmEnv, vector_entry_point=ArmVectorEnv)
