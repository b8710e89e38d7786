"""Content of the page of a run: the arm, figures and recorded signals, thinned and packed for a browser.

A figure or a group of signals has its own rows: every k-th of the run, and rows of the smallest and largest values
between them, so that no peak is lost. Numbers are single precision, calculated in double; they are from these
rows, never between them.
"""

from __future__ import annotations

import base64
import itertools
from collections.abc import Container, Iterable, Iterator, Mapping, Sequence
from functools import reduce
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from vdfmu.arm.equations.kinematics import frames
from vdfmu.arm.robot import Robot
from vdfmu.base.arrays import Floats, distinct
from vdfmu.base.thinning import extremes
from vdfmu.engine.results.recorded import Signal
from vdfmu.engine.results.results import Results
from vdfmu.study.report.joints import UNITS
from vdfmu.study.report.shapes import drawing_of
from vdfmu.study.report.wired import joints_of

FRAMES = 1000
"""Most intervals between the rows at equal distances, at which the arm is drawn."""
EXTREMES = 1000
"""Stretches whose smallest and largest values are kept, shared among the curves of a figure."""
_BLOCK = 20_000
"""Rows that are in memory at a time."""


Terms = Sequence[tuple[float, str]]
"""Factors, and names of signals."""


class Curve(NamedTuple):
    """A curve of a figure: `scale` times the sum of signals, each times its factor.

    The page evaluates the same sums for a run that it has simulated.
    """

    label: str
    joint: int
    """From 1; 0 for none."""
    terms: Terms
    """At least one."""
    scale: float = 1.0
    dashed: bool = False

    def values(self, results: Results) -> Floats:
        """Return its values: (m,)."""
        return self.scale * reduce(np.add, [factor * results[name] for factor, name in self.terms])


class Figure(NamedTuple):
    """Curves of one unit of measurement over time."""

    key: str
    title: str
    unit: str
    curves: Sequence[Curve]
    peak: str = ""
    """Name of its largest absolute value; empty if not of interest."""


SUMS: Mapping[str, Terms] = {
    "q": [(1.0, "plant.q")],
    "q_d": [(1.0, "trajectory.q_d")],
    "error": [(1.0, "trajectory.q_d"), (-1.0, "plant.q")],
    "torque": [(1.0, "controller.tau")],
    "feedforward": [(1.0, "controller.tau_m")],
    "compensation": [(1.0, "controller.tau"), (-1.0, "controller.tau_m")],
    "torsion": [(1.0, "plant.kappa"), (-1.0, "plant.q")],
    "power": [(1.0, "plant.P_B")],
    "force": [(1.0, "plant.F_z")],
}
"""Curves of each joint [rad or m; link-side N.m or N; W]: factors of arrays of signals.

The last two are for joints that are components, see `wired_arm`: power and axial force on the link.
"""
MOTOR_SIDE = ("controller.tau", "controller.tau_m")
"""Signals that are multiplied by the reduction ratio."""
_FRAMES = ("q", "error", "torque", "torsion", "power", "force")
"""Curves that the drawn arm shows."""
_FIGURES = (
    ("position", "Joint positions, desired dashed", "", {"q": "q", "q_d": "q_d"}),
    ("tracking", "Position tracking errors: q_d − q", "Tracking error", {"error": ""}),
    ("torque", "Control {}s, feedforward dashed, link side", "Control {}", {"torque": "ℓτ", "feedforward": "ℓτ_m"}),
    ("compensation", "{} compensation errors: ℓ(τ − τ_m)", "{} compensation error", {"compensation": ""}),
    ("torsion", "Torsion of the drives: κ − q", "Torsion", {"torsion": ""}),
)  # fmt: skip
"""Key, title, name of the largest value, and what is drawn: solid, then dashed; {} becomes torque or force."""


def arm_of(robot: Robot, values: Mapping[str, Any]) -> dict[str, Any]:
    """Return the facts from which a robot is drawn: geometry, ratios, and the shapes of its file except meshes.

    `values` of the plant, such as ``offset[2,3]``, count instead of the robot's.
    """

    def listed(name: str, of_file: Any) -> Any:
        numbers: Floats = np.array(of_file, dtype=float)
        for place in np.ndindex(numbers.shape):
            index = ",".join(str(i + 1) for i in place)
            numbers[place] = values.get(f"{name}[{index}]", numbers[place])
        return numbers.tolist()

    numbers = frames(robot) | {"gravity": robot.gravity, "ell": robot.ell}
    return {
        "types": list(robot.joint_types),
        **{name: listed(name, of_file) for name, of_file in numbers.items()},
        "shapes": [] if any(v.shape == "mesh" for v in robot.visuals) else [v.to_dict() for v in robot.visuals],
    }


