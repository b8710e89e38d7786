"""Content of the page of a run: arms, figures and recorded signals, thinned and packed for a browser.

A figure or a group of signals has its own rows: every k-th row of the run, and the rows of the smallest and largest
values between them, so that no peak is lost. Numbers are taken from these rows without interpolation, calculated in
double and stored in single precision. Pictures are files with the same figures.
"""

from __future__ import annotations

import itertools
from collections.abc import Container, Iterable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from vdfmu.base.arrays import Floats, bends, distinct, extremes
from vdfmu.base.measure import JOINT_TYPES, Shown, shown_as
from vdfmu.engine.results.figure import Curve, Figure, Terms, signal_figures
from vdfmu.engine.results.folder import DRAWN, picture_module
from vdfmu.engine.results.results import Recorded, Results, Signal
from vdfmu.study.report.scripts import packed
from vdfmu.study.run.joint_components import BASE, joints_of

if TYPE_CHECKING:
    from vdfmu.arm.robot import Robot

EXTREMES = 1000
"""Number of stretches whose smallest and largest values are kept, shared among the curves of a figure."""
FRAMES = 1000
"""Most intervals between the equidistant rows shared by an arm's drawing and all figures."""
_MORE = 500
"""Most rows in between that are also drawn while the arm moves."""
_LEAST = 1e-5
"""Invisible deviation of a joint [rad], or of the base or a prismatic joint relative to the arm's reach."""


SUMS: Mapping[str, Terms] = {
    "q": [(1.0, "plant.q")],
    "q_d": [(1.0, "trajectory.q_d")],
    "error": [(1.0, "trajectory.q_d"), (-1.0, "plant.q")],
    "torque": [(1.0, "controller.tau")],
    "feedforward": [(1.0, "feedforward.tau_m")],
    "compensation": [(1.0, "controller.tau"), (-1.0, "feedforward.tau_m")],
    "torsion": [(1.0, "plant.kappa"), (-1.0, "plant.q")],
    "power": [(1.0, "plant.P_B")],
    "force": [(1.0, "plant.F_z")],
}
"""Curves of each joint [rad or m; link-side N.m or N; W], as factors of arrays of signals.

The last two are for joints that are components: power and axial force on the link.
"""
MOTOR_SIDE = ("controller.tau", "feedforward.tau_m")
"""Signals that are multiplied by the reduction ratio."""
_FRAMES = ("q", "error", "torque", "torsion", "power", "force")
"""Curves shown with the drawn arm."""
_FIGURES = (
    ("tracking", "position", "Position tracking errors: q_d − q", {"error": ""}),
    ("torque", "torque", "Control {}s, feedforward dashed, link side",
     {"torque": "ℓτ", "feedforward": "ℓτ_m"}),
    ("compensation", "torque", "{} compensation errors: ℓ(τ − τ_m)", {"compensation": ""}),
    ("torsion", "position", "Torsion of the drives: κ − q", {"torsion": ""}),
    ("position", "position", "Joint positions, desired dashed", {"q": "q", "q_d": "q_d"}),
)  # fmt: skip
"""Key, quantity of the joint, title, and sums: solid, then dashed.

{} becomes torque or force. The unit follows from the quantity, see `vdfmu.base.measure.unit_of`.
"""


WRENCHES = {"F_e": "of the arm on its surroundings in {O}", "F_S": "of the base on the arm in {S}"}
"""Wrenches, six signals each, to words for a title."""
_CURVES = 12
"""Most curves in a figure of unrelated signals."""
BLOCK = 20_000
"""Number of rows in memory at a time."""


class DrawnArm(NamedTuple):
    """An arm whose positions were recorded."""

    component: str
    facts: Mapping[str, Any]
    """See :func:`vdfmu.study.run.scene.arm_of`."""
    sums: Mapping[str, Sequence[Terms]]
    """Curves of `SUMS`, joint by joint."""
    motion: Mapping[str, Sequence[Terms]]
    """Signals that are drawn: of its joints, of its base, and the wrenches acting on it."""


