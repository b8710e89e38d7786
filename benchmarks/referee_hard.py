"""Evaluates `judge` on systems with events, relays, stick-slip, noise, and model exchange integrated as one.

    python -m benchmarks.referee_hard [--systems 8] [--seed 6]

Parameters are random. The true solution comes from matrix exponentials, or from scipy, which finds the time of each
event. Printed are the verdicts at wanted errors of 10, 1 and 0.1 %, by kind of system and master.
"""

from __future__ import annotations

import argparse
import tempfile
from collections import Counter
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from scipy.integrate import solve_ivp
from scipy.linalg import block_diag, expm

import vdfmu
from benchmarks.referee import count_case, show
from tests.engine.reference.models import Model, V, build
from vdfmu.base.errors import CosimError
from vdfmu.engine.algorithms import ALGORITHMS
from vdfmu.unit import Input, Output, Parameter, Sampled, Unit, linear_unit, maximum, normal, seeded, where

STEPS = (20, 60, 200, 600)
"""Communication steps of the longest of three runs; without the last for model exchange, stepped in Python."""
PERIODS = 20
"""Samples in a run."""


class Floor(Unit):
    """A floor that pushes and never pulls."""

    x, v = Input("1", text="height"), Input("1", text="speed")
    F = Output("1", text="force")
    k, c = Parameter("1", text="stiffness", start=1e3), Parameter("1", text="damping", start=1.0)

    def outputs(self) -> None:
        """Spring and damper."""
        self.F = where(self.x < 0.0, maximum(-self.k * self.x - self.c * self.v, 0.0), 0.0)


class Step(Unit):
    """A step."""

    y = Output("1", text="step")
    at = Parameter("s", text="its time", start=0.5)

    def outputs(self) -> None:
        """Step."""
        self.y = where(self.t > self.at, 1.0, 0.0)


class SampledRelay(Unit):
    """A thermostat that samples."""

    u = Input("1", text="temperature")
    y = Sampled("1", text="heat")
    period = Parameter("s", text="time between samples", start=0.1, minimum=1e-6)
    low, high = Parameter("1", text="limit below", start=0.4), Parameter("1", text="limit above", start=0.6)

    def update(self) -> None:
        """Switch."""
        self.y = where(self.u < self.low, 1.0, where(self.u > self.high, 0.0, self.y))


class Noise(Unit):
    """White noise that samples."""

    period = Parameter("s", text="time between samples", start=0.1, minimum=1e-6)
    random = Sampled("1", 6, "state of the random numbers")
    y = Sampled("1", text="noise")
    seed = Parameter("1", text="seed", start=1.0)

    def start(self) -> None:
        """Seed."""
        self.random, self.y = seeded(self.seed), 0.0

    def update(self) -> None:
        """Draw."""
        drawn, self.random = normal(self.random, 6)
        self.y = drawn[0]


