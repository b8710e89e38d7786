"""Random systems of :mod:`benchmarks.judge` with events or chaos, with their true solutions."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from scipy.integrate import solve_ivp

import vdfmu
from benchmarks.judge_kinds import PERIODS, Case, House, solved
from benchmarks.judge_units import BLOCK, Drag, Floor, Lags, LorenzX, LorenzYZ, Mass, SampledRelay, Step
from tests.engine.reference.models import build


def by_events(rates: Any, guard: Any, after: Any, start: Any, mode: Any, times: Any) -> tuple[Any, Any]:
    """Return states and modes at times; `guard` is positive in a mode, and `after` returns state and mode at its 0."""
    x, t, states, modes = np.asarray(start, float), 0.0, np.empty((len(times), len(start))), np.empty(len(times))
    while True:
        event: Any = lambda t, x, mode=mode: guard(t, x, mode)  # noqa: E731
        event.terminal, event.direction = True, -1.0
        # relative errors of 1e-11 in steps of a 200th of the run: far below the smallest wanted error of 1e-3
        solved: Any = solve_ivp(
            lambda t, x, mode=mode: rates(t, x, mode), (t, times[-1] + 1e-9), x, "DOP853", rtol=1e-11, atol=1e-13,
            dense_output=True, events=event, max_step=times[-1] / 200,
        )  # fmt: skip
        here = (times >= t) & (times <= solved.t[-1])
        if here.any():
            states[here], modes[here] = solved.sol(times[here]).T, mode
        if solved.status == 0:
            return states, modes
        t = solved.t[-1]
        x, mode = after(t, solved.y[:, -1], mode)


def bounce(rng: Any, folder: Path) -> Case:
    """Return a mass that bounces on a floor."""
    m, k, c = rng.uniform(0.5, 2.0), 10 ** rng.uniform(2.0, 3.5), 10 ** rng.uniform(-0.5, 1.0)
    system = vdfmu.connect(
        {"mass": Mass, "floor": Floor}, {"mass.x": "floor.x", "mass.v": "floor.v", "floor.F": "mass.F"},
        parameters={"mass.m": m, "mass.g": 9.81, "mass.x_0": 0.5, "floor.k": k, "floor.c": c},
    )  # fmt: skip

    def force(x: Any, mode: Any) -> Any:
        return -mode * (k * x[0] + c * x[1])

    def exact(times: Any, results: Any) -> Any:
        x, mode = by_events(
            lambda t, x, mode: [x[1], force(x, mode) / m - 9.81],
            lambda t, x, mode: force(x, mode) if mode else x[0],
            lambda t, x, mode: (x, 1 - mode), [0.5, 0.0], 0, times,
        )  # fmt: skip
        return np.column_stack([x, force(x.T, mode)])

    return Case(system, ["mass.x", "mass.v", "floor.F"], 1.5, exact, (60, 600))


def stick(rng: Any, folder: Path) -> Case:
    """Return a block that sticks and slips, for model exchange, and a spring that draws it at constant speed."""
    m, k, c, speed = rng.uniform(0.5, 2.0), 10 ** rng.uniform(1.0, 2.0), rng.uniform(0.0, 1.0), rng.uniform(0.1, 0.5)
    hold = rng.uniform(1.0, 3.0)
    drag = hold * rng.uniform(0.4, 0.9)
    system = vdfmu.connect(
        {"block": build(BLOCK, "3.0", folder), "drag": Drag},
        {"block.x": "drag.x", "block.v": "drag.v", "drag.F": "block.F"},
        parameters={
            "block.m": m, "block.hold": hold, "block.drag": drag, "drag.k": k, "drag.c": c, "drag.speed": speed,
        },
    )  # fmt: skip

    def force(t: Any, x: Any) -> Any:
        return k * (speed * t - x[0]) + c * (speed - x[1])

    def after(t: Any, x: Any, mode: Any) -> Any:
        f, stays = force(t, x), np.array([x[0], 0.0])
        return (x, np.sign(f)) if mode == 0 else (stays, np.sign(f) if abs(f) > hold else 0.0)

    def exact(times: Any, results: Any) -> Any:
        x, _ = by_events(
            lambda t, x, mode: [x[1], (force(t, x) - mode * drag) / m] if mode else [0.0, 0.0],
            lambda t, x, mode: mode * x[1] if mode else hold - abs(force(t, x)), after, [0.0, 0.0], 0.0, times,
        )  # fmt: skip
        return np.column_stack([x, force(times, x.T)])

    stop = 3.0 * (hold / k / speed + 1.0 / np.sqrt(k / m))
    return Case(system, ["block.x", "block.v", "drag.F"], stop, exact, (60, 200))


def sampled_thermostat(rng: Any, folder: Path) -> Case:
    """Return a thermostat with a period, and a room."""
    room, low = House(rng), rng.uniform(0.2, 0.5)
    high, period = low + rng.uniform(0.05, 0.3), room.stop / PERIODS
    system = vdfmu.connect(
        {"relay": SampledRelay, "room": Lags}, {"relay.y": "room.u", "room.y": "relay.u"},
        parameters={"relay.low": low, "relay.high": high, "relay.period": period, **room.values},
        algorithm="gauss-seidel",
    )  # fmt: skip

    def exact(times: Any, results: Any) -> Any:
        return room.held(lambda x, on: 1.0 if x[1] < low else 0.0 if x[1] > high else on, times, period)

    return Case(system, ["room.z", "room.y", "relay.y"], room.stop, exact, (100, 400))


def step(rng: Any, folder: Path) -> Case:
    """Return a step between communication points, and two lags."""
    room = House(rng)
    at = rng.uniform(0.1, 0.5) * room.stop
    system = vdfmu.connect(
        {"step": Step, "room": Lags}, {"step.y": "room.u"}, parameters={"step.at": at, **room.values}
    )

    def exact(times: Any, results: Any) -> Any:
        x = np.array([room.after(max(t - at, 0.0), [0.0, 0.0], 1.0) for t in times])
        return np.column_stack([x, times > at])

    return Case(system, ["room.z", "room.y", "step.y"], room.stop, exact)


def chaotic(rng: Any, folder: Path) -> Case:
    """Return the equations of Lorenz in two components."""
    start = rng.normal(size=3) + [1.0, 1.0, 20.0]
    system = vdfmu.connect({"a": LorenzX, "b": LorenzYZ}, {"a.x": "b.u", "b.y": "a.u"},
                           parameters={"a.x_0": start[0], "b.y_0": start[1], "b.z_0": start[2]})  # fmt: skip
    return Case(system, ["a.x", "b.y", "b.z"], rng.uniform(5.0, 15.0), lambda times, results: solved(
        lambda t, x: [10.0 * (x[1] - x[0]), x[0] * (28.0 - x[2]) - x[1], x[0] * x[1] - 8.0 / 3.0 * x[2]], start, times),
        (1000, 5000))  # fmt: skip
