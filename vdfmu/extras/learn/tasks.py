"""The tasks of an agent: actions, observations, and the reward for tracking."""

from __future__ import annotations

import dataclasses
import math
import os
from collections.abc import Callable, Iterable, Mapping, Sequence
from contextlib import suppress
from typing import Any

import numpy as np

from vdfmu.base.arrays import Floats
from vdfmu.base.errors import UsageError
from vdfmu.base.option import checks_types
from vdfmu.study.run.prepare import scenario_of
from vdfmu.system.scenario import Scenario
from vdfmu.system.scenario.values import override

LIMITS = {"rad": 2.0 * math.pi, "rad/s": 50.0, "m": 5.0, "m/s": 10.0, "N.m": 1e3, "N": 1e4, "1": 1e6}
"""Default of an observation's largest absolute value, by unit of measurement."""
SEEN = ("plant.q", "plant.q_dot", "plant.kappa_dot", "plant.tau_s", "trajectory.q_d", "trajectory.q_d_dot")


Tables = Mapping[str, Iterable[Any]]
"""Component to its variables."""


class Task:
    """An agent's actions and observations, their bounds, and the reward.

    For `actions`, `observations`, `reward`, `lost`, `ended`, `hold` and `vary` see
    :class:`vdfmu.extras.learn.environments.Environment`; `length` is the number of actions in an episode. Each
    parameter ``seed`` that is not in `vary` gets a whole number below 2^31 at each reset.

    Attributes
    ----------
    inputs, action_units : list of str
        Elements of an action, and their units of measurement.
    signals, units : list of str
        Elements of an observation, and their units of measurement.
    """

    def __init__(
        self,
        tables: Tables,
        actions: Mapping[str, Any],
        observations: Mapping[str, Any],
        reward: Callable[[dict[str, Floats], dict[str, Floats]], Any],
        *,
        length: int,
        hold: int,
        lost: float = 0.0,
        ended: Callable[[dict[str, Floats]], Any] | None = None,
        vary: Mapping[str, tuple[float, float]] | None = None,
    ) -> None:
        self.length, self.hold, self.vary = length, hold, dict(vary or {})
        self._reward, self._ended = reward, ended
        self._lost = _numbers(lost, (), "lost: expected a finite number")
        self.inputs, self.action_units, self.least, self.limit, self.actions = _groups(tables, actions, "input")
        self.signals, self.units, self.low, self.high, self.seen = _groups(tables, observations, "output")
        parameters = [f"{name}.{v.name}" for name, table in tables.items() for v in table if v.causality == "parameter"]
        self.seeds = [name for name in parameters if name.endswith(".seed") and name not in self.vary]
        for name, bounds in self.vary.items():
            if name not in parameters:
                raise UsageError(f"vary: {name}: must be one parameter of a component, with its index.")
            low, high = _numbers(bounds, (2,), f"vary: {name}: expected two finite numbers, the lower first")
            if not low <= high:
                raise UsageError(f"vary: {name}: expected two finite numbers, the lower first, got {bounds}.")

    def drawn(self, generator: np.random.Generator) -> dict[str, float]:
        """Return values for `vary` and `seeds`."""
        varied = {name: float(generator.uniform(*bounds)) for name, bounds in self.vary.items()}
        return varied | {name: int(generator.integers(2**31)) for name in self.seeds}

    def limited(self, action: Any, systems: tuple[int, ...] = ()) -> Floats:
        """Return an action (.., inputs) within its limits; UsageError if it is not finite."""
        shape = (*systems, len(self.inputs))
        numbers = _numbers(action, shape, f"action: expected finite numbers of shape {shape}")
        return np.clip(numbers, self.least, self.limit)

    def outcome(self, numbers: Floats, action: Floats, done: Any, good: Any) -> tuple[Floats, Floats, Any, Any]:
        """Return observations, rewards, whether episodes end before their time, and whether all numbers are finite.

        Parameters
        ----------
        numbers : (.., signals), at the end of the step
        action : (.., inputs), within their limits
        done : (..) actions of the episodes so far, this one among them
        good : (..) whether the steps were solved
        """
        inside = ((numbers >= self.low) & (numbers <= self.high)).all(axis=-1)
        seen = {name: numbers[..., where] for name, where in self.seen.items()}
        ended = ~(np.asarray(good) & inside)
        if self._ended is not None:
            ended |= _answer("ended", "True or False", self._ended(seen), ended.shape) != 0.0
        with np.errstate(over="ignore", invalid="ignore"):
            reward = self._reward(seen, {name: action[..., where] for name, where in self.actions.items()})
        reward = _answer("reward", "a number", reward, ended.shape)
        finite = np.isfinite(reward) & np.isfinite(numbers).all(axis=-1)
        ended |= ~finite
        return self.clipped(numbers), np.where(ended, self._lost * (self.length - done + 1), reward), ended, finite

    def not_finite(self, numbers: Floats) -> str:
        """Report why an episode with observations (signals) or a reward that are not finite has ended."""
        names = [name for name, number in zip(self.signals, numbers, strict=True) if not math.isfinite(number)]
        return f"{', '.join(names) or 'the reward'}: expected a finite number at each step, so the episode ends."

    def clipped(self, numbers: Floats) -> Floats:
        """Return observations within their bounds."""
        return np.clip(np.nan_to_num(numbers), self.low, self.high)


