"""What a run is about, for its picture: every arm of a system, and what the arms touch.

Roles follow from what a unit is and from the connections, never from the name of a component.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from vdfmu.arm.equations.kinematics import frames
from vdfmu.arm.equations.rigid_body import principal
from vdfmu.arm.robot import Robot
from vdfmu.arm.units import find_unit
from vdfmu.base.arrays import with_named
from vdfmu.compiler.unit.interface import general_description
from vdfmu.system.package.description import SystemDescription
from vdfmu.system.scenario.values import group_of

_OBJECTS = {"wall": ("plane", "normal", ()), "screw": ("screw", "axis", ("pitch", "turn_seat"))}
"""Unit to how it is drawn, the parameter of its direction, and more of them."""
BASE = "base"
"""Position of an arm's base in {I}, then its rotation, row by row: 12 signals."""
_DENSITY = 2700.0
"""Of a payload that is drawn as a cube, aluminium [kg/m3]."""


def scene_of(system: SystemDescription) -> dict[str, Any]:
    """Return the entry ``scene`` of a summary.

    ``arms``: the facts of each plant, see :func:`arm_of`; its component; ``signals``, by the
    names of the shipped systems, ``base``, ``F_e`` and ``F_S``; ``constants``, values that its inputs
    have where nothing feeds them, unless 0; ``mounted``, the plant whose tool is its base, or empty.
    ``objects``: planes and screws, with direction, and distance from the origin of {I} along it.
    """
    scenario, resolved = system.scenario, system.resolved
    robot = scenario.plant_robot if scenario.robot else None
    arms: list[dict[str, Any]] = []
    for name in resolved.plants:
        own = scenario.system.parts[name].robot_of(robot)
        if own is not None and resolved.units[name].needs_robot():
            facts = arm_of(own, system.values[name])
            carrier = system.scenario.system.fed.get(f"{name}.p_S", "").partition(".")[0]
            mounted = carrier if carrier in resolved.plants else ""
            constants = {
                f"{name}.{v.name}": float(system.values[name].get(v.name, v.start) or 0.0)
                for v in system.tables[name]
                if v.causality == "input" and v.group in ("F_e", "p_S", "R_S")
            }
            arms.append(
                facts
                | {"component": name, "mounted": mounted, "signals": _signals(system, name)}
                | {"constants": {key: value for key, value in constants.items() if value}}
            )
    return {"arms": carriers_first(arms), "objects": [one for name in resolved.units for one in _object(system, name)]}


def carriers_first(arms: Sequence[dict[str, Any]]) -> list[dict[str, Any]]:
    """Return arms in an order in which each comes after the one that carries it; those in a circle come last."""
    left, found = list(arms), list[dict[str, Any]]()
    while ready := [arm for arm in left if arm["mounted"] in ("", *(one["component"] for one in found))]:
        found.append(ready[0])
        left.remove(ready[0])
    return found + left


def _signals(system: SystemDescription, name: str) -> dict[str, list[str]]:
    """Return the signals that the drawing of a plant shows; those of inputs are what feeds them."""

    def elements(component: str, group: str) -> list[str]:
        return [f"{component}.{v.name}" for v in system.tables[component] if v.group == group]

    def of(component: str, group: str) -> list[str]:
        source, _, output = system.scenario.system.fed.get(f"{component}.{group}", "").partition(".")
        return (elements(source, output) if source else []) or elements(component, group)

    groups = {component: {v.group for v in table} for component, table in system.tables.items()}
    leader, seen = system.scenario.system.fed.get(f"{name}.tau", "").partition(".")[0], {name}
    while leader and "q_d" not in groups[leader] and leader not in seen:  # an actuator, a brake, a bus
        seen.add(leader)
        leader = system.scenario.system.fed.get(f"{leader}.tau", "").partition(".")[0]
    found = {"plant.q": elements(name, "q"), "plant.kappa": elements(name, "kappa")}
    found |= {"F_S": elements(name, "F_S"), BASE: of(name, "p_S") + of(name, "R_S")}
    found["F_e"] = [] if system.scenario.system.fed.get(f"{name}.M_e", "") else of(name, "F_e")
    if leader and "q_d" in groups[leader]:
        found |= {"trajectory.q_d": of(leader, "q_d"), "controller.tau": elements(leader, "tau")}
        found["feedforward.tau_m"] = of(leader, "tau_m")
    return {key: each for key, each in found.items() if each}


def _object(system: SystemDescription, name: str) -> list[dict[str, Any]]:
    """Return the drawing of a component that an arm touches, in a list; none of others."""
    unit, values, table = system.resolved.units[name], system.values[name], system.tables[name]
    for kind, (look, direction, more) in _OBJECTS.items():
        if issubclass(unit, find_unit(kind)):
            along = np.array(group_of(table, values, direction), dtype=float)
            length = float(np.linalg.norm(along)) or 1.0
            outputs = [v for v in table if v.causality == "output" and not v.index and v.unit in ("N", "N.m")]
            return [{
                "component": name, "kind": look, "direction": (along / length).tolist(),
                **{key: float(group_of(table, values, key)) for key in ("distance", *more)},
                **({"turn": f"{name}.turn"} if look == "screw" else {}),
                "tool": next((c for c in system.resolved.plants if f"{c}.p_O" in system.connections
                              and f"{name}.p_O" in system.connections[f"{c}.p_O"]), ""),
                "forces": {f"{name}.{v.name}": general_description(v.description) for v in outputs},
            }]  # fmt: skip
    return []


def arm_of(robot: Robot, values: Mapping[str, Any]) -> dict[str, Any]:
    """Return the facts from which a robot is drawn: geometry, ratios, and the shapes of its file except meshes.

    `values` of the plant, such as ``offset[2,3]``, count instead of the robot's.
    """
    numbers = frames(robot) | {"gravity": robot.gravity, "ell": robot.ell}
    return {
        "types": list(robot.joint_types),
        **{name: with_named(of_file, name, values).tolist() for name, of_file in numbers.items()},
        **({"payload": _payload(robot, values)} if robot.payload else {}),
        "shapes": [] if any(v.shape == "mesh" for v in robot.visuals) else [v.to_dict() for v in robot.visuals],
    }


def _payload(robot: Robot, values: Mapping[str, Any]) -> dict[str, Any]:
    """Return sides, offset and rotation in {O} of the uniform box with the inertia of the payload; a cube of a point.

    Sides by ``a^2 = 6 (I_y + I_z - I_x) / m`` (Meriam and Kraige, Engineering Mechanics: Dynamics, Table D/4).
    """
    names = ("payload_mass", "payload_centroid", "payload_inertia")
    mass, centroid, inertia = (with_named(getattr(robot, name), name, values) for name in names)
    moments, axes = principal(inertia)
    squares = 6.0 * (moments.sum() - 2.0 * moments) / max(float(mass), 1e-9)
    cube = (float(mass) / _DENSITY) ** (1.0 / 3.0)
    sides = np.sqrt(np.maximum(squares, cube**2 / 25.0)) if squares.max() > cube**2 / 25.0 else np.full(3, cube)
    return {"size": sides.tolist(), "offset": centroid.tolist(), "rotation": axes.tolist()}
