"""Content of the page of a run: the arm, figures and recorded signals, thinned and packed for a browser.

A figure or a group of signals has its own rows: every k-th of the run, and rows of the smallest and largest values
between them, so that no peak is lost. Numbers are single precision, calculated in double; they are from these
rows, never between them.
"""

from __future__ import annotations

import itertools
from collections.abc import Container, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from vdfmu.base.arrays import extremes, with_named
from vdfmu.base.errors import VdfmuError
from vdfmu.base.measure import JOINT_UNITS, Shown, shown_as
from vdfmu.engine.package.read import load_ssp
from vdfmu.engine.plan.check import check_system
from vdfmu.engine.results.figure import Curve, Figure, Terms, signal_figures
from vdfmu.engine.results.results import Results
from vdfmu.study.report.curves import CurveTable, recipes_of, values_of
from vdfmu.study.report.shapes import FRAMES, ArmFrames
from vdfmu.study.run.scene import BASE

EXTREMES = 1000
"""Stretches whose smallest and largest values are kept, shared among the curves of a figure."""
_BLOCK = 20_000
"""Rows that are in memory at a time."""


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
"""Curves of each joint [rad or m; link-side N.m or N; W]: factors of arrays of signals.

The last two are for joints that are components, see `wired_arm`: power and axial force on the link.
"""
MOTOR_SIDE = ("controller.tau", "feedforward.tau_m")
"""Signals that are multiplied by the reduction ratio."""
_FRAMES = ("q", "error", "torque", "torsion", "power", "force")
"""Curves that the drawn arm shows."""
_FIGURES = (
    ("position", "position", "Joint positions, desired dashed", "", {"q": "q", "q_d": "q_d"}),
    ("tracking", "position", "Position tracking errors: q_d − q", "Tracking error", {"error": ""}),
    ("torque", "torque", "Control {}s, feedforward dashed, link side", "Control {}",
     {"torque": "ℓτ", "feedforward": "ℓτ_m"}),
    ("compensation", "torque", "{} compensation errors: ℓ(τ − τ_m)", "{} compensation error", {"compensation": ""}),
    ("torsion", "position", "Torsion of the drives: κ − q", "Torsion", {"torsion": ""}),
)  # fmt: skip
"""Key, quantity of the joint, title, name of the largest value, and sums: solid, then dashed.

{} becomes torque or force. The unit follows from the quantity, see `vdfmu.base.measure.unit_of`.
"""


WRENCHES = {
    "F_e": ("of the arm on its surroundings in {O}", "wrench of {} on its surroundings"),
    "F_S": ("of the base on the arm in {S}", "wrench of the base on {}"),
}
"""Six signals, force and moment: words for a title, and for the arrow."""