RELAY = Model(
    "Relay",
    [V("u", "input", start=0.0), V("y", "output", needs=("u",)), V("low", "parameter", start=0.4),
     V("high", "parameter", start=0.6)],
    "static void outputs(Instance *I) { I->d.y = I->d.u < I->d.low ? 1.0 : I->d.u > I->d.high ? 0.0 : I->d.y; }\n",
    step=1.0, kinds=("CoSimulation",),
)  # fmt: skip
DICE = Model(
    "Dice",
    [V("y", "output", start=0.0), V("state", "parameter", start=0.4)],
    "static void outputs(Instance *I)\n"
    "{\n    I->d.state = fmod(977.0 * I->d.state + 0.1234567, 1.0);\n    I->d.y = 2.0 * I->d.state - 1.0;\n}\n",
    step=1.0, kinds=("CoSimulation",),
)  # fmt: skip
BLOCK = Model(
    "Block",
    [V("x", "output", start=0.0), V("v", "output", start=0.0), V("der(x)", needs=("v",)), V("der(v)", needs=("F",)),
     V("F", "input", start=0.0), V("m", "parameter", start=1.0), V("hold", "parameter", start=1.0),
     V("drag", "parameter", start=0.7), V("mode", start=0.0), V("z", more={"indicator": "1"})],
    """
static void outputs(Instance *I)
{
    Data *d = &I->d;
    d->der_x = d->v;
    d->der_v = d->mode == 0 ? 0 : (d->F - d->mode * d->drag) / d->m;
    d->z = d->mode == 0 ? d->hold - fabs(d->F) : d->mode * d->v;
}
static void indicators(Instance *I, double *z) { outputs(I), z[0] = I->d.z; }
static void event(Instance *I)
{
    Data *d = &I->d;
    if (d->mode == 0 && fabs(d->F) > d->hold)
        d->mode = d->F > 0 ? 1 : -1;
    else if (d->mode != 0 && d->mode * d->v <= 0 && d->mode * d->F < d->drag) {
        d->v = 0;
        d->mode = d->F < -d->hold ? -1 : d->F > d->hold ? 1 : 0;
        I->changed = true;
    }
}
""",
    step=1e-3, states=("x", "v"), indicators=1, kinds=("ModelExchange",),
)  # fmt: skip
NUMBERS = ("a", "b1", "b2", "c1", "c2", "d1", "d2", "d3")
PIECE = Model(
    "Piece",
    [V("x", "output", start=1.0), V("der(x)", needs=("x", "s", "f")), V("s", "input", start=0.0),
     V("f", "input", start=0.0), V("s_out", "output", needs=("s", "x")), V("r", "output", needs=("f", "x", "s")),
     *(V(name, "parameter", start=0.0) for name in NUMBERS)],
    "static void outputs(Instance *I)\n{\n    Data *d = &I->d;\n"
    "    d->der_x = d->a * d->x + d->b1 * d->s + d->b2 * d->f;\n    d->s_out = d->c1 * d->x + d->d1 * d->s;\n"
    "    d->r = d->c2 * d->x + d->d2 * d->f + d->d3 * d->s;\n}\n",
    step=1e-2, states=("x",), kinds=("ModelExchange",),
)  # fmt: skip


class Case(NamedTuple):
    """A random system."""

    system: vdfmu.System
    names: Sequence[str]
    """Signals."""
    stop: float
    exact: Callable[[Any, Any], Any]
    """The true signals, (times, signals), from times and the results with the shortest step."""
    sampled: Sequence[str] = ()
    """Components with a period, whose samples act at once by gauss-seidel."""


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


class Room:
    """Two random lags in a row, of gain 1."""

    def __init__(self, rng: Any) -> None:
        a, b = 10 ** rng.uniform(0.0, 1.0, 2)
        self.A, self.b, self.stop = np.array([[-a, 0.0], [b, -b]]), np.array([a, 0.0]), 8.0 / a + 8.0 / b
        self.unit = linear_unit(self.A, self.b[:, None], [[0.0, 1.0]], [[0.0]], name="Room")

    def after(self, time: float, x: Any, u: float) -> Any:
        """Return the state after a time with a constant input."""
        return (expm(np.vstack([np.column_stack([self.A, self.b]), np.zeros(3)]) * time) @ [*x, u])[:2]

    def held(self, law: Any, times: Any) -> Any:
        """Return output and input at `times` with an input that changes after each sample."""
        x, u, last, rows = np.zeros(2), 0.0, 0.0, list[Any]()
        for t in times:
            x, last, part = self.after(t - last, x, u), t, t / self.stop * PERIODS
            rows.append([x[1], u])
            u = law(x, u) if abs(part - round(part)) < 1e-6 else u
        return np.array(rows)


