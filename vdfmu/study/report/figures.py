"""The figures of a run, of each arm, of forces in the scene and of cutting points; their pictures."""

from __future__ import annotations

from collections.abc import Container, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from vdfmu.arm.dynamics import forward_kinematics
from vdfmu.arm.robot import Robot
from vdfmu.base.measure import JOINT_UNITS, Shown, shown_as
from vdfmu.engine.results.figure import Curve, Figure, Terms
from vdfmu.engine.results.folder import DRAWN
from vdfmu.engine.results.results import Recorded, Results, Signal
from vdfmu.study.run.scene import BASE, joints_of

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

The last two are for joints that are components: power and axial force on the link.
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


WRENCHES = {"F_e": "of the arm on its surroundings in {O}", "F_S": "of the base on the arm in {S}"}
"""Six signals, force and moment: words for a title."""
BLOCK = 20_000
"""Rows that are in memory at a time."""


class DrawnArm(NamedTuple):
    """An arm whose positions were recorded."""

    component: str
    facts: Mapping[str, Any]
    """See :func:`vdfmu.study.run.scene.arm_of`."""
    sums: Mapping[str, Sequence[Terms]]
    """Of `SUMS`, joint by joint."""
    motion: Mapping[str, Sequence[Terms]]
    """Its drawn values: of its joints, of its base, and the wrenches that act on it."""


def drawn_arms(results: Results, summary: Mapping[str, Any]) -> list[DrawnArm]:
    """Return the arms whose positions were recorded."""
    tables = summary.get("scene", {}).get("arms") or []
    if not tables and "arm" in summary:
        tables = [summary["arm"] | {"component": "plant", "signals": summary.get("joint_signals", {})}]
    names, arms = {*results.names}, list[DrawnArm]()
    for k, arm in enumerate(tables):
        signals = {key: each for key, each in arm["signals"].items() if names.issuperset(each)}
        if k == 0:  # of a system without a scene, by the names of the shipped ones
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
    """Return the signals of an array with an element a joint; empty if it was not recorded."""
    group = results.groups.get(name, {})
    return [group[index] for index in sorted(group)] if group and results.shape_of(name) == (n,) else []


def run_figures(results: Results, summary: Mapping[str, Any]) -> Iterator[Figure]:
    """Yield the figures of a run: of each arm, of forces in the scene, and of cutting points."""
    arms = drawn_arms(results, summary)
    for k, arm in enumerate(arms):
        before, of = f"{arm.component}." if k else "", f"{arm.component}: " if len(arms) > 1 else ""
        yield from _arm_figures(before, of, arm.facts["types"], arm.sums)
    yield from _force_figures(results, summary)
    yield from _cutting_points(results)


def _arm_figures(before: str, of: str, types: Sequence[str], sums: Mapping[str, Sequence[Terms]]) -> Iterator[Figure]:
    """Yield positions, torques, their errors and torsion; revolute and prismatic joints in separate figures.

    `before` and `of` are prefixes of keys and titles.
    """
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
        for key, words in WRENCHES.items():
            signals = arm["signals"].get(key, [])
            for noun, unit, part in (("Force", "N", signals[:3]), ("Moment", "N.m", signals[3:])):
                axes = [(axis, name) for axis, name in zip("xyz", part, strict=False) if name in names]
                if any(np.any(rows[name]) for rows in results.blocks(BLOCK) for _, name in axes):
                    curves = [Curve(axis, 0, [(1.0, name)]) for axis, name in axes]
                    title = f"{arm['component']}: {noun.lower()} {words}"
                    yield Figure(f"{arm['component']}.{key}.{unit}", title, Shown(unit), curves, f"{noun} {words}")
    for drawn in scene.get("objects", []):
        for name, words in drawn.get("forces", {}).items():
            if name in names:
                title = f"{drawn['component']}: {words[:1].lower()}{words[1:]}"
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


TOOL = Figure("tool", "Tool position errors", Shown("mm", 1e3), [Curve(k, 0, [(1.0, k)]) for k in "xyz"])


def tool_error(robot: Robot, results: Results) -> Recorded:
    """Return the desired position of the tool minus the actual one, in {I}: signals x, y, z [m]."""
    desired, _ = forward_kinematics(robot, results["trajectory.q_d"])
    signals = [Signal(name, "real", "m", column) for column, name in enumerate("xyz")]
    return Recorded(results.time, signals, {"real": desired - results["plant.p_O"]})


def write_pictures(results: Results, robot: Robot | None, folder: Path, kinds: Sequence[str], width: float) -> None:
    """Write the figures of a run, ``figure_tracking.pdf``, or its signals without any. `width` in inches."""
    if not kinds:
        return
    from vdfmu.engine.results.picture import write_figures, write_signals  # takes long to import

    shown = results.thinned(DRAWN)
    figures = list(run_figures(shown, results.summary))
    write_figures(figures, shown, folder, kinds, width)
    if robot is not None and {"trajectory.q_d[1]", "plant.p_O[1]"} <= {*results.names}:
        write_figures([TOOL], tool_error(robot, shown), folder, kinds, width)
    elif not figures:
        write_signals(shown, folder, kinds, width)