class TrackingTask(Task):
    """An agent's torques instead of a scenario's controller, and the cost of tracking.

    Parameters
    ----------
    scenario : Scenario, str or path
        Scenario whose components that affect neither the action nor an observation, such as the controller, are
        removed.
    action : str
        Group of inputs that the agent sets, ``component.group``; its connection is cut.
    seen : sequence of str
        Groups of outputs that the agent observes.
    track : (str, str)
        Desired and actual position, both observed.
    limit : float or (n,) [unit of the action]
        Largest absolute value of the action.
    limits : mapping of str to float
        Group to the largest absolute value of an observation, instead of `LIMITS`.
    hold : int
        Number of communication steps for which an action is held.
    error : float [rad or m]
        Error of a joint that costs 0.5.
    effort : float
        Cost of all actions at their limits.
    vary : mapping of str to (low, high)
        See :class:`Task`. Each parameter ``seed`` of a component that is not among them is drawn too.

    Raises
    ------
    UsageError
        For unknown signals and parameters, impossible numbers, or an episode that is not a whole number of actions.
    """

    @checks_types
    def __init__(
        self,
        scenario: Scenario | str | os.PathLike[str] = "planar_tracking",
        *,
        action: str = "plant.tau",
        seen: Sequence[str] = SEEN,
        track: Sequence[str] = ("trajectory.q_d", "plant.q"),
        limit: float | Sequence[float] = 1.0,
        limits: Mapping[str, float] | None = None,
        hold: int = 4,
        error: float = 0.1,
        effort: float = 0.01,
        vary: Mapping[str, tuple[float, float]] | None = None,
    ) -> None:
        _check_number("error", error, 0.0)
        _check_number("effort", effort, 0.0, among=True)
        if len(track) != 2:
            raise UsageError(f"track: expected a desired and an actual position, got {track!r}.")
        loaded = scenario_of(scenario)
        self.scenario = opened(loaded, [action], seen)
        tables = self.scenario.resolved.tables
        if missing := {*track, *(limits or {})} - {*seen}:
            raise UsageError(f"{', '.join(sorted(missing))}: expected an observed signal: {', '.join(seen)}.")

        def reward(seen: dict[str, Floats], actions: dict[str, Floats]) -> Floats:
            e = (seen[track[0]] - seen[track[1]]) / error
            return -np.mean(e * e / (1.0 + e * e), axis=-1) - effort * np.mean(
                (actions[action] / self.limit) ** 2, axis=-1
            )

        super().__init__(
            tables,
            {action: limit},
            {name: (limits or {}).get(name) for name in seen},
            reward,
            length=episode(loaded.stop, loaded.step, hold),
            hold=hold,
            lost=-(1.0 + effort),
            vary=vary,
        )
        for name, bounds in self.vary.items():
            for value in bounds:
                override(self.scenario, {name: float(value)})


