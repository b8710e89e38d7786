"""Random systems of :mod:`benchmarks.judge` with their true solutions, one function for each kind."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from scipy.integrate import solve_ivp
from scipy.linalg import block_diag, expm

import vdfmu
from benchmarks.judge_units import DELAY, HIDDEN, NUMBERS, PIECE, Block, Lags, Tone
from tests.engine.reference.models import build
from vdfmu.arm.units import find_unit
from vdfmu.base.files import data_path

Lag = find_unit(data_path("examples") / "units" / "low_pass.py")
PERIODS = 20
"""Samples in a run."""


class Case(NamedTuple):
    """A random system."""

    system: vdfmu.System
    names: Sequence[str]
    """All of its real outputs."""
    stop: float
    exact: Callable[[Any, Any], Any]
    """The true signals, (times, signals), from times and the results with the shortest step."""
    steps: tuple[int, int] = (60, 400)
    """Communication steps of the two runs that are judged."""


def solved(rates: Any, start: Any, times: Any) -> Any:
    """Return a smooth solution at times, with relative errors of 1e-12 in a step."""
    return solve_ivp(rates, (0.0, times[-1]), start, "DOP853", times, rtol=1e-12, atol=1e-13).y.T


def closed_loop(A: Any, B: Any, C: Any, D: Any, L: Any) -> tuple[Any, Any]:
    """Return the system matrix of ``x_dot = A x + B u, y = C x + D u`` with ``u = L y``, and y over x."""
    outputs = np.linalg.solve(np.eye(len(L)) - D @ L, C)
    return A + B @ L @ outputs, outputs


class House:
    """Two random lags in a row, of gain 1."""

    def __init__(self, rng: Any) -> None:
        a, b = 10 ** rng.uniform(0.0, 1.0, 2)
        self.A, self.b, self.stop = np.array([[-a, 0.0], [b, -b]]), np.array([a, 0.0]), 8.0 / a + 8.0 / b
        self.values = {"room.a": a, "room.b": b}

    def after(self, time: float, x: Any, u: float) -> Any:
        """Return the state after a time with a constant input."""
        return (expm(np.vstack([np.column_stack([self.A, self.b]), np.zeros(3)]) * time) @ [*x, u])[:2]

    def held(self, law: Any, times: Any, period: float) -> Any:
        """Return states and input at `times` with an input that changes at the start of each period."""
        x, u, last, rows, k = np.zeros(2), 0.0, 0.0, list[Any](), 0
        for t in times:
            while k * period < t - 1e-9:
                x, last = self.after(k * period - last, x, u), k * period
                u, k = law(x, u), k + 1
            x, last = self.after(t - last, x, u), t
            rows.append([*x, u])
        return np.array(rows)


def linear(rng: Any, folder: Path, unseen: bool = False) -> Case:
    """Return two to four blocks with two to six signals between them: stiff, with feedthrough or unstable, by lot."""
    while True:
        n = int(rng.integers(2, 5))
        blocks: list[Any] = []
        stiff = rng.random() < 0.3 and not unseen
        for i in range(n):
            A = rng.normal(size=(3, 3))
            rate = 10 ** rng.uniform(-0.3, 0.7) * (10 ** rng.uniform(1, 2) if stiff and i == 0 else 1.0)
            A *= rate / np.abs(np.linalg.eigvals(A)).max()
            A -= (max(np.linalg.eigvals(A).real.max(), 0.0) + 0.1 * rate) * np.eye(3)
            gain = 10 ** rng.uniform(-0.5, 0.5) * rate**0.5
            blocks.append([A, rng.normal(size=(3, 2)) * gain, rng.normal(size=(2, 3)), np.zeros((2, 2))])
        free = [(i, k) for i in range(n) for k in range(1 if unseen else 2)]  # unseen: nothing reads the second outputs
        wires: dict[tuple[int, int], tuple[int, int]] = {}
        for j in range(int(rng.integers(2, 2 * n + 1))):
            i, k = free[int(rng.integers(len(free)))]
            to = (i + int(rng.integers(1, n))) % n if j != 1 else next(iter(wires.values()))[0]
            wires.setdefault((to, int(rng.integers(2))), (i, k))
        fed = {i for i, _ in wires.values()} | {i for i, _ in wires}
        if unseen:
            for i in range(n):
                blocks[i][3][1] = rng.normal(size=2)
        elif rng.random() < 0.4:  # an output depends on an input, without an algebraic loop
            for to, source in wires.items():
                if to[0] > source[0]:
                    blocks[to[0]][3][1, to[1]] = 0.7 * rng.normal()
        A, B, C, D = (np.array(block_diag(*(block[k] for block in blocks))) for k in range(4))
        L = np.zeros((2 * n, 2 * n))
        for (to, u), (source, y) in wires.items():
            L[2 * to + u, 2 * source + y] = 1.0
        loops = np.abs(np.linalg.eigvals(D @ L)).max()
        (closed, outputs), start = closed_loop(A, B, C, D, L), rng.normal(size=3 * n)
        rates = np.sort(np.abs(np.linalg.eigvals(closed)))
        if fed == {*range(n)} and loops < 1e-9 and np.linalg.eigvals(closed).real.max() < 1.0:
            break
    values = {f"c{i}.{name}": block[k] for i, block in enumerate(blocks) for k, name in enumerate("ABCD")}
    values |= {f"c{i}.x_0": start[3 * i : 3 * i + 3] for i in range(n)}
    pairs = [(f"c{a}.y[{b + 1}]", f"c{to}.u[{u + 1}]") for (to, u), (a, b) in wires.items()]
    system = vdfmu.connect({f"c{i}": Block for i in range(n)}, pairs, parameters=values, algorithm="jacobi")
    names = [f"c{i}.y[{k}]" for i in range(n) for k in (1, 2)] + [f"c{i}.x[{k}]" for i in range(n) for k in (1, 2, 3)]

    def exact(times: Any, results: Any) -> Any:
        x = solved(lambda t, x: closed @ x, start, times)
        return np.column_stack([x @ outputs.T, x])

    rate = rates[len(rates) // 2] if stiff else rates[-1]
    stop = min(5.0, 3.0 / max(float(rates[0]), 0.6))
    coarse, fine = (int(max(16, stop * rate / share)) for share in (0.3, 0.02))
    return Case(system, names, stop, exact, (coarse, fine))


def unseen(rng: Any, folder: Path) -> Case:
    """Return blocks with outputs that nothing reads, and that depend on their inputs directly."""
    return linear(rng, folder, unseen=True)


def tone(rng: Any, folder: Path) -> Case:
    """Return a tone above the rate of the steps, or near it, and a lag: a multiple of it in half of the systems."""
    a, stop, n = 10 ** rng.uniform(0.0, 1.0), 5.0, 400
    f = n / stop * (rng.integers(1, 17) if rng.random() < 0.5 else rng.uniform(0.4, 16.0))
    phi, w = rng.uniform(0.0, 6.28), 2.0 * np.pi * f
    system = vdfmu.connect(
        {"tone": Tone, "lag": Lag}, {"tone.y": "lag.u"}, parameters={"tone.f": f, "tone.phi": phi, "lag.T": 1.0 / a}
    )

    def exact(times: Any, results: Any) -> Any:
        forced = (a / (a + 1j * w) * np.exp(1j * (w * times + phi))).imag
        y = forced - forced[0] * np.exp(-a * times)
        return np.column_stack([np.sin(w * times + phi), y])

    return Case(system, ["tone.y", "lag.y"], stop, exact, (400, 800))


def delay(rng: Any, folder: Path) -> Case:
    """Return a slow tone, a delay of whole milliseconds, and a lag."""
    a, f, late = 10 ** rng.uniform(0.0, 1.0), rng.uniform(0.1, 0.5), int(rng.integers(50, 900))
    system = vdfmu.connect(
        {"tone": Tone, "delay": build(DELAY, "3.0", folder), "lag": Lag}, {"tone.y": "delay.u", "delay.y": "lag.u"},
        parameters={"tone.f": f, "delay.n": float(late), "lag.T": 1.0 / a},
    )  # fmt: skip
    w = 2.0 * np.pi * f

    def exact(times: Any, results: Any) -> Any:
        t = np.maximum(times - 1e-3 * late, 0.0)
        forced: Any = (a / (a + 1j * w) * np.exp(1j * w * t)).imag
        return np.column_stack([np.sin(w * times), np.sin(w * t), forced - (a / (a + 1j * w)).imag * np.exp(-a * t)])

    return Case(system, ["tone.y", "delay.y", "lag.y"], 5.0, exact, (50, 250))


def hidden(rng: Any, folder: Path) -> Case:
    """Return a law that samples and does not say so, and two lags."""
    room, K = House(rng), 10 ** rng.uniform(-0.5, 0.5)
    period = 1e-3 * int(1e3 * room.stop / 10 ** rng.uniform(1.0, 2.5))
    stop = period * int(room.stop / period)
    system = vdfmu.connect(
        {"law": build(HIDDEN, "3.0", folder), "room": Lags}, {"law.y": "room.u", "room.y": "law.u"},
        parameters={"law.K": K, "law.period": period, **room.values},
    )  # fmt: skip

    def exact(times: Any, results: Any) -> Any:
        rows = room.held(lambda x, u: K * (1.0 - x[1]), times, period)
        rows[0, 2] = K
        return rows

    return Case(system, ["room.z", "room.y", "law.y"], stop, exact)


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
        closed, outputs = closed_loop(A, B, C, D, L)
        if np.linalg.eigvals(closed).real.max() < 1.0:
            break
    piece = build(PIECE, "3.0", folder)
    system = vdfmu.connect(
        dict.fromkeys("abc", piece) | {"lag": Lag},
        {"a.s_out": "b.s", "b.s_out": "c.s", "c.r": "b.f", "b.r": "a.f", "c.s_out": "lag.u", "lag.y": "a.s"},
        parameters={f"{x}.{name}": pieces[i, k] for i, name in enumerate(NUMBERS) for k, x in enumerate("abc")}
        | {"lag.T": 1.0 / rate},
    )  # fmt: skip

    def exact(times: Any, results: Any) -> Any:
        x = solved(lambda t, x: closed @ x, [1.0, 1.0, 1.0, 0.0], times)
        return np.column_stack([x @ outputs.T, x[:, :3]])

    names = [f"{x}.{name}" for x in "abc" for name in ("s_out", "r")] + ["lag.y", "a.x", "b.x", "c.x"]
    return Case(system, names, 4.0 / np.abs(np.linalg.eigvals(closed)).max() ** 0.5, exact, (20, 200))
