"""A body on a joint, with an arm on either side."""

from dataclasses import replace
from typing import Any

from vdfmu.arm.robot import Robot
from vdfmu.arm.units import package_units
from vdfmu.extras.decompose.decomposition import cutting_point, decomposed
from vdfmu.system.scenario import Scenario, load_scenario


def torso(robot: Robot) -> tuple[dict[str, str], dict[str, list[str]], dict[str, Any]]:
    units = package_units()
    parts = {"base": "arm_base", "torso_joint": "plant_joint", "torso": "plant_link"}
    connections: dict[str, list[str]] = {}
    chains = [("base", "torso_joint", "C"), ("torso_joint", "torso", "C")]
    for side in "CD":
        named = [f"{side}_joint_1", f"{side}_link_1", f"{side}_joint_2", f"{side}_link_2"]
        parts |= dict(zip(named, ("plant_joint", "plant_link") * 2, strict=True))
        chains += [("torso", named[0], side), *((a, b, "C") for a, b in zip(named, named[1:], strict=False))]
    for before, after, side in chains:
        for start, end in cutting_point(before, units[parts[before]], after, units[parts[after]], side):
            connections.setdefault(start, []).append(end)
    values = decomposed(scenario_of(robot))[1]
    pieces = [f"{kind}_{i}" for kind in ("joint", "link") for i in (1, 2)]
    return parts, connections, {f"{side}_{piece}": values[f"plant_{piece}"] for side in "CD" for piece in pieces}


def scenario_of(robot: Robot) -> Scenario:
    return replace(load_scenario("tracking"), robot=robot, sections={})
