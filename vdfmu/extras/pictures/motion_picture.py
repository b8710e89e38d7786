"""Pictures of motions."""

from __future__ import annotations

import itertools
from collections.abc import Mapping
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure as Picture

from vdfmu.arm.robot import Robot
from vdfmu.base.arrays import Floats
from vdfmu.base.measure import shown_as
from vdfmu.engine.results.figure import Curve, Figure
from vdfmu.engine.results.results import Recorded, Signal
from vdfmu.extras.pictures.picture import draw
from vdfmu.extras.pictures.style import save

_ORDERS = {"position": 0, "velocity": 1, "acceleration": 2, "snap": 4}
"""Quantity of a motion to the order of its derivative."""


def recorded(t: Floats, groups: Mapping[str, Floats]) -> Recorded:
    """Return arrays (m, n) as signals ``group[i]``."""
    names = [f"{group}[{i}]" for group, values in groups.items() for i in range(1, 1 + values.shape[1])]
    signals = [Signal(name, "real", "", column) for column, name in enumerate(names)]
    return Recorded(t, signals, {"real": np.hstack([*groups.values()])})


def write_motion(robot: Robot, t: Floats, q: Floats, path: Path) -> None:
    """Write the picture of `draw_motion`: PNG, SVG or PDF by its suffix."""
    save(draw_motion(robot, t, q), path)


def draw_motion(robot: Robot, t: Floats, q: Floats) -> Picture:
    """Draw `q`, (5, m, n) [rad or m, s], with four derivatives, over `t`, (m,) [s], with a column per type of joint."""
    results = recorded(t, {order: q[k] for order, k in _ORDERS.items()})
    kinds = sorted(set(robot.joint_types), reverse=True)
    figures: list[Figure] = []
    for order, kind in itertools.product(_ORDERS, kinds):
        joints = [i for i, joint_type in enumerate(robot.joint_types, 1) if joint_type == kind]
        curves = [Curve(f"joint {i}", i, [(1.0, f"{order}[{i}]")]) for i in joints]
        title = f"{order.capitalize()}, {kind}" if len(kinds) > 1 else order.capitalize()
        figures.append(Figure(f"{order}.{kind}", title, shown_as(order, kind), curves))
    return draw(figures, {"": results}, columns=len(kinds))