def drawn_arms(results: Results, summary: Mapping[str, Any]) -> list[DrawnArm]:
    """Return the arms whose positions were recorded."""
    tables = summary.get("scene", {}).get("arms") or []
    if not tables and "arm" in summary:
        tables = [summary["arm"] | {"component": "plant", "signals": summary.get("joint_signals", {})}]
    names, arms = {*results.names}, list[DrawnArm]()
    for k, arm in enumerate(tables):
        signals = {key: each for key, each in arm["signals"].items() if names.issuperset(each)}
        if k == 0:  # in a system without a scene, by the names in the shipped ones
            of_names = {name for terms in SUMS.values() for _, name in terms}
            signals = {name: each for name in of_names if (each := _joints(results, name, len(arm["ell"])))} | signals
        sums: dict[str, list[Terms]] = {
            key: [
                [(factor * (ell if name in MOTOR_SIDE else 1.0), signals[name][i]) for factor, name in terms]
                for i, ell in enumerate(arm["ell"])
            ]
            for key, terms in SUMS.items()
            if all(name in signals for _, name in terms)
        }
        if "q" in sums:
            arms.append(DrawnArm(arm["component"], arm, sums, _motion(arm, sums, names)))
    return arms


def _motion(arm: Mapping[str, Any], sums: Mapping[str, Any], names: Container[str]) -> dict[str, Any]:
    constants: Mapping[str, float] = arm.get("constants", {})
    groups = {key: arm["signals"].get(key, ()) for key in ([] if arm.get("mounted") else [BASE]) + [*WRENCHES]}
    return {name: sums[name] for name in _FRAMES if name in sums} | {
        key: [[(1.0, name) if name in names else (constants.get(name, 0.0), "")] for name in group]
        for key, group in groups.items()
        if any(name in names or name in constants for name in group)
    }


def _joints(results: Results, name: str, n: int) -> list[str]:
    """Return the signals of an array with one element per joint; empty if it was not recorded."""
    group = results.groups.get(name, {})
    return [group[index] for index in sorted(group)] if group and results.shape_of(name) == (n,) else []


def run_figures(results: Results, summary: Mapping[str, Any]) -> Iterator[Figure]:
    """Yield the figures of a run: for touched objects, estimates and cutting points, each arm and its wrenches."""
    arms = drawn_arms(results, summary)
    yield from _contact_figures(results, summary)
    yield from _estimate_figures(results, summary)
    yield from _cutting_points(results)
    for k, arm in enumerate(arms):
        before, of = f"{arm.component}." if k else "", f"{arm.component}: " if len(arms) > 1 else ""
        yield from _arm_figures(before, of, arm.facts["types"], arm.sums)
    yield from _wrench_figures(results, summary)


def _arm_figures(before: str, of: str, types: Sequence[str], sums: Mapping[str, Sequence[Terms]]) -> Iterator[Figure]:
    """Yield figures of an arm by type of joint; `before` and `of` are prefixes of keys and titles."""
    for kind, joint_type in JOINT_TYPES.items():
        joints = [i for i, each in enumerate(types) if each == kind]
        suffix = f", {kind}" if len(set(types)) > 1 else ""
        for key, quantity, title, drawn in _FIGURES:
            noun = joint_type.noun.capitalize() if title.startswith("{}") else joint_type.noun
            curves = [
                Curve(", ".join(filter(None, (f"joint {i + 1}", label))), i + 1, sums[name][i], dashed=place > 0)
                for place, (name, label) in enumerate(drawn.items())
                if name in sums
                for i in joints
            ]
            if curves:
                words = of + f"{title}{suffix}".format(noun)
                yield Figure(f"{before}{key}.{kind}", words, shown_as(quantity, kind), curves)


