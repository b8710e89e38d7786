"""What the page of a run draws: the arm, figures and recorded signals, thinned and packed for a browser.

A figure or a group of signals has rows of its own: every k-th of the run, and those of the smallest and largest values
between them, so that no peak is lost. Numbers are single precision, calculated in double; they are those of these
rows, never between them.
"""

from __future__ import annotations

import base64
from collections.abc import Iterator, Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from vdfmu.arrays import Floats
from vdfmu.engine.cosim.results import Results
from vdfmu.equations.kinematics import frames
from vdfmu.model import Robot
from vdfmu.report.joints import UNITS
from vdfmu.thinning import extremes

FRAMES = 1000
"""Intervals at most between the rows at equal distances, at which the arm is drawn."""
EXTREMES = 1000
"""Stretches of whose values the smallest and the largest are kept, shared among the curves of a figure."""
_BLOCK = 20_000
"""Rows that are in memory at a time."""


class Curve(NamedTuple):
    """A curve of a figure."""

    label: str
    joint: int
    """From 1; 0 for none."""
    values: Floats
    """(m,)."""
    dashed: bool = False


class Figure(NamedTuple):
    """Curves of one unit of measurement over time."""

    key: str
    title: str
    unit: str
    curves: list[Curve]


def arm_of(robot: Robot, values: Mapping[str, Any]) -> dict[str, Any]:
    """Return what draws a robot: geometry, ratios, and the shapes of its file but for meshes.

    Parameters
    ----------
    robot : Robot
    values : mapping of str to value
        Of the plant, such as ``offset[2,3]``, in place of the robot's.
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
        "shapes": []
        if any(v.shape == "mesh" for v in robot.visuals)
        else [v.to_dict() for v in robot.visuals],
    }


def content_of(results: Results, summary: Mapping[str, Any]) -> dict[str, Any]:
    """Return what the page of a run draws, ready for JSON.

    Returns
    -------
    dict
        ``arm``: of :func:`arm_of`, None without one. ``frames``: time and, for the arm, joint positions, tracking
        errors, control torques and torsion at every k-th row. ``figures`` and ``signals``: lists of figures, with
        rows, time and values as base64 of little-endian numbers, curve by curve.
    """
    arm: Mapping[str, Any] | None = summary.get("arm")
    n = len(arm["types"]) if arm else int(summary.get("joints", 0))
    m, parts = len(results), -(-len(results) // _BLOCK)
    stride = max(1, -(-(m - 1) // FRAMES))
    frames, motion = _Table(), dict[str, Floats]()
    tables: dict[str, dict[str, _Table]] = {"figures": {}, "signals": {}}
    shown = None
    for k, part in enumerate(results.blocks(_BLOCK)):
        even = np.arange(-k * _BLOCK % stride, len(part), stride)  # every k-th row of the whole
        if k == parts - 1:
            even = np.union1d(even, len(part) - 1)
        signals = _Signals(part, n)
        q = signals.array("plant.q")
        shown = None if q is None else arm
        if shown is not None and q is not None:
            motion = {"q": q, **_motion(signals, q, np.array(shown["ell"]))}
        frames.add(part.time, [values.T for values in motion.values()], even)
        figures = [] if shown is None else _figures(signals, shown)
        if summary.get("kind") == "contrast":
            figures = _contrast_figures(signals, summary)
        for kind, found in (("figures", figures), ("signals", _groups(part, n))):
            for figure in found:
                values = np.array([curve.values for curve in figure.curves])
                buckets = max(1, EXTREMES // (len(values) * parts))
                rows = [even, *(extremes(row, buckets) for row in values)]
                table = tables[kind].setdefault(figure.key, _Table(figure))
                table.add(part.time, [values], np.unique(np.concatenate(rows)))
    return {
        "arm": shown,
        "frames": frames.packed(list(motion)),
        **{kind: [table.packed(["values"]) for table in found.values()] for kind, found in tables.items()},
        "copies": {signal.name: signal.of for signal in results.signals if signal.of},
    }


class _Table:
    """Rows of curves, gathered stretch by stretch."""

    def __init__(self, figure: Figure | None = None) -> None:
        self._facts: dict[str, Any] = {}
        if figure is not None:
            curves = [[curve.label, curve.joint, int(curve.dashed)] for curve in figure.curves]
            self._facts = {"key": figure.key, "title": figure.title, "unit": figure.unit, "curves": curves}
        self._time: list[Floats] = []
        self._parts: list[list[Floats]] = []

    def add(self, time: Floats, arrays: Sequence[Floats], rows: NDArray[np.intp]) -> None:
        """Add the rows of arrays (curves, m)."""
        self._time.append(time[rows])
        self._parts.append([array[:, rows] for array in arrays])

    def packed(self, names: Sequence[str]) -> dict[str, Any]:
        """Return what the figure is, its times, and the arrays by name, curve by curve."""
        joined = (np.hstack(array) for array in zip(*self._parts, strict=True))
        return {
            **self._facts,
            "time": _packed(np.concatenate(self._time), "<f8"),
            **{name: _packed(array, "<f4") for name, array in zip(names, joined, strict=True)},
        }


class _Signals:
    """Arrays of a run with an element a joint; None for those that were not recorded."""

    def __init__(self, results: Results, n: int) -> None:
        self._results, self._n = results, n

    def array(self, name: str) -> Floats | None:
        known = name in self._results.groups and self._results.shape_of(name) == (self._n,)
        return self._results[name].astype(float) if known else None


def _motion(signals: _Signals, q: Floats, ell: Floats) -> dict[str, Floats]:
    """Return tracking errors [rad or m], control torques, link-side [N m or N], and torsion [rad or m]."""
    q_d, tau, kappa = (signals.array(name) for name in ("trajectory.q_d", "controller.tau", "plant.kappa"))
    return {
        **({} if q_d is None else {"error": q_d - q}),
        **({} if tau is None else {"torque": ell * tau}),
        **({} if kappa is None else {"torsion": kappa - q}),
    }


def _figures(signals: _Signals, arm: Mapping[str, Any]) -> Iterator[Figure]:
    """Yield positions, torques, their errors and torsion; joints of other units in figures of their own."""
    ell = np.array(arm["ell"])
    q, q_d, tau_m = (signals.array(name) for name in ("plant.q", "trajectory.q_d", "controller.tau_m"))
    motion = _motion(signals, np.zeros(0) if q is None else q, ell)
    tau, ff = motion.get("torque"), None if tau_m is None else ell * tau_m
    e_q, e_tau = motion.get("error"), None if tau is None or ff is None else tau - ff
    for kind, unit in UNITS.items():
        joints = [i for i, of in enumerate(arm["types"]) if of == kind]
        suffix = f", {kind}" if len(set(arm["types"])) > 1 else ""
        noun = unit.noun
        for key, title, measure, factor, shown in (
            ("position", "Joint positions, desired dashed", unit.position, unit.factor, {"q": q, "q_d": q_d}),
            ("tracking", "Position tracking errors: q_d − q", unit.position, unit.factor, {"": e_q}),
            ("torque", f"Control {noun}s, feedforward dashed, link side", unit.torque, 1.0, {"ℓτ": tau, "ℓτ_m": ff}),
            ("compensation", f"{noun.capitalize()} compensation errors: ℓ(τ − τ_m)", unit.torque, 1.0, {"": e_tau}),
            ("torsion", "Torsion of the drives: κ − q", unit.position, unit.factor, {"": motion.get("torsion")}),
        ):  # fmt: skip
            curves = [
                Curve(
                    ", ".join(filter(None, (f"joint {i + 1}", name))),
                    i + 1,
                    factor * values[:, i],
                    dashed=place > 0,
                )
                for place, (name, values) in enumerate(shown.items())
                if values is not None
                for i in joints
            ]
            if curves:
                yield Figure(f"{key}.{kind}", f"{title}{suffix}", measure, curves)


def _contrast_figures(signals: _Signals, summary: Mapping[str, Any]) -> Iterator[Figure]:
    """Yield torques by virtual decomposition and Newton-Euler, and their differences."""
    vd, ne, low = (signals.array(f"{name}.tau") for name in ("vd", "newton_euler", "newton_euler_low_g"))
    units: Sequence[str] = summary.get("torque_units") or ["N.m"] * int(summary["joints"])
    g, low_g = summary["gravities_m_s2"]
    if vd is None or ne is None or low is None:
        return
    for unit in dict.fromkeys(units):
        joints = [i for i, of in enumerate(units) if of == unit]

        def curves(
            values: Floats, name: str = "", of: Sequence[int] = joints, dashed: bool = False
        ) -> list[Curve]:
            return [Curve(f"joint {i + 1}{name}", i + 1, values[:, i], dashed) for i in of]

        both = curves(vd, ", VD") + curves(ne, ", Newton-Euler", dashed=True)
        yield Figure(f"torque.{unit}", "Torques by virtual decomposition, Newton-Euler dashed", unit, both)
        yield Figure(f"rounding.{unit}", "VD minus Newton-Euler", unit, curves(vd - ne))
        yield Figure(f"gravity.{unit}", f"g = {g:#.4g} minus g = {low_g:#.4g}", unit, curves(vd - low))


def _groups(results: Results, n: int) -> Iterator[Figure]:
    """Yield the recorded variables, an array as the curves of one figure; none that copies another. Of n: of joints."""
    copies = {signal.name for signal in results.signals if signal.of}
    for group, members in results.groups.items():
        listed = [(k, name) for k, (_, name) in enumerate(sorted(members.items())) if name not in copies]
        units = dict.fromkeys(results.units[name] for _, name in listed)
        for unit in units:
            curves = [
                Curve(name.rpartition(".")[2], k + 1 if len(members) == n else 0, results[name].astype(float))
                for k, name in listed
                if results.units[name] == unit
            ]
            yield Figure(f"{group}, {unit}" if len(units) > 1 else group, group, unit, curves)


def _packed(values: NDArray[Any], kind: str) -> str:
    with np.errstate(over="ignore"):  # what single precision cannot hold is drawn as a gap
        return base64.b64encode(np.ascontiguousarray(values, dtype=kind).tobytes()).decode()
