"""Gymnasium environments: any system, an arm, and many arms stepped side by side."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from contextlib import ExitStack
from typing import Any

import numpy as np

from vdfmu.base.arrays import Floats
from vdfmu.base.errors import CosimError, UsageError
from vdfmu.base.option import check_type, checks_types
from vdfmu.engine.run import Simulator
from vdfmu.extras.batch.programs import make_program
from vdfmu.extras.learn.lanes import SteppedLanes
from vdfmu.extras.learn.tasks import Task, TrackingTask, episode, opened
from vdfmu.study.analysis.arm_space import packaged
from vdfmu.study.run.prepare import scenario_of
from vdfmu.system.package.description import SystemDescription
from vdfmu.system.scenario import Scenario

try:
    import gymnasium
    from gymnasium.vector import AutoresetMode, VectorEnv
    from gymnasium.vector.utils import batch_space
except ImportError:
    raise UsageError("environments need gymnasium: pip install 'vdfmu[learn]'.") from None

_NOT_BEGUN = "step: expected reset() before the first step."
_FAILED = "the step could not be solved; ArmEnv with the same parameters and actions says why"


def _parameters(options: Mapping[str, Any] | None) -> dict[str, Any]:
    """Return the parameters from the options of a reset."""
    parameters = (options or {}).get("parameters")
    check_type("options: parameters", "Mapping[str, Any] | None", parameters)
    return dict(parameters or {})


def _spaces(task: Task) -> tuple[Any, Any]:
    """Return the spaces of actions and observations."""
    pairs = ((task.least, task.limit), (task.low, task.high))
    return tuple(gymnasium.spaces.Box(*pair, dtype=np.float64) for pair in pairs)  # pyright: ignore[reportReturnType]


class Environment(gymnasium.Env[Floats, Floats]):
    """A system of FMUs with an agent that sets some of its inputs.

    Parameters
    ----------
    system : System, Scenario, str or path
        A system of `vdfmu.connect` or `vdfmu.load`, or a package or scenario. In a scenario the connections to actions
        are cut, and components without an effect on actions and observations are omitted.
    actions : mapping of ``component.input`` to bounds
        Bounds are the largest absolute value, or a pair of lowest and highest.
    observations : mapping of ``component.output`` to bounds, or sequence of these outputs
        An observation beyond its bounds ends the episode.
    reward : callable
        ``reward(seen, action)``, of mappings of names to arrays.
    step, stop : float, optional [s]
        Communication step and length of an episode, by default the system's.
    hold : int, optional
        Number of communication steps for which an action is held.
    lost : float, optional
        Reward of an action after which the episode ends early, and of each action that would have followed.
    ended : callable, optional
        ``ended(seen)`` says whether the episode ends early.
    vary : mapping of parameter to (low, high), optional
        Parameters that are drawn uniformly at each reset.
    parameters : mapping of ``component.variable`` to value, optional
        Parameters and start values.

    Raises
    ------
    UsageError, SspError
        For unknown signals, impossible bounds, or systems that cannot be run.

    Attributes
    ----------
    task : Task
        `inputs` and `signals` name the elements of actions and observations, `action_units` and `units` their units.

    Examples
    --------
    >>> def reward(seen, action):
    ...     return -abs(seen["load.w"][0] - 1.0)
    >>> env = Environment(system, {"motor.u": 12.0}, {"load.w": 50.0}, reward)
    """

    metadata: dict[str, Any] = {"render_modes": []}

    @checks_types
    def __init__(
        self,
        system: Any,
        actions: Mapping[str, Any],
        observations: Mapping[str, Any] | Sequence[str],
        reward: Callable[[dict[str, Floats], dict[str, Floats]], Any],
        *,
        step: float | None = None,
        stop: float | None = None,
        hold: int = 1,
        lost: float = 0.0,
        ended: Callable[[dict[str, Floats]], Any] | None = None,
        vary: Mapping[str, tuple[float, float]] | None = None,
        parameters: Mapping[str, Any] | None = None,
    ) -> None:
        check_type("system", "System | Scenario | str | PathLike[str]", system)
        seen = observations if isinstance(observations, Mapping) else dict.fromkeys(observations)
        self._system = system  # a System has the folder of its FMUs
        with ExitStack() as stack:
            simulator = stack.enter_context(self._simulator_of(system, [*actions], [*seen], parameters, stack))
            checked = simulator.checked
            tables = {name: list(each.variables.values()) for name, each in checked.descriptions.items()}
            fed = {".".join(link.end).partition("[")[0] for link in checked.links}
            if taken := [name for name in actions if name.partition("[")[0] in fed]:
                raise UsageError(f"{taken[0]!r}: action must be a free input, but it is connected. Omit it.")
            grid = simulator.grid(None, stop, step)
            task = Task(
                tables,
                actions,
                seen,
                reward,
                hold=hold,
                lost=lost,
                ended=ended,
                vary=vary,
                length=episode(grid.end - grid.begin, grid.step, hold),
            )
            self._begin(task, simulator, {"start": grid.begin, "stop": grid.end, "step": grid.step}, stack)

    @staticmethod
    def _simulator_of(system: Any, actions: list[str], seen: list[str], parameters: Any, stack: ExitStack) -> Simulator:
        if hasattr(system, "instance"):
            return system.instance(parameters=parameters)
        if isinstance(system, Scenario) or not str(system).lower().endswith(".ssp"):
            system = opened(scenario_of(system), actions, seen)
        package, options = stack.enter_context(packaged(system))
        return Simulator(package, **{**options, "parameters": parameters})

    def _begin(self, task: Any, simulator: Simulator, span: dict[str, float], held: ExitStack) -> None:
        self.task, self._simulator, self._span, self._done = task, simulator, span, -1
        self.action_space, self.observation_space = _spaces(task)
        self._held = held.pop_all()

    @checks_types
    def reset(
        self, *, seed: int | None = None, options: Mapping[str, Any] | None = None
    ) -> tuple[Floats, dict[str, Any]]:
        """Begin an episode; `options` may have ``parameters``, values by ``component.variable``."""
        super().reset(seed=seed)
        parameters = self.task.drawn(self.np_random) | _parameters(options)
        self._done = 0
        self._simulator.reset(**self._span, parameters=parameters)
        self._numbers = self._read()
        return self.task.clipped(self._numbers), {"parameters": parameters}

    def step(self, action: Floats) -> tuple[Floats, float, bool, bool, dict[str, Any]]:
        """Hold an action for `hold` communication steps."""
        if self._done < 0:
            raise UsageError(_NOT_BEGUN)
        action, info = self.task.limited(action), dict[str, Any]()
        self._done += 1
        try:
            for name, where in self.task.actions.items():
                self._simulator.set(name, action[where])
            self._simulator.step(self.task.hold)
            self._numbers = self._read()
        except CosimError as error:
            info["error"] = str(error)
        seen, reward, ended, finite = self.task.outcome(self._numbers, action, self._done, not info)
        if not finite and not info:
            info["error"] = self.task.not_finite(self._numbers)
        return seen, float(reward), bool(ended), not ended and self._done == self.task.length, info

    def _read(self) -> Floats:
        return np.array([self._simulator.get(name) for name in self.task.signals], np.float64)

    def close(self) -> None:
        """Free the components."""
        self._held.close()


class ArmEnv(Environment):
    """An arm with an agent's torques, rewarded for following the motion of a scenario.

    Parameters
    ----------
    scenario, **options
        See :class:`vdfmu.extras.learn.tasks.TrackingTask`, the class of `task`.
    """

    def __init__(self, scenario: Any = "planar_tracking", **options: Any) -> None:
        task = TrackingTask(scenario, **options)
        scenario = task.scenario
        options = {"inputs": scenario.inputs, "input_hold": scenario.input_hold}
        with ExitStack() as stack:
            package, _ = stack.enter_context(packaged(scenario))
            simulator = stack.enter_context(Simulator(package, **scenario.coupling, **options))
            self._begin(task, simulator, {"start": 0.0, "stop": scenario.stop, "step": scenario.step}, stack)


class ArmVectorEnv(VectorEnv[Floats, Floats, Floats]):
    """Many arms as :class:`ArmEnv`, stepped side by side by the batch engine; the next step resets ended ones.

    Parameters
    ----------
    num_envs : int
    scenario, **options
        See :class:`vdfmu.extras.learn.tasks.TrackingTask`.

    Raises
    ------
    UsageError
        For systems that the batch engine cannot run, such as those with FMUs of other tools.
    """

    metadata: dict[str, Any] = {"render_modes": [], "autoreset_mode": AutoresetMode.NEXT_STEP}

    @checks_types
    def __init__(self, num_envs: int = 8, scenario: Any = "planar_tracking", **options: Any) -> None:
        if num_envs < 1:
            raise UsageError(f"num_envs: expected a whole number of at least 1, got {num_envs}.")
        self.num_envs, self.task, self._parameters = num_envs, TrackingTask(scenario, **options), None
        self.single_action_space, self.single_observation_space = _spaces(self.task)
        self.action_space = batch_space(self.single_action_space, num_envs)
        self.observation_space = batch_space(self.single_observation_space, num_envs)
        task = self.task
        program = make_program(SystemDescription(task.scenario), [*task.vary, *task.seeds])
        self._lanes = SteppedLanes(program, num_envs, task.inputs, task.signals)
        self._done, self._over = np.zeros(num_envs, np.intp), np.zeros(num_envs, np.bool_)

    @checks_types
    def reset(
        self, *, seed: int | None = None, options: Mapping[str, Any] | None = None
    ) -> tuple[Floats, dict[str, Any]]:
        """Begin all episodes; `options` may have ``parameters`` of all of them."""
        super().reset(seed=seed)
        self._parameters = parameters = _parameters(options)
        self._begin(range(self.num_envs), parameters)
        return self.task.clipped(self._lanes.read()), {}

    def _begin(self, chosen: Any, parameters: dict[str, Any]) -> None:
        chosen = [int(i) for i in chosen]
        self._lanes.reset({i: self.task.drawn(self.np_random) | parameters for i in chosen})
        self._done[chosen], self._over[chosen] = 0, False
        if not self._lanes.good[chosen].all():
            raise CosimError("lanes", "initialization", 0.0, "parameters are refused; ArmEnv says why")

    def step(self, actions: Floats) -> tuple[Floats, Floats, Any, Any, dict[str, Any]]:
        """Hold an action of each arm for `hold` communication steps."""
        if self._parameters is None:
            raise UsageError(_NOT_BEGUN)
        actions, begun, info = self.task.limited(actions, (self.num_envs,)), self._over.copy(), dict[str, Any]()
        self._lanes.step(actions, self.task.hold)
        self._done += 1
        numbers, good = self._lanes.read(), self._lanes.good
        seen, rewards, ended, finite = self.task.outcome(numbers, actions, self._done, good)
        late = ~ended & (self._done == self.task.length)
        for i in np.flatnonzero(~(good & finite) & ~begun):
            text = self.task.not_finite(numbers[i]) if good[i] else _FAILED
            info = self._add_info(info, {"error": text}, int(i))
        self._over = ended | late
        if begun.any():
            self._begin(np.flatnonzero(begun), self._parameters)
            seen[begun] = self.task.clipped(self._lanes.read())[begun]
            rewards[begun], ended[begun], late[begun] = 0.0, False, False
        return seen, rewards, ended, late, info


gymnasium.register("vdfmu/Arm-v0", entry_point=ArmEnv, vector_entry_point=ArmVectorEnv)
