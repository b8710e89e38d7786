"""The drawn parts of a run: every arm of a system, and the objects that the arms touch.

Roles follow from units' classes and from the connections, never from the names of components.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import Any

import numpy as np

from vdfmu.arm.equations.kinematics import frames
from vdfmu.arm.equations.rigid_body import principal
from vdfmu.arm.robot import Robot
from vdfmu.arm.units import find_unit
from vdfmu.base.arrays import with_named
from vdfmu.compiler.unit.interface import general_description
from vdfmu.study.run.joint_components import BASE
from vdfmu.system.package.description import SystemDescription
from vdfmu.system.scenario.values import group_of

_OBJECTS = {"wall": ("plane", "normal", ()), "screw": ("screw", "axis", ("pitch", "turn_seat"))}
"""Drawn units: how they are drawn, the parameter of the direction, and other parameters."""
_DENSITY = 2700.0
"""Density of a payload drawn as a cube, that of aluminium [kg/m3]."""


def scene_of(system: SystemDescription) -> dict[str, Any]:
    """Return the entry ``scene`` of a summary.

    ``arms``: the facts of each plant, see :func:`arm_of`; its component; ``signals``, by the
    names of the shipped systems, ``base``, ``F_e`` and ``F_S``; ``constants``, values of its
    unconnected inputs, unless 0; ``mounted``, the plant whose tool is its base, or empty.
    ``objects``: planes and screws, with direction, and distance from the origin of {I} along it.
    ``estimates``: variables in the terminals of estimators, with the torques that they estimate.
    """
    scenario, resolved = system.scenario, system.resolved
    robot = scenario.plant_robot if scenario.robot else None
    arms: list[dict[str, Any]] = []
    for name in resolved.plants:
        arm = scenario.system.parts[name].robot_of(robot)
        if arm is not None and resolved.units[name].needs_robot():
            carrier = scenario.system.fed.get(f"{name}.p_S", "").partition(".")[0]
            constants = {
                f"{name}.{v.name}": value
                for v in system.tables[name]
                if v.causality == "input"
                and v.group in ("F_e", "p_S", "R_S")
                and (value := float(system.values[name].get(v.name, v.start) or 0.0))
            }
            arms.append(
                {
                    **arm_of(arm, system.values[name]),
                    "component": name,
                    "mounted": carrier if carrier in resolved.plants else "",
                    "signals": _signals(system, name),
                    "constants": constants,
                }
            )
    return {
        "arms": carriers_first(arms),
        "objects": [each for name in resolved.units for each in _object(system, name)],
        "estimates": [each for name in resolved.units for each in _estimates(system, name)],
    }


def carriers_first(arms: Sequence[dict[str, Any]]) -> list[dict[str, Any]]:
    """Return arms, each after its carrier; arms in a cycle come last."""
    left, ordered = list(arms), list[dict[str, Any]]()
    while ready := [arm for arm in left if arm["mounted"] in ("", *(each["component"] for each in ordered))]:
        ordered.append(ready[0])
        left.remove(ready[0])
    return ordered + left


def _signals(system: SystemDescription, name: str) -> dict[str, list[str]]:
    """Return the signals that the drawing of a plant shows; for an input, its source."""
    fed = system.scenario.system.fed

    def elements(component: str, group: str) -> list[str]:
        return [f"{component}.{v.name}" for v in system.tables[component] if v.group == group]

    def of(component: str, group: str) -> list[str]:
        source, _, output = fed.get(f"{component}.{group}", "").partition(".")
        return (elements(source, output) if source else []) or elements(component, group)

    groups = {component: {v.group for v in table} for component, table in system.tables.items()}
    leader, seen = fed.get(f"{name}.tau", "").partition(".")[0], {name}
    while leader and "q_d" not in groups[leader] and leader not in seen:  # an actuator, a brake, a bus
        seen.add(leader)
        leader = fed.get(f"{leader}.tau", "").partition(".")[0]
    signals = {"plant.q": elements(name, "q"), "plant.kappa": elements(name, "kappa")}
    signals |= {"F_S": elements(name, "F_S"), BASE: of(name, "p_S") + of(name, "R_S")}
    signals["F_e"] = [] if fed.get(f"{name}.M_e", "") else of(name, "F_e")
    if leader and "q_d" in groups[leader]:
        signals |= {"trajectory.q_d": of(leader, "q_d"), "controller.tau": elements(leader, "tau")}
        signals["feedforward.tau_m"] = of(leader, "tau_m")
    return {key: each for key, each in signals.items() if each}


def _object(system: SystemDescription, name: str) -> Iterator[dict[str, Any]]:
    """Yield the drawing of a component that an arm touches."""
    unit, values, table = system.resolved.units[name], system.values[name], system.tables[name]
    for kind, (look, direction, more) in _OBJECTS.items():
        if issubclass(unit, find_unit(kind)):
            along = np.array(group_of(table, values, direction), dtype=float)
            length = float(np.linalg.norm(along)) or 1.0
            outputs = [v for v in table if v.causality == "output" and not v.index and v.unit in ("N", "N.m", "m")]
            yield {
                "component": name,
                "kind": look,
                "direction": (along / length).tolist(),
                **{key: float(group_of(table, values, key)) for key in ("distance", *more)},
                **({"turn": f"{name}.turn"} if look == "screw" else {}),
                "tool": next(
                    (
                        c
                        for c in system.resolved.plants
                        if f"{c}.p_O" in system.connections and f"{name}.p_O" in system.connections[f"{c}.p_O"]
                    ),
                    "",
                ),
                "forces": {f"{name}.{v.name}": general_description(v.description) for v in outputs},
            }
            return


_ESTIMATES = "estimates"
"""Terminal of a component that estimates torques of an arm."""


def _estimates(system: SystemDescription, name: str) -> Iterator[dict[str, Any]]:
    """Yield each variable in the terminal of estimates, and the plant's torques with its units of measurement."""
    sources = (s.partition(".")[0] for target, s in system.scenario.system.fed.items() if target.startswith(f"{name}."))
    plant = next((source for source in sources if source in system.resolved.plants), None)
    if plant is None:
        return

    def outputs(component: str) -> Iterator[tuple[str, list[Any]]]:
        table = [v for v in system.tables[component] if v.causality == "output"]
        yield from ((group, [v for v in table if v.group == group]) for group in dict.fromkeys(v.group for v in table))

    estimates = [
        group for each in system.resolved.units[name].terminals if each.name == _ESTIMATES for group in each.groups
    ]
    for group, estimated in outputs(name):
        units = [v.unit for v in estimated]
        true = next((each for _, each in outputs(plant) if [v.unit for v in each] == units), None)
        if group in estimates and true and {*units} <= {"N.m", "N"}:
            yield {
                "component": name,
                "group": group,
                "words": general_description(estimated[0].description),
                "signals": [f"{name}.{v.name}" for v in estimated],
                "true": [f"{plant}.{v.name}" for v in true],
            }