def _wrench_figures(results: Results, summary: Mapping[str, Any]) -> Iterator[Figure]:
    """Yield the force and moment of each wrench that acts in the run."""
    names = {*results.names}
    for arm in summary.get("scene", {}).get("arms", []):
        for key, words in WRENCHES.items():
            signals = arm["signals"].get(key, [])
            for noun, unit, part in (("Force", "N", signals[:3]), ("Moment", "N.m", signals[3:])):
                axes = [(axis, name) for axis, name in zip("xyz", part, strict=False) if name in names]
                if any(np.any(rows[name]) for rows in results.blocks(BLOCK) for _, name in axes):
                    curves = [Curve(axis, 0, [(1.0, name)]) for axis, name in axes]
                    title = f"{arm['component']}: {noun.lower()} {words}"
                    yield Figure(f"{arm['component']}.{key}.{unit}", title, Shown(unit), curves)


def _contact_figures(results: Results, summary: Mapping[str, Any]) -> Iterator[Figure]:
    """Yield the forces of contacts."""
    for drawn in summary.get("scene", {}).get("objects", []):
        for name, words in drawn.get("forces", {}).items():
            if name in results and results.units[name] != "m":
                title = f"{drawn['component']}: {words[:1].lower()}{words[1:]}"
                yield Figure(name, title, Shown(results.units[name]), [Curve(name, 0, [(1.0, name)])])


def _estimate_figures(results: Results, summary: Mapping[str, Any]) -> Iterator[Figure]:
    """Yield estimated torques together with the true ones."""
    names = {*results.names}
    for each in summary.get("scene", {}).get("estimates", []):
        for unit in dict.fromkeys(results.units[name] for name in each["signals"] if name in names):
            curves = [
                Curve(f"joint {k}{label}", k, [(1.0, signal)], dashed=bool(label))
                for group, label in (("signals", ""), ("true", ", true"))
                for k, signal in enumerate(each[group], 1)
                if signal in names and results.units[signal] == unit
            ]
            words = each["words"].partition(",")[0]
            title = f"Estimated {words[:1].lower()}{words[1:]}; true dashed"
            yield Figure(f"estimate.{each['component']}.{each['group']}.{unit}", title, Shown(unit), curves)


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
        yield Figure("power", title, Shown("W"), curves)
    for unit, axis, noun in (("N.m", 6, "Moments about"), ("N", 3, "Forces along")):
        joints = [(k, name) for k, name in enumerate(names, 1) if results.units.get(f"{name}.tau_s") == unit]
        curves = [Curve(name, k, [(1.0, signal)]) for k, name in joints if (signal := f"{name}.F_B[{axis}]") in results]
        if curves:
            yield Figure(f"force.{unit}", f"{noun} the axes between joint and link {{B}}", Shown(unit), curves)


def _overlaid(results: Results) -> Iterator[Figure]:
    """Yield the outputs of a system without an arm, those with the same unit of measurement in one figure."""
    alike: dict[str, dict[str, str]] = {}
    for group, members in results.groups.items():
        for _, name in sorted(members.items()):
            alike.setdefault(results.units[name], {})[name] = group
    for unit, names in alike.items():
        if len(names) > _CURVES:
            continue
        groups = list(dict.fromkeys(names.values()))
        curves = [
            Curve(name.removeprefix(groups[0]) if len(groups) == 1 < len(names) else name, 0, [(1.0, name)])
            for name in names
        ]
        yield Figure(f"unit.{unit}", ", ".join(groups), Shown(unit), curves)