def episode(stop: float, step: float, hold: int) -> int:
    """Return the number of actions per episode; UsageError unless it is whole."""
    length = round(stop / (step * hold)) if hold >= 1 and hold % 1 == 0 else 0
    if length < 1 or not math.isclose(length * hold * step, stop, rel_tol=1e-9):
        raise UsageError(f"hold: expected a number of steps that divides {stop:g} s into whole actions, got {hold}.")
    return length


def _groups(
    tables: Tables, groups: Mapping[str, Any], causality: str
) -> tuple[list[str], list[str], Floats, Floats, Any]:
    """Return names, units and bounds of the elements of groups, ``component.group``, and the place of each group."""
    names, units, ends, places = list[str](), list[str](), list[Any](), dict[str, slice]()
    if not groups:
        kind = "actions" if causality == "input" else "observations"
        raise UsageError(f"{kind}: expected at least one {causality}, such as 'arm.tau', got none.")
    for name, bounds in groups.items():
        component, _, wanted = name.partition(".")
        variables = [
            v
            for v in tables.get(component, ())
            if wanted in (v.name, v.name.partition("[")[0]) and v.causality == causality
        ]
        if not variables:
            raise UsageError(f"{name!r}: expected a group of {causality}s of one of {', '.join(tables)}.")
        elements = [f"{component}.{v.name}" for v in variables]
        measures = [getattr(v.unit, "name", v.unit) or "1" for v in variables]
        label = "limit" if causality == "input" else f"limits: {name}"
        if bounds is None:
            bounds = [LIMITS.get(unit, LIMITS["1"]) for unit in measures]
        n = len(elements)
        largest = not (isinstance(bounds, tuple) and len(bounds) == 2)
        expected = f"{label}: expected one finite number, or {n} for {name}"
        low, high = (_numbers(end, (n,), expected, spread=True) for end in ((bounds, bounds) if largest else bounds))
        both = np.array([-high if largest else low, high])
        if not (both[0] < both[1]).all():
            sign = "a finite number above 0" if largest else "finite bounds, the lower first"
            raise UsageError(f"{label}: expected {sign}, got {bounds}.")
        places[name] = slice(len(names), len(names) + len(elements))
        names, units, ends = [*names, *elements], [*units, *measures], [*ends, both]
    return names, units, *np.concatenate(ends, axis=1), places


def _numbers(value: Any, shape: tuple[int, ...], expected: str, spread: bool = False) -> Floats:
    """Return finite numbers of a shape, or with `spread` one for all; UsageError that states the expectation."""
    try:
        numbers = np.asarray(value, np.float64)
    except (TypeError, ValueError, OverflowError):
        numbers = np.full(shape, np.nan)
    if numbers.shape not in (shape, () if spread else shape) or not np.isfinite(numbers).all():
        got = np.array2string(value, threshold=9) if isinstance(value, np.ndarray) else f"{value!r:.60}"
        raise UsageError(f"{expected}, got {got}.")
    return np.broadcast_to(numbers, shape)


def _answer(name: str, expected: str, value: Any, shape: tuple[int, ...]) -> Floats:
    """Return the value of a user's function as numbers of a shape; UsageError for anything else."""
    with suppress(TypeError, ValueError, OverflowError):
        numbers = np.asarray(value, np.float64)
        if numbers.shape == shape and value is not None:
            return numbers
    of = f" of shape {shape}" if shape else ""
    raise UsageError(f"{name}: expected a function that returns {expected}{of}, got {value!r:.60}.")


def _check_number(name: str, value: Any, least: float, among: bool = False) -> None:
    """Check that a number is finite and above `least` or, if `least` is `among` the allowed numbers, not below it."""
    number = value if np.ndim(value) == 0 and isinstance(value, (int, float, np.number)) else math.nan
    if not (math.isfinite(number) and (number > least or (among and number == least))):
        raise UsageError(
            f"{name}: expected a finite number {'of at least' if among else 'above'} {least:g}, got {value}."
        )


def opened(scenario: Scenario, actions: Sequence[str], seen: Sequence[str]) -> Scenario:
    """Return a scenario with these inputs unconnected and without components that affect neither these nor `seen`."""
    system = scenario.system
    links = {key: [end for end in ends if end not in actions] for key, ends in system.connections.items()}
    kept: set[str] = set()
    new = {signal.partition(".")[0] for signal in (*actions, *seen)}
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