def contact(rng: Any, folder: Path) -> Case:
    """Return a mass that bounces on a floor."""
    m, k, c = rng.uniform(0.5, 2.0), 10 ** rng.uniform(2.0, 3.5), 10 ** rng.uniform(-0.5, 1.0)
    mass = linear_unit([[0, 1, 0], [0, 0, 1], [0, 0, 0]], [[0], [1 / m], [0]], np.eye(2, 3), np.zeros((2, 1)))
    system = vdfmu.connect(
        {"mass": mass, "floor": Floor}, {"mass.y[1]": "floor.x", "mass.y[2]": "floor.v", "floor.F": "mass.u[1]"},
        values={"mass.x_0": [0.5, 0.0, -9.81], "floor.k": k, "floor.c": c},
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

    return Case(system, ["mass.y[1]", "mass.y[2]", "floor.F"], 1.5, exact)


def step(rng: Any, folder: Path) -> Case:
    """Return a step between communication points, and a room."""
    room = Room(rng)
    at = rng.uniform(0.1, 0.5) * room.stop
    system = vdfmu.connect({"step": Step, "room": room.unit}, {"step.y": "room.u[1]"}, values={"step.at": at})
    return Case(system, ["room.y[1]", "step.y"], room.stop, lambda times, results: np.array(
        [[room.after(max(t - at, 0.0), [0.0, 0.0], 1.0)[1], float(t > at)] for t in times]))  # fmt: skip


def relay(rng: Any, folder: Path) -> Case:
    """Return a thermostat and a room."""
    room, low = Room(rng), rng.uniform(0.2, 0.5)
    high = low + rng.uniform(0.05, 0.3)
    system = vdfmu.connect(
        {"relay": build(RELAY, "3.0", folder), "room": room.unit}, {"relay.y": "room.u[1]", "room.y[1]": "relay.u"},
        values={"relay.low": low, "relay.high": high},
    )  # fmt: skip

    def exact(times: Any, results: Any) -> Any:
        x, on = by_events(
            lambda t, x, on: room.A @ x + room.b * on, lambda t, x, on: high - x[1] if on else x[1] - low,
            lambda t, x, on: (x, 1 - on), [0.0, 0.0], 1, times,
        )  # fmt: skip
        return np.column_stack([x[:, 1], on])

    return Case(system, ["room.y[1]", "relay.y"], room.stop, exact)


def sampled_relay(rng: Any, folder: Path) -> Case:
    """Return a thermostat with a period, and a room."""
    room, low = Room(rng), rng.uniform(0.2, 0.5)
    high = low + rng.uniform(0.05, 0.3)
    system = vdfmu.connect(
        {"relay": SampledRelay, "room": room.unit}, {"relay.y": "room.u[1]", "room.y[1]": "relay.u"},
        values={"relay.low": low, "relay.high": high, "relay.period": room.stop / PERIODS},
    )  # fmt: skip
    return Case(system, ["room.y[1]", "relay.y"], room.stop, lambda times, results: room.held(
        lambda x, on: 1.0 if x[1] < low else 0.0 if x[1] > high else on, times), ["relay"])  # fmt: skip


def sampled_noise(rng: Any, folder: Path) -> Case:
    """Return noise with a period, and a room."""
    room = Room(rng)
    values = {"noise.period": room.stop / PERIODS, "noise.seed": float(rng.integers(1, 1000))}
    system = vdfmu.connect({"noise": Noise, "room": room.unit}, {"noise.y": "room.u[1]"}, values=values)

    def exact(times: Any, results: Any) -> Any:
        middle = np.searchsorted(results.time, (np.arange(PERIODS) + 0.5) * room.stop / PERIODS)
        drawn = iter([*results["noise.y"][middle], 0.0])
        return room.held(lambda x, u: next(drawn), times)

    return Case(system, ["room.y[1]", "noise.y"], room.stop, exact)


def noise(rng: Any, folder: Path) -> Case:
    """Return noise that each step draws anew, and a room; the truth is without noise."""
    room = Room(rng)
    system = vdfmu.connect({"dice": build(DICE, "3.0", folder), "room": room.unit}, {"dice.y": "room.u[1]"},
                           values={"dice.state": rng.random(), "room.x_0": [1.0, 1.0]})  # fmt: skip
    return Case(system, ["room.y[1]", "dice.y"], room.stop, lambda times, results: np.array(
        [[room.after(t, [1.0, 1.0], 0.0)[1], 1e-300] for t in times]))  # fmt: skip


def stick(rng: Any, folder: Path) -> Case:
    """Return a block that sticks and slips, for model exchange, and a spring that draws it at constant speed."""
    m, k, c, speed = rng.uniform(0.5, 2.0), 10 ** rng.uniform(1.0, 2.0), rng.uniform(0.0, 1.0), rng.uniform(0.1, 0.5)
    hold = rng.uniform(1.0, 3.0)
    drag = hold * rng.uniform(0.4, 0.9)
    spring = linear_unit([[0, 1], [0, 0]], np.zeros((2, 2)), [[k, c]], [[-k, -c]], name="Spring")
    system = vdfmu.connect(
        {"block": build(BLOCK, "3.0", folder), "spring": spring},
        {"block.x": "spring.u[1]", "block.v": "spring.u[2]", "spring.y[1]": "block.F"},
        values={"block.m": m, "block.hold": hold, "block.drag": drag, "spring.x_0": [0.0, speed]},
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
    return Case(system, ["block.x", "block.v", "spring.y[1]"], stop, exact)


def as_one(rng: Any, folder: Path) -> Case:
    """Return a chain of three for model exchange, which pass on in both directions, and a lag for co-simulation."""
    # inputs a.s a.f b.s b.f c.s c.f lag.u; outputs a.s_out a.r b.s_out b.r c.s_out c.r lag.y
    wires, L = {0: 6, 2: 0, 4: 2, 3: 5, 1: 3, 6: 4}, np.zeros((7, 7))
    L[[*wires], [*wires.values()]] = 1.0
    while True:
        a, b1, b2, c1, c2, d1, d2, d3 = pieces = rng.normal(size=(8, 3))
        a[:], pieces[5:], rate = -(10 ** rng.uniform(-0.3, 0.7, 3)), pieces[5:] / 2, 10 ** rng.uniform(-0.3, 0.7)
        A: Any = np.diag([*a, -rate])
        B: Any = block_diag(*np.stack([b1, b2], 1)[:, None], [[rate]])
        C: Any = block_diag(*np.stack([c1, c2], 1)[..., None], [[1.0]])
        D: Any = block_diag(*([[p, 0.0], [r, q]] for p, q, r in zip(d1, d2, d3, strict=True)), [[0.0]])
        outputs = np.linalg.solve(np.eye(7) - D @ L, C)
        closed = A + B @ L @ outputs
        if np.linalg.eigvals(closed).real.max() < 1.0:
            break
    piece = build(PIECE, "3.0", folder)
    system = vdfmu.connect(
        dict.fromkeys("abc", piece) | {"lag": linear_unit([[-rate]], [[rate]], [[1.0]], [[0.0]], name="Lag")},
        {"a.s_out": "b.s", "b.s_out": "c.s", "c.r": "b.f", "b.r": "a.f", "c.s_out": "lag.u[1]", "lag.y[1]": "a.s"},
        values={f"{x}.{name}": pieces[i, k] for i, name in enumerate(NUMBERS) for k, x in enumerate("abc")},
    )  # fmt: skip
    start = [1.0, 1.0, 1.0, 0.0]
    return Case(system, ["a.s_out", "b.s_out", "c.r", "b.r", "c.s_out", "lag.y[1]"],
                4.0 / np.abs(np.linalg.eigvals(closed)).max() ** 0.5, lambda times, results: np.array(
        [(outputs @ expm(closed * t) @ start)[[0, 2, 5, 3, 4, 6]] for t in times]))  # fmt: skip


KINDS = {"contact": contact, "step at any time": step, "relay": relay, "relay, sampled": sampled_relay,
         "stick-slip": stick, "noise, sampled": sampled_noise, "noise": noise, "exchange as one": as_one}  # fmt: skip


def evaluate(kind: str, rng: Any, folder: Path, counts: dict[str, Counter[str]]) -> None:
    """Add the cases of one system to the counts of each master."""
    case, exact = KINDS[kind](rng, folder), dict[int, Any]()
    for algorithm, count in counts.items():
        try:
            with case.system.instance(algorithm=algorithm, isolate=False, tolerance=1e-9) as instance:
                for n in STEPS[: 3 if kind in ("stick-slip", "exchange as one") else 4]:
                    h = case.stop / n
                    try:
                        runs = [instance.run(stop=n * h, step=h / divisor, record=case.names) for divisor in (1, 2, 4)]
                    except CosimError:
                        count["failed"] += 1
                        continue
                    rows = [np.column_stack([run[name] for name in case.names]) for run in runs]
                    if n not in exact:
                        exact[n] = case.exact(runs[0].time, runs[2])
                    sampled = case.sampled if algorithm == "gauss-seidel" else ()
                    count_case(count, ALGORITHMS[algorithm].order, case.names, rows, exact[n], sampled)
        except vdfmu.VdfmuError:
            count["refused"] += 1


def main() -> None:
    """Evaluate and print."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--systems", type=int, default=8)
    parser.add_argument("--seed", type=int, default=6)
    parser.add_argument("--kind", choices=KINDS, action="append")
    chosen = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        for kind in chosen.kind or KINDS:
            rng = np.random.default_rng(chosen.seed)
            counts: dict[str, Counter[str]] = {name: Counter() for name in ALGORITHMS.names()}
            for number in range(chosen.systems):
                evaluate(kind, rng, Path(folder, f"{number}"), counts)
            show(f"{kind}: {chosen.systems} systems, seed {chosen.seed}", counts)


if __name__ == "__main__":
    main()
