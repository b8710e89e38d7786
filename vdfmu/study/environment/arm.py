"""Environments of gymnasium: the task of an agent, an arm in the master, and many arms in lanes."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Mapping, Sequence
from contextlib import ExitStack
from typing import Any

import numpy as np

from vdfmu.base.arrays import Floats
from vdfmu.base.errors import CosimError, UsageError
from vdfmu.base.option import check_type
from vdfmu.engine.run import Simulator
from vdfmu.study.analysis.system import packaged
from vdfmu.study.batch.engine import SteppedLanes
from vdfmu.study.batch.make import make_program
from vdfmu.system.package.description import SystemDescription
from vdfmu.system.scenario import Scenario, load_scenario
from vdfmu.system.scenario.values import override

LIMITS = {"rad": 2.0 * math.pi, "rad/s": 50.0, "m": 5.0, "m/s": 10.0, "N.m": 1e3, "N": 1e4, "1": 1e6}
"""Largest absolute value of a signal that is seen, by its unit of measurement, where none is given."""
SEEN = ("plant.q", "plant.q_dot", "plant.kappa_dot", "plant.tau_s", "trajectory.q_d", "trajectory.q_d_dot")


class TrackingTask:
    """An agent's torques in place of what a scenario connects to an input, and the cost of tracking.

    Parameters
    ----------
    scenario : Scenario, str or path
        With its parts that reach what the agent acts on or sees; the others, such as the controller, are left out.
    action : str
        Group of inputs that the agent sets, ``component.group``; what fed it is disconnected.
    seen : sequence of str
        Groups of outputs that it sees, one after the other.
    track : (str, str)
        Desired and actual position; both are seen.
    limit : float or (n,) [unit of the action]
        Largest absolute value of the action.
    limits : mapping of str to float
        Group to the largest absolute value that is seen, instead of `LIMITS`.
    hold : int
        Communication steps for which an action holds.
    error : float [rad or m]
        Error of a joint that costs a half.
    effort : float
        Cost of all actions at their limits.
    vary : mapping of str to (low, high)
        Parameters, ``component.variable``, that are drawn uniformly at each reset. Each parameter ``seed`` of a
        component that is not among them gets a whole number below 2^31.

    Raises
    ------
    UsageError
        For signals and parameters that are not there, numbers that cannot be, or an episode that is not a whole number
        of actions.
    """

    def __init__(
        self,
        scenario: Scenario | str = "planar_tracking",
        *,
        action: str = "plant.tau",
        seen: Sequence[str] = SEEN,
        track: tuple[str, str] = ("trajectory.q_d", "plant.q"),
        limit: float | Sequence[float] = 1.0,
        limits: Mapping[str, float] | None = None,
        hold: int = 4,
        error: float = 0.1,
        effort: float = 0.01,
        vary: Mapping[str, tuple[float, float]] | None = None,
    ) -> None:
        for name, kind, value in (("seen", "Sequence[str]", seen), ("vary", "Mapping[str, Any] | None", vary),
                                  ("limits", "Mapping[str, Any] | None", limits)):  # fmt: skip
            check_type(name, kind, value)
        loaded = scenario if isinstance(scenario, Scenario) else load_scenario(scenario)
        self.action, self.hold, self.error, self.effort, self.vary = action, hold, error, effort, dict(vary or {})
        _check_number("error", error, 0.0)
        _check_number("effort", effort, 0.0, among=True)
        self.scenario = opened(loaded, action, seen)
        self.length = round(loaded.stop / (loaded.step * hold)) if hold >= 1 and hold % 1 == 0 else 0
        if self.length < 1 or not math.isclose(self.length * hold * loaded.step, loaded.stop, rel_tol=1e-9):
            raise UsageError(f"hold: expected steps of which {loaded.stop:g} s is a whole multiple, got {hold}.")
        tables = self.scenario.resolved.tables
        self.inputs, self.action_units = self._named(tables, action, "input")
        found = [self._named(tables, group, "output") for group in seen]
        self.signals = [name for names, _ in found for name in names]
        self.units = [unit for _, units in found for unit in units]
        ends = np.cumsum([0, *(len(names) for names, _ in found)])
        where = {group: slice(*ends[i : i + 2]) for i, group in enumerate(seen)}
        if missing := {*track, *(limits or {})} - where.keys():
            raise UsageError(f"{', '.join(sorted(missing))}: expected one of what is seen: {', '.join(seen)}.")
        self._desired, self._actual = where[track[0]], where[track[1]]
        self.high = np.array([LIMITS.get(unit, LIMITS["1"]) for unit in self.units])
        for group, value in (limits or {}).items():
            _check_number(f"limits: {group}", value, 0.0)
            self.high[where[group]] = value
        if np.ndim(limit) and np.shape(limit) != (len(self.inputs),):
            raise UsageError(f"limit: expected one number, or {len(self.inputs)} for {action}, got {limit}.")
        for each in np.ravel(limit):
            _check_number("limit", each, 0.0)
        self.limit = np.broadcast_to(np.asarray(limit, np.float64), (len(self.inputs),)).copy()
        parameters = [f"{name}.{v.name}" for name, table in tables.items() for v in table if v.causality == "parameter"]
        self.seeds = [name for name in parameters if name.endswith(".seed") and name not in self.vary]
        self._check_varied(parameters)

    def _check_varied(self, parameters: Sequence[str]) -> None:
        """Check names and bounds of what varies; values are held against the limits of each parameter."""
        for name, bounds in self.vary.items():
            if np.shape(bounds) != (2,) or not (np.isfinite(bounds).all() and bounds[0] <= bounds[1]):
                raise UsageError(f"vary: {name}: expected two finite numbers, the lower first, got {bounds}.")
            for value in bounds:
                override(self.scenario, {name: float(value)})
            if name not in parameters:
                raise UsageError(f"vary: {name}: expected one parameter of a component, such as {parameters[0]}.")

    @staticmethod
    def _named(tables: Mapping[str, Any], group: str, causality: str) -> tuple[list[str], list[str]]:
        component, _, wanted = group.partition(".")
        found = [v for v in tables.get(component, ()) if v.group == wanted and v.causality == causality]
        if not found:
            raise UsageError(f"{group!r}: expected a group of {causality}s of one of {', '.join(tables)}.")
        return [f"{component}.{v.name}" for v in found], [v.unit or "1" for v in found]

    def drawn(self, generator: np.random.Generator) -> dict[str, float]:
        """Return values of what varies."""
        varied = {name: float(generator.uniform(*bounds)) for name, bounds in self.vary.items()}
        return varied | {name: int(generator.integers(2**31)) for name in self.seeds}

    def limited(self, action: Any, arms: tuple[int, ...] = ()) -> Floats:
        """Return an action (.., inputs), of one arm or several, within its limits; UsageError if it is not finite."""
        shape = (*arms, len(self.inputs))
        if np.shape(action) != shape or not np.isfinite(action).all():
            got = np.array2string(np.asarray(action), threshold=9)
            raise UsageError(f"action: expected finite numbers of shape {shape}, got {got}.")
        return np.clip(action, -self.limit, self.limit)

    def outcome(self, numbers: Floats, action: Floats, done: Any, good: Any) -> tuple[Floats, Floats, Any]:
        """Return what is seen, the rewards, and whether episodes end before their time.

        Parameters
        ----------
        numbers : (.., signals), at the end of the step
        action : (.., inputs), within their limits
        done : (..) actions of the episodes so far, this one among them
        good : (..) whether the steps were solved
        """
        ended = ~(np.asarray(good) & (np.abs(numbers) <= self.high).all(axis=-1))
        e = (numbers[..., self._desired] - numbers[..., self._actual]) / self.error
        with np.errstate(over="ignore", invalid="ignore"):
            cost = np.mean(e * e / (1.0 + e * e), axis=-1)
        cost = cost + self.effort * np.mean((action / self.limit) ** 2, axis=-1)
        rest = (1.0 + self.effort) * (self.length - done + 1)
        return self.clipped(numbers), np.where(ended, -rest, -cost), ended

    def clipped(self, numbers: Floats) -> Floats:
        """Return numbers within what can be seen."""
        return np.clip(np.nan_to_num(numbers), -self.high, self.high)


def _check_number(name: str, value: Any, least: float, among: bool = False) -> None:
    """Check that a number is finite and above `least`, or `among` what is allowed also that."""
    number = value if np.ndim(value) == 0 and isinstance(value, (int, float, np.number)) else math.nan
    if not (math.isfinite(number) and (number > least or (among and number == least))):
        raise UsageError(
            f"{name}: expected a finite number {'of at least' if among else 'above'} {least:g}, got {value}."
        )


def opened(scenario: Scenario, action: str, seen: Sequence[str]) -> Scenario:
    """Return a scenario without what feeds an input, and without components that reach neither it nor what is seen."""
    system = scenario.system
    links = {key: [end for end in ends if end != action] for key, ends in system.connections.items()}
    kept: set[str] = set()
    new = {signal.partition(".")[0] for signal in (action, *seen)}
    while new:
        kept |= new
        new = {k.partition(".")[0] for k, ends in links.items() if any(e.partition(".")[0] in new for e in ends)} - kept
    if unknown := kept - system.parts.keys():
        raise UsageError(f"{', '.join(sorted(unknown))}: expected components of {', '.join(system.parts)}.")
    inner = {key: [end for end in ends if end.partition(".")[0] in kept] for key, ends in links.items()}
    return dataclasses.replace(
        scenario,
        system=dataclasses.replace(
            system,
            parts={name: part for name, part in system.parts.items() if name in kept},
            connections={key: ends for key, ends in inner.items() if ends and key.partition(".")[0] in kept},
            shared={name: each for name, each in system.shared.items() if each.keys() <= kept},
        ),
        sections={name: section for name, section in scenario.sections.items() if name in kept},
        paper={},
    )


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
        See :class:`vdfmu.study.environment.arm.TrackingTask`, which is `task`.

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
        See :class:`vdfmu.study.environment.arm.TrackingTask`.

    Raises
    ------
    UsageError
        For systems that the batch engine cannot run, such as those with FMUs of other tools.
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