def arm_of(robot: Robot, values: Mapping[str, Any]) -> dict[str, Any]:
    """Return a robot's facts for its drawing: geometry, ratios, shapes except meshes. The plant's `values` override."""
    numbers = frames(robot) | {"gravity": robot.gravity, "ell": robot.ell}
    return {
        "types": list(robot.joint_types),
        **{name: with_named(of_file, name, values).tolist() for name, of_file in numbers.items()},
        **({"payload": _payload(robot, values)} if robot.payload else {}),
        "shapes": [] if any(v.shape == "mesh" for v in robot.visuals) else [v.to_dict() for v in robot.visuals],
    }


def _payload(robot: Robot, values: Mapping[str, Any]) -> dict[str, Any]:
    """Return sides, offset and rotation in {O} of the uniform box with the payload's inertia; for a point mass a cube.

    Sides follow from ``a^2 = 6 (I_y + I_z - I_x) / m`` (Meriam and Kraige, Engineering Mechanics: Dynamics, Table D/4).
    """
    names = ("payload_mass", "payload_centroid", "payload_inertia")
    mass, centroid, inertia = (with_named(getattr(robot, name), name, values) for name in names)
    moments, axes = principal(inertia)
    squares = 6.0 * (moments.sum() - 2.0 * moments) / max(float(mass), 1e-9)
    cube = (float(mass) / _DENSITY) ** (1.0 / 3.0)
    sides = np.sqrt(np.maximum(squares, cube**2 / 25.0)) if squares.max() > cube**2 / 25.0 else np.full(3, cube)
    return {"size": sides.tolist(), "offset": centroid.tolist(), "rotation": axes.tolist()}