def content_of(results: Results, summary: Mapping[str, Any]) -> dict[str, Any]:
    """Return the content of the page of a run, ready for JSON.

    ``arm``: see :func:`vdfmu.study.report.shapes.drawing_of`, None without one. ``frames``: time and, for the arm,
    joint positions, tracking errors, control torques and torsion at every k-th row. ``figures`` and ``signals``: lists
    of figures, with rows, time and values as base64 of little-endian numbers, curve by curve.
    """
    arm: Mapping[str, Any] | None = summary.get("arm")
    n = len(arm["types"]) if arm else int(summary.get("joints", 0))
    m, parts = len(results), -(-len(results) // _BLOCK)
    stride = max(1, -(-(m - 1) // FRAMES))
    sums = _sums(results, arm["ell"], summary.get("joint_signals", {})) if arm else {}
    shown = arm if "q" in sums else None
    motion = {
        name: [Curve("", i + 1, terms) for i, terms in enumerate(sums[name])]
        for name in _FRAMES
        if shown and name in sums
    }
    copies = {signal.name: signal for signal in results.signals if signal.of}
    frames, travel = _CurveTable(), np.zeros(n)
    tables = {
        "figures": [
            _CurveTable(figure)
            for figure in (*_figures(results, summary, sums if shown else {}), *_cutting_points(results))
        ],
        "signals": [_CurveTable(figure) for figure in _groups(results, n, copies)],
    }
    for k, part in enumerate(results.blocks(_BLOCK)):
        even = np.arange(-k * _BLOCK % stride, len(part), stride)  # every k-th row of the whole
        if k == parts - 1:
            even = distinct(np.append(even, len(part) - 1))
        moved = {name: _values(curves, part) for name, curves in motion.items()}
        frames.add(part.time, [*moved.values()], even)
        if shown:
            travel = np.maximum(travel, np.abs(moved["q"]).max(axis=1))
        for table in itertools.chain(*tables.values()):
            values = _values(table.curves, part)
            buckets = max(1, EXTREMES // (len(values) * parts))
            rows = [even, *(extremes(row, buckets) for row in values)]
            table.add(part.time, [values], distinct(np.concatenate(rows)))
    motion_recipes = {name: _recipes(curves, copies) for name, curves in motion.items()}
    return {
        "arm": shown and drawing_of(shown, travel),
        "frames": frames.packed(list(motion)) | {"recipes": motion_recipes},
        **{
            kind: [table.packed(["values"]) | {"recipes": _recipes(table.curves, copies)} for table in found]
            for kind, found in tables.items()
        },
        "copies": {name: signal.of for name, signal in copies.items()},
    }


class _CurveTable:
    """Rows of curves, gathered stretch by stretch."""

    def __init__(self, figure: Figure | None = None) -> None:
        self._facts: dict[str, Any] = figure._asdict() if figure else {}
        self.curves: Sequence[Curve] = self._facts.pop("curves", ())
        if figure:
            self._facts["curves"] = [[curve.label, curve.joint, int(curve.dashed)] for curve in self.curves]
        self._time: list[Floats] = []
        self._parts: list[list[Floats]] = []

    def add(self, time: Floats, arrays: Sequence[Floats], rows: NDArray[np.intp]) -> None:
        """Add the rows of arrays (curves, m)."""
        self._time.append(time[rows])
        self._parts.append([array[:, rows] for array in arrays])

    def packed(self, names: Sequence[str]) -> dict[str, Any]:
        """Return the description of the figure, its times, and the arrays by name, curve by curve."""
        joined = (np.hstack(array) for array in zip(*self._parts, strict=True))
        return {
            **self._facts,
            "time": _packed(np.concatenate(self._time), "<f8"),
            **{name: _packed(array, "<f4") for name, array in zip(names, joined, strict=True)},
        }


def _values(curves: Iterable[Curve], results: Results) -> Floats:
    """Return the values of curves: (curves, m)."""
    return np.array([curve.values(results) for curve in curves])


def _recipes(curves: Iterable[Curve], copies: Mapping[str, Signal]) -> list[Any]:
    """Return how curves come from outputs, for the page: scale; factor, signal and its delay in rows."""

    def source(name: str) -> tuple[str, int]:
        return (copies[name].of, copies[name].late) if name in copies else (name, 0)

    return [[curve.scale, [[factor, *source(name)] for factor, name in curve.terms]] for curve in curves]


def _joints(results: Results, name: str, n: int) -> list[str]:
    """Return the signals of an array with an element a joint; empty if it was not recorded."""
    group = results.groups.get(name, {})
    return [group[index] for index in sorted(group)] if group and results.shape_of(name) == (n,) else []


def _sums(results: Results, ell: Sequence[float], wired: Mapping[str, Sequence[str]]) -> dict[str, list[Terms]]:
    """Return the sums of `SUMS` whose signals were recorded, joint by joint; `wired`: those of single joints."""
    signals = {
        name: wired.get(name) or _joints(results, name, len(ell)) for terms in SUMS.values() for _, name in terms
    }
    return {
        key: [
            [(factor * (r if name in MOTOR_SIDE else 1.0), signals[name][i]) for factor, name in terms]
            for i, r in enumerate(ell)
        ]
        for key, terms in SUMS.items()
        if all(signals[name] for _, name in terms)
    }


def _figures(results: Results, summary: Mapping[str, Any], sums: Mapping[str, Sequence[Terms]]) -> Iterator[Figure]:
    """Yield positions, torques, their errors and torsion; joints of other units in figures of their own."""
    types: Sequence[str] = summary["arm"]["types"] if sums else ()
    for kind, unit in UNITS.items():
        joints = [i for i, of in enumerate(types) if of == kind]
        suffix = f", {kind}" if len(set(types)) > 1 else ""
        for key, title, peak, drawn in _FIGURES:
            torques = key in ("torque", "compensation")
            noun = unit.noun.capitalize() if title.startswith("{}") else unit.noun
            curves = [
                Curve(
                    ", ".join(filter(None, (f"joint {i + 1}", label))),
                    i + 1,
                    sums[name][i],
                    1.0 if torques else unit.factor,
                    dashed=place > 0,
                )
                for place, (name, label) in enumerate(drawn.items())
                if name in sums
                for i in joints
            ]
            if curves:
                measure = unit.torque if torques else unit.position
                words = [f"{text}{suffix}".format(noun) if text else "" for text in (title, peak)]
                yield Figure(f"{key}.{kind}", words[0], measure, curves, words[1])


def _cutting_points(results: Results) -> Iterator[Figure]:
    """Yield virtual power flows, and the forces and moments along the axes, at the cutting points of joints."""
    names = joints_of(results)
    if names:
        curves = [
            Curve(f"{name} {{{side}}}", k, [(1.0, f"{name}.P_{side}")], dashed=side == "A")
            for side in "BA"
            for k, name in enumerate(names, 1)
            if f"{name}.P_{side}" in results.names
        ]
        title = "Virtual power flow V′F towards the tip, on the side of the base {A} dashed"
        yield Figure("power", title, "W", curves, "Virtual power flow")
    for unit, axis, noun in (("N.m", 6, "Moments about"), ("N", 3, "Forces along")):
        own = [(k, name) for k, name in enumerate(names, 1) if results.units.get(f"{name}.tau_s") == unit]
        curves = [Curve(name, k, [(1.0, signal)]) for k, name in own if (signal := f"{name}.F_B[{axis}]") in results]
        if curves:
            yield Figure(f"force.{unit}", f"{noun} the axes between joint and link {{B}}", unit, curves)


def _groups(results: Results, n: int, copies: Container[str]) -> Iterator[Figure]:
    """Yield the recorded variables except copies, an array as the curves of one figure; `n` is the number of joints."""
    for group, members in results.groups.items():
        listed = [(k, name) for k, (_, name) in enumerate(sorted(members.items())) if name not in copies]
        units = dict.fromkeys(results.units[name] for _, name in listed)
        for unit in units:
            curves = [
                Curve(name.rpartition(".")[2], k + 1 if len(members) == n else 0, [(1.0, name)])
                for k, name in listed
                if results.units[name] == unit
            ]
            yield Figure(f"{group}, {unit}" if len(units) > 1 else group, group, unit, curves)


def _packed(values: NDArray[Any], kind: str) -> str:
    with np.errstate(over="ignore"):  # values beyond single precision are drawn as gaps
        return base64.b64encode(np.ascontiguousarray(values, dtype=kind).tobytes()).decode()
