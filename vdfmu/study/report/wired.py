"""The arm of a run whose joints and links are components of their own, as its package wires them."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from vdfmu.base.arrays import with_named
from vdfmu.base.errors import VdfmuError
from vdfmu.engine.package.read import load_ssp
from vdfmu.engine.plan.check import check_system
from vdfmu.engine.results.results import Results

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