def content_of(results: Results, summary: Mapping[str, Any]) -> dict[str, Any]:
    """Return the content of the page of a run, ready for JSON.

    ``arm``: see :func:`vdfmu.study.report.shapes.drawing_of`, None without one. ``frames``: time and, for the arm,
    joint positions, tracking errors, control torques and torsion at every k-th row. ``figures`` and ``signals``: lists
    of figures, with rows, time and values as base64 of little-endian numbers, curve by curve.
    """
    arms = _arms(results, summary)
    n = len(summary["arm"]["types"]) if "arm" in summary else int(summary.get("joints", 0))
    m, parts = len(results), -(-len(results) // _BLOCK)
    stride = max(1, -(-(m - 1) // FRAMES))
    objects = summary.get("scene", {}).get("objects", []) if arms else []
    turns = {one["turn"]: [[(1.0, one["turn"])]] for one in objects if one.get("turn") in results.names}
    moving = [
        ArmFrames(name, arm, motion | ({} if k else turns), m) for k, (name, arm, motion, _) in enumerate(arms)
    ] or [ArmFrames("", None, {}, m)]
    tables = {
        "figures": [CurveTable(figure) for figure in run_figures(results, summary)],
        "signals": [CurveTable(figure) for figure in signal_figures(results, (), n)],
    }
    for k, part in enumerate(results.blocks(_BLOCK)):
        for each in moving:
            each.add(part, k * _BLOCK)
        even = np.arange(-k * _BLOCK % stride, len(part), stride)  # every k-th row of the whole
        if k == parts - 1:
            even = np.unique(np.append(even, len(part) - 1))
        for table in itertools.chain(*tables.values()):
            values = values_of(table.curves, part, table.factor)
            buckets = max(1, EXTREMES // (len(values) * parts))
            rows = [even, *(extremes(row, buckets) for row in values)]
            table.add(part.time, [values], np.unique(np.concatenate(rows)))
    first, *more = [each.packed() for each in moving]
    return {
        **first,
        "more": more,
        "objects": objects,
        **{
            kind: [table.packed(["values"]) | {"recipes": recipes_of(table.curves, table.factor)} for table in found]
            for kind, found in tables.items()
        },
    }


def run_figures(results: Results, summary: Mapping[str, Any]) -> Iterator[Figure]:
    """Yield the figures of a run: of each arm, of forces in the scene, and of cutting points."""
    arms = _arms(results, summary)
    for k, (name, arm, _, sums) in enumerate(arms):
        yield from _figures(f"{name}." if k else "", f"{name}: " if len(arms) > 1 else "", arm, sums)
    yield from _force_figures(results, summary)
    yield from _cutting_points(results)


def _arms(results: Results, summary: Mapping[str, Any]) -> list[tuple[str, Any, Any, Any]]:
    """Return the arms whose positions were recorded: component, facts, what is drawn, and sums."""
    known = summary.get("scene", {}).get("arms") or []
    if not known and "arm" in summary:
        known = [summary["arm"] | {"component": "plant", "signals": summary.get("joint_signals", {})}]
    names, found = {*results.names}, []
    for k, arm in enumerate(known):
        signals = {key: each for key, each in arm["signals"].items() if names.issuperset(each)}
        if k == 0:  # of a system that says no more, by the names of the shipped ones
            of_names = {name for terms in SUMS.values() for _, name in terms}
            signals = {name: each for name in of_names if (each := _joints(results, name, len(arm["ell"])))} | signals
        sums = _sums(arm["ell"], signals)
        if "q" in sums:
            found.append((arm["component"], arm, _motion(arm, sums, names), sums))
    return found


def _motion(arm: Mapping[str, Any], sums: Mapping[str, Any], names: Container[str]) -> dict[str, Any]:
    """Return what a drawn arm shows: of its joints, of its base, and the wrenches that act on it."""
    constants: Mapping[str, float] = arm.get("constants", {})
    found = {key: arm["signals"][key] for key in (BASE, *WRENCHES) if key in arm["signals"]}
    if arm.get("mounted"):
        found.pop(BASE, None)
    return {name: sums[name] for name in _FRAMES if name in sums} | {
        key: [[(1.0, name) if name in names else (constants.get(name, 0.0), "")] for name in each]
        for key, each in found.items()
        if any(name in names or name in constants for name in each)
    }


def _joints(results: Results, name: str, n: int) -> list[str]:
    """Return the signals of an array with an element a joint; empty if it was not recorded."""
    group = results.groups.get(name, {})
    return [group[index] for index in sorted(group)] if group and results.shape_of(name) == (n,) else []


def _sums(ell: Sequence[float], signals: Mapping[str, Sequence[str]]) -> dict[str, list[Terms]]:
    """Return the sums of `SUMS` whose signals there are, joint by joint."""
    return {
        key: [
            [(factor * (r if name in MOTOR_SIDE else 1.0), signals[name][i]) for factor, name in terms]
            for i, r in enumerate(ell)
        ]
        for key, terms in SUMS.items()
        if all(name in signals for _, name in terms)
    }


def _figures(before: str, of: str, arm: Mapping[str, Any], sums: Mapping[str, Sequence[Terms]]) -> Iterator[Figure]:
    """Yield positions, torques, their errors and torsion; joints of other units in figures of their own.

    `before` and `of` stand before keys and titles.
    """
    types: Sequence[str] = arm["types"]
    for kind, unit in JOINT_UNITS.items():
        joints = [i for i, each in enumerate(types) if each == kind]
        suffix = f", {kind}" if len(set(types)) > 1 else ""
        for key, quantity, title, peak, drawn in _FIGURES:
            noun = unit.noun.capitalize() if title.startswith("{}") else unit.noun
            curves = [
                Curve(", ".join(filter(None, (f"joint {i + 1}", label))), i + 1, sums[name][i], dashed=place > 0)
                for place, (name, label) in enumerate(drawn.items())
                if name in sums
                for i in joints
            ]
            if curves:
                words = [of + f"{text}{suffix}".format(noun) if text else "" for text in (title, peak)]
                yield Figure(f"{before}{key}.{kind}", words[0], shown_as(quantity, kind), curves, words[1])


def _force_figures(results: Results, summary: Mapping[str, Any]) -> Iterator[Figure]:
    """Yield force and moment of each wrench that acts in the run, and the forces of contacts."""
    scene = summary.get("scene", {})
    names = {*results.names}
    for arm in scene.get("arms", []):
        for key, (words, _) in WRENCHES.items():
            signals = arm["signals"].get(key, [])
            for what, unit, part in (("Force", "N", signals[:3]), ("Moment", "N.m", signals[3:])):
                known = [(axis, name) for axis, name in zip("xyz", part, strict=False) if name in names]
                if any(np.any(part[name]) for part in results.blocks(_BLOCK) for _, name in known):
                    curves = [Curve(axis, 0, [(1.0, name)]) for axis, name in known]
                    title = f"{arm['component']}: {what.lower()} {words}"
                    yield Figure(f"{arm['component']}.{key}.{unit}", title, Shown(unit), curves, f"{what} {words}")
    for one in scene.get("objects", []):
        for name, words in one.get("forces", {}).items():
            if name in names:
                title = f"{one['component']}: {words[:1].lower()}{words[1:]}"
                yield Figure(name, title, Shown(results.units[name]), [Curve(name, 0, [(1.0, name)])], words)


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
        yield Figure("power", title, Shown("W"), curves, "Virtual power flow")
    for unit, axis, noun in (("N.m", 6, "Moments about"), ("N", 3, "Forces along")):
        own = [(k, name) for k, name in enumerate(names, 1) if results.units.get(f"{name}.tau_s") == unit]
        curves = [Curve(name, k, [(1.0, signal)]) for k, name in own if (signal := f"{name}.F_B[{axis}]") in results]
        if curves:
            yield Figure(f"force.{unit}", f"{noun} the axes between joint and link {{B}}", Shown(unit), curves)


_POWER = ".P_B"


def joints_of(results: Results) -> list[str]:
    """Return the components that are joints, by the virtual power flow that they show."""
    return [group.removesuffix(_POWER) for group in results.groups if group.endswith(_POWER)]


def wired_arm(results: Results, package: Path) -> dict[str, Any]:
    """Return the entry ``arm`` of the summary, and ``joint_signals``: name of an array to its joints' signals.

    Empty if no joints were recorded, or if they are not one chain, which alone is drawn.
    """
    names = joints_of(results)
    if not names or not package.is_file():
        return {}
    try:
        checked = check_system(load_ssp(package))
    except VdfmuError:  # the page is of the results; what is wrong with the package, a run says
        return {}
    feeds = {link.end: link.start[0] for link in checked.links}
    links = {name: feeds.get((name, "V_A[1]"), "") for name in names}
    after = {feeds.get((link, "V_B[1]"), ""): name for name, link in links.items()}
    if len(after) < len(names) or not (order := [after[one] for one in after if one not in names]):
        return {}
    while order[-1] in after:
        order.append(after[order[-1]])
    end = next((end[0] for end, start in feeds.items() if start == order[-1] and end[1] == "V_B[1]"), "")
    tool, base = feeds.get((end, "p_C[1]"), ""), links[order[0]]
    values = {name: {v.name: value for v, value in each} for name, each in checked.starts.items()}

    def array(component: str, group: str, default: Any) -> Any:
        return with_named(default, group, values.get(component, {})).tolist()

    arm = {
        "types": ["prismatic" if results.units[f"{name}.q"] == "m" else "revolute" for name in order],
        "rotation": [array(name, "rotation", np.eye(3)) for name in order],
        "offset": [array(name, "offset", np.zeros(3)) for name in order],
        "ell": [array(name, "ell", 1.0) for name in order],
        "tool_offset": array(tool, "tool_offset", np.zeros(3)),
        "tool_rotation": array(tool, "tool_rotation", np.eye(3)),
        "gravity": array(base, "gravity", np.array([0.0, 0.0, 9.81])),
        "shapes": [],
    }
    signals = {f"plant.{group}": [f"{name}.{group}" for name in order] for group in ("q", "kappa", "P_B")}
    axes = {"revolute": 6, "prismatic": 3}
    signals["plant.F_z"] = [f"{name}.F_B[{axes[kind]}]" for name, kind in zip(order, arm["types"], strict=True)]
    return {"arm": arm, "joint_signals": {key: each for key, each in signals.items() if set(each) <= {*results.names}}}