def content_of(results: Results, summary: Mapping[str, Any]) -> dict[str, Any]:
    """Return the content of the page of a run, ready for JSON.

    ``arm``: see :func:`vdfmu.study.report.shapes.drawing_of`, None without one. ``frames``: time and, for the arm,
    joint positions, tracking errors, control torques and torsion at every k-th row. ``figures`` and ``signals``: lists
    of figures, with rows, time and values as base64 of little-endian numbers, curve by curve.
    """
    arms = drawn_arms(results, summary)
    n = len(summary["arm"]["types"]) if "arm" in summary else int(summary.get("joints", 0))
    m, parts = len(results), -(-len(results) // BLOCK)
    stride = max(1, -(-(m - 1) // FRAMES))
    objects = summary.get("scene", {}).get("objects", []) if arms else []
    turns = {each["turn"]: [[(1.0, each["turn"])]] for each in objects if each.get("turn") in results.names}
    moving = [
        ArmFrames(arm.component, arm.facts, {**arm.motion, **({} if k else turns)}, m) for k, arm in enumerate(arms)
    ] or [ArmFrames("", None, {}, m)]
    figures = [*run_figures(results, summary)] or [*_overlaid(results)]
    kinds = {"figures": figures, "signals": signal_figures(results, (), n)}
    tables = {kind: [CurveTable(figure) for figure in figures] for kind, figures in kinds.items()}
    for k, part in enumerate(results.blocks(BLOCK)):
        for each in moving:
            each.add(part, k * BLOCK)
        even = np.arange(-k * BLOCK % stride, len(part), stride)  # every k-th row of the whole
        if k == parts - 1:
            even = distinct(even, [len(part) - 1])
        for table in itertools.chain(*tables.values()):
            values = values_of(table.curves, part, table.factor)
            buckets = max(1, EXTREMES // (len(values) * parts))
            rows = [even, *(extremes(row, buckets) for row in values)]
            table.add(part.time, [values], distinct(*rows))
    first, *more = [each.packed() for each in moving]
    packs = {
        kind: [table.packed(["values"]) | {"recipes": recipes_of(table.curves, table.factor)} for table in group]
        for kind, group in tables.items()
    }
    return {**first, "more": more, "objects": objects, **packs}


class ArmFrames:
    """The drawing of an arm, and its motion as rows between which it moves linearly in joint space.

    `name` is its component, `arm` the facts of :func:`vdfmu.study.run.scene.arm_of`, or None for only times. `motion`
    has q and the curves drawn with it; ``base``: position and rotation of its base, row by row.
    """

    def __init__(self, name: str, arm: Mapping[str, Any] | None, motion: Mapping[str, Sequence[Terms]], m: int) -> None:
        self._name, self._arm, self._m = name, arm, m
        self.motion = {key: [Curve("", 0, terms) for terms in each] for key, each in motion.items()}
        self._table = CurveTable()
        self._distances: list[Floats] = []
        self._stride = max(1, -(-(m - 1) // FRAMES))
        if arm:
            from vdfmu.study.report.shapes import Chain  # the equations of arms take long to import

            self._travel, reach = np.zeros(len(arm["types"])), Chain(arm).reach
            scale = [1.0 / reach if JOINT_TYPES[kind].slides else 1.0 for kind in arm["types"]]
            self._scale = np.array([*scale, *([1.0 / reach] * 3 + [1.0] * 9 if "base" in motion else [])])[:, None]

    def add(self, part: Results, first: int) -> None:
        """Add a stretch of the run that begins with row `first`."""
        last = len(part) - 1
        ends = [0, last] if self._arm else [last] if first + last == self._m - 1 else []
        even = distinct(np.arange(-first % self._stride, last + 1, self._stride), np.array(ends, int))
        moved = {name: values_of(curves, part) for name, curves in self.motion.items()}
        rows, distances = even, np.full(len(even), np.inf)
        if self._arm:
            self._travel = np.maximum(self._travel, np.abs(moved["q"]).max(axis=1))
            if self._stride > 1:
                shown = self._scale * np.concatenate([moved["q"], *([moved["base"]] if "base" in moved else [])])
                more, far = bends(part.time, shown, even, _MORE, _LEAST)
                rows, distances = np.append(even, more), np.append(distances, far)
                order = np.argsort(rows)
                rows, distances = rows[order], distances[order]
        self._distances.append(distances)
        self._table.add(part.time, [*moved.values()], rows)

    def packed(self) -> dict[str, Any]:
        """Return the name, the drawing, and frames including the rows of the largest deviations, ready for JSON."""
        drawing = None
        if self._arm:
            from vdfmu.study.report.shapes import drawing_of  # takes long to import

            drawing = drawing_of(self._arm, self._travel)
        distances = np.concatenate(self._distances)
        most = int(np.isinf(distances).sum()) + _MORE
        kept: NDArray[np.intp] = np.sort(np.argsort(-distances, kind="stable")[:most])
        recipes = {name: recipes_of(curves) for name, curves in self.motion.items()}
        return {
            "component": self._name,
            "mounted": (self._arm or {}).get("mounted", ""),
            "arm": drawing,
            "frames": self._table.packed([*self.motion], kept) | {"recipes": recipes},
        }


class CurveTable:
    """Rows of curves, collected stretch by stretch."""

    def __init__(self, figure: Figure | None = None) -> None:
        self._facts: dict[str, Any] = {}
        self.curves, self.factor = (figure.curves, figure.quantity.factor) if figure else ((), 1.0)
        if figure:
            self._facts = {"key": figure.key, "title": figure.title, "unit": figure.quantity.unit}
            self._facts["curves"] = [[curve.label, curve.joint, int(curve.dashed)] for curve in self.curves]
        self._time: list[Floats] = []
        self._parts: list[list[Floats]] = []

    def add(self, time: Floats, arrays: Sequence[Floats], rows: NDArray[np.intp]) -> None:
        """Add the rows of arrays (curves, m)."""
        self._time.append(time[rows])
        self._parts.append([array[:, rows] for array in arrays])

    def packed(self, names: Sequence[str], rows: Any = slice(None)) -> dict[str, Any]:
        """Return the description of the figure, its times at `rows`, and the arrays by name, curve by curve."""
        joined = (np.hstack(array)[:, rows] for array in zip(*self._parts, strict=True))
        return {
            **self._facts,
            "time": packed(np.concatenate(self._time)[rows], "<f8"),
            **{name: packed(array, "<f4") for name, array in zip(names, joined, strict=True)},
        }


def values_of(curves: Iterable[Curve], results: Results, factor: float = 1.0) -> Floats:
    """Return the values of curves times a factor: (curves, m)."""
    return np.array([curve.values(results, factor) for curve in curves])


def recipes_of(curves: Iterable[Curve], factor: float = 1.0) -> list[Any]:
    """Return, for the page, how curves follow from signals: a factor, and factors and signals."""
    return [[factor, [*map(list, curve.terms)]] for curve in curves]


TOOL = Figure("tool", "Tool position errors", Shown("mm", 1e3), [Curve(k, 0, [(1.0, k)]) for k in "xyz"])


def tool_error(robot: Robot, results: Results) -> Recorded:
    """Return the desired position of the tool minus the actual one, in {I}: signals x, y, z [m]."""
    from vdfmu.arm.dynamics import forward_kinematics  # takes long to import

    desired, _ = forward_kinematics(robot, results["trajectory.q_d"])
    signals = [Signal(name, "real", "m", column) for column, name in enumerate("xyz")]
    return Recorded(results.time, signals, {"real": desired - results["plant.p_O"]})


def write_pictures(
    results: Results, robot: Robot | None, folder: Path, kinds: Sequence[str], width: float, serif: bool = False
) -> None:
    """Write the figures of a run, ``figure_tracking.pdf``, or its signals without any. `width` in inches."""
    if not kinds:
        return
    picture = picture_module()
    shown = results.thinned(DRAWN)
    figures = list(run_figures(shown, results.summary))
    picture.write_figures(figures, shown, folder, kinds, width, serif)
    if robot is not None and {"trajectory.q_d[1]", "plant.p_O[1]"} <= {*results.names}:
        picture.write_figures([TOOL], tool_error(robot, shown), folder, kinds, width, serif)
    elif not figures:
        picture.write_signals(shown, folder, kinds, width, serif)
