"""Arms of joint components, recognised in results and packages of any tool, without the equations of an arm."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from vdfmu.base.arrays import with_named
from vdfmu.base.errors import VdfmuError
from vdfmu.base.measure import JOINT_TYPES
from vdfmu.engine.package.read import load_ssp
from vdfmu.engine.plan.check import check_system
from vdfmu.engine.results.results import Results

BASE = "base"
"""Position of an arm's base in {I}, then its rotation row by row: 12 signals."""
_POWER = ".P_B"


def joints_of(results: Results) -> list[str]:
    """Return the components that are joints, recognised by their virtual power flow."""
    return [group.removesuffix(_POWER) for group in results.groups if group.endswith(_POWER)]


def wired_arm(results: Results, package: Path) -> dict[str, Any]:
    """Return ``arm`` and ``joint_signals``, array to signals, for a chain of joint components; else nothing."""
    names = joints_of(results)
    if not names or not package.is_file():
        return {}
    try:
        checked = check_system(load_ssp(package))
    except VdfmuError:  # the page shows the results anyway; a run reports faults of the package
        return {}
    feeds = {link.end: link.start[0] for link in checked.links}
    links = {name: feeds.get((name, "V_A[1]"), "") for name in names}
    after = {feeds.get((link, "V_B[1]"), ""): name for name, link in links.items()}
    if len(after) < len(names) or not (order := [after[link] for link in after if link not in names]):
        return {}
    while order[-1] in after:
        order.append(after[order[-1]])
    end = next((end[0] for end, start in feeds.items() if start == order[-1] and end[1] == "V_B[1]"), "")
    tool, base = feeds.get((end, "p_C[1]"), ""), links[order[0]]
    values = {name: {v.name: value for v, value in each} for name, each in checked.starts.items()}

    def array(component: str, group: str, default: Any) -> Any:
        return with_named(default, group, values.get(component, {})).tolist()

    of_unit = {joint_type.unit("position"): kind for kind, joint_type in JOINT_TYPES.items()}
    arm = {
        "types": [of_unit[results.units[f"{name}.q"]] for name in order],
        "rotation": [array(name, "rotation", np.eye(3)) for name in order],
        "offset": [array(name, "offset", np.zeros(3)) for name in order],
        "ell": [array(name, "ell", 1.0) for name in order],
        "tool_offset": array(tool, "tool_offset", np.zeros(3)),
        "tool_rotation": array(tool, "tool_rotation", np.eye(3)),
        "gravity": array(base, "gravity", np.array([0.0, 0.0, 9.81])),
        "shapes": [],
    }
    signals = {f"plant.{group}": [f"{name}.{group}" for name in order] for group in ("q", "kappa", "P_B")}
    axes = [3 if JOINT_TYPES[kind].slides else 6 for kind in arm["types"]]
    signals["plant.F_z"] = [f"{name}.F_B[{axis}]" for name, axis in zip(order, axes, strict=True)]
    return {"arm": arm, "joint_signals": {key: each for key, each in signals.items() if set(each) <= {*results.names}}}


def cut_figures(results: Results) -> dict[str, Any]:
    """Return the largest virtual power flow, and the largest axial torque or force, at the cutting points of joints."""
    names, figures = joints_of(results), dict[str, Any]()
    for key, units, signals in (
        ("power", ("W",), [f"{name}.P_B" for name in names]),
        ("cut", ("N.m", "N"), [f"{name}.F_B[{6 if results.units.get(f'{name}.q') == 'rad' else 3}]" for name in names]),
    ):
        largest = [
            (float(size[row]), -k, float(results.time[row]), signal)
            for k, signal in enumerate(signals, 1)
            if signal in results and results.units[signal] in units
            for size in [np.abs(results[signal])]
            for row in [int(size.argmax())]
        ]
        if largest:
            value, joint, at, signal = max(largest)
            figures[key] = {"value": value, "unit": results.units[signal], "joint": -joint, "at_s": at}
    return figures
