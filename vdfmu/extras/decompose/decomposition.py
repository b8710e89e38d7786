"""Decomposes a scenario: arms become systems of links and joints."""

from __future__ import annotations

import dataclasses
import re
from collections.abc import Iterator, Mapping
from itertools import pairwise
from typing import Any

import numpy as np

from vdfmu.arm.drive.options import OPTIONS, STATELESS
from vdfmu.arm.equations.plant import equilibrium_torque
from vdfmu.arm.robot import Robot
from vdfmu.arm.robot.parameters import ENDS, OPTIONAL, PARAMETERS, Row
from vdfmu.arm.units import find_unit
from vdfmu.arm.units.feedforward import Feedforward
from vdfmu.arm.units.plant import Plant
from vdfmu.base.arrays import element_name
from vdfmu.base.errors import UsageError
from vdfmu.system.scenario.scenario import ResolvedSystem, Scenario, Variables
from vdfmu.system.scenario.system_file import Part, SystemFile
from vdfmu.system.scenario.values import Values, is_free, system_values

_UNITS = {Plant: "plant", Feedforward: "feedforward"}
"""Units that are decomposed, and the prefix in the names of their joints', links' and tool's units."""
_BOX, _GAP, _ROW = (70.0, 100.0), 130.0, 180.0
"""Size of a component in a diagram, and distances in a row and between rows [mm]."""


def decomposed(scenario: Scenario, parameters: Mapping[str, Any] | None = None) -> tuple[Scenario, dict[str, Values]]:
    """Return a scenario with joints and links for its plants and feedforwards, and the values of its components.

    ``plant`` becomes ``plant_base``, ``plant_joint_1``, ``plant_link_1``, .. and ``plant_tool``. A payload is part of
    the last link. `parameters` name variables of the given scenario, ``plant.q_0[2]``. See
    :func:`vdfmu.system.scenario.values.override`. UsageError for options of robots and signals that the units of links
    and joints lack.
    """
    resolved, values = scenario.resolved, system_values(scenario, parameters)
    taken: dict[str, tuple[str, Robot]] = {}
    problems: list[str] = []
    for name, unit in resolved.units.items():
        if unit in _UNITS:
            robot = resolved.robots[name]
            assert robot is not None
            robot = robot.with_values([values[name][entry.name] for entry in robot.entries()])
            if unit is Plant:
                values[name] |= _start_values(robot, resolved.tables[name], values[name])
            problems += [f"{name}: the robot {robot.name} has {option}" for option in _lacking(robot)]
            taken[name] = _UNITS[unit], robot
    if not taken:
        problems.append("the system has neither a Plant nor a Feedforward of the package")
    parts = {name: part for name, part in scenario.system.parts.items() if name not in taken}
    bottom = min((part.box[1] for part in scenario.system.parts.values() if part.box), default=0.0)
    connections: dict[str, list[str]] = {}
    for name, (kind, robot) in taken.items():
        bottom -= _ROW
        listed = list(_pieces(name, kind, robot))
        for k, (piece, unit) in enumerate(listed):
            parts[piece] = Part(unit, (k * _GAP, bottom, k * _GAP + _BOX[0], bottom + _BOX[1]))
        for (before, a), (after, b) in pairwise(listed):
            for start, end in cutting_point(before, find_unit(a), after, find_unit(b)):
                connections.setdefault(start, []).append(end)
    for source, targets in scenario.system.connections.items():
        for target in targets:
            for start, end in _joined(source, target, taken, problems):
                connections.setdefault(start, []).append(end)
    if problems:
        raise UsageError("\n".join(f"decomposed: {problem}" for problem in dict.fromkeys(problems)))
    shared = {k: members for k, members in scenario.system.shared.items() if taken.keys().isdisjoint(members)}
    system = dataclasses.replace(scenario.system, parts=parts, connections=connections, shared=shared)
    apart = dataclasses.replace(scenario, system=system, sections={})
    kept = {name: values[name] for name in parts if name in values}
    for name, (kind, robot) in taken.items():
        for piece, _ in _pieces(name, kind, robot):
            kept[piece] = dict(_values(apart.resolved, system, piece, robot, values[name]))
    return apart, kept


def _lacking(robot: Robot) -> Iterator[str]:
    """Yield options of a robot that units of links and joints do not support."""
    flags = (*(name for name in OPTIONS if name not in STATELESS), *ENDS)
    for option in [*["its own drive"] * bool(robot.drive), *(flag for flag in flags if getattr(robot, flag))]:
        yield f"{option}, which units of links and joints do not support"


def _start_values(robot: Robot, table: Variables, values: Values) -> Values:
    """Return the equilibrium of rotors and springs for plants that start in motion or have rotor coupling."""
    groups = ("q_0", "q_dot_0", "F_e")
    q_0, q_dot_0, F_e = (np.array([values.get(v.name, v.start) for v in table if v.group == group]) for group in groups)
    if not values.get("equilibrium", True) or not (q_dot_0.any() or robot.rotor_coupling):
        return {}
    starts = {"kappa_dot_0": q_dot_0, "tau_s_0": equilibrium_torque(robot, q_0, F_e)}
    named = {f"{group}[{i}]": float(x) for group, each in starts.items() for i, x in enumerate(each, 1)}
    return {"equilibrium": False, **named}


def _pieces(name: str, kind: str, robot: Robot) -> Iterator[tuple[str, str]]:
    """Yield the components of an arm from its base to its tool, with their units."""
    yield f"{name}_base", "arm_base"
    for i, joint_type in enumerate(robot.joint_types, 1):
        yield f"{name}_joint_{i}", f"{kind}_prismatic_joint" if joint_type == "prismatic" else f"{kind}_joint"
        yield f"{name}_link_{i}", f"{kind}_link"
    yield f"{name}_tool", f"{kind}_tool"


def cutting_point(before: str, a: Any, after: str, b: Any, side: str = "C") -> Iterator[tuple[str, str]]:
    """Yield the connections of two components at their cutting point: signals of the same quantity.

    Signals have the letter of the cutting point: ``V_A`` and ``V_B`` of a joint, ``V_B`` and ``V_C`` of its link. A
    link has a second point D towards the tip, with other forces. A base at rest has a single velocity.
    """
    near, far = ("B" if "Joint" in a.__name__ else "C"), ("A" if "Joint" in b.__name__ else "B")
    for end, declared in b.declared.items():
        letter = rf"_{far}(?=_|$)"
        if not re.search(letter, end):
            continue
        start, back = (re.sub(letter, f"_{to}", end) for to in (near, side if near == "C" else near))
        if start not in a.declared and a.declared.keys() <= {*find_unit("arm_base").declared}:
            start = re.sub("_[dr](?=_|$)", "", start)
        source = a.declared.get(start)
        if declared.causality == "input" and source is not None and source.shape == declared.shape:
            yield f"{before}.{start}", f"{after}.{end}"
        if declared.causality == "output" and getattr(a.declared.get(back), "causality", "") == "input":
            yield f"{after}.{end}", f"{before}.{back}"


def _joined(
    source: str, target: str, taken: Mapping[str, tuple[str, Robot]], problems: list[str]
) -> list[tuple[str, str]]:
    """Return the connections that replace a connection, and note problems."""
    first, second = (_ends(end, taken, problems) for end in (source, target))
    joints = [i for i in (first if 0 not in first else second) if 0 in first or 0 in second or i in second]

    def at(ends: dict[int, str], end: str, i: int) -> str:
        return ends.get(i) or (end if "[" in end else f"{end}[{i}]")

    return [(at(first, source, i), at(second, target, i)) for i in joints]


def _ends(end: str, taken: Mapping[str, tuple[str, Robot]], problems: list[str]) -> dict[int, str]:
    """Return the ends that replace an end of a connection, by joint from 1; 0 means no joint."""
    component, _, name = end.partition(".")
    if component not in taken:
        return {0: end}
    kind, robot = taken[component]
    group, _, index = name.partition("[")
    if group in find_unit(f"{kind}_joint").declared:
        joints = [int(index.rstrip("]"))] if index else range(1, robot.n + 1)
        return {i: f"{component}_joint_{i}.{group}" for i in joints}
    if group not in find_unit(f"{kind}_tool").declared:
        problems.append(f"{end}: neither a joint nor the end of a decomposed arm has {group}")
    return {0: f"{component}_tool.{name}"}


def _values(
    resolved: ResolvedSystem, system: SystemFile, piece: str, robot: Robot, values: Mapping[str, Any]
) -> Iterator[tuple[str, Any]]:
    """Yield the values of a component's parameters and free inputs."""
    number = re.search(r"_(\d+)$", piece)
    i = int(number[1]) - 1 if number else 0
    for v in resolved.tables[piece]:
        if v.causality == "input" and not is_free(system, piece, v):
            continue
        row = PARAMETERS.get(v.group)
        if v.group == "friction":
            yield v.name, v.choices.index(robot.friction)
        elif v.group == "rotor_coupling":
            yield v.name, robot.rotor_coupling
        elif row is not None and not _is_off(robot, row, i):
            body: dict[str, Any] = dict(zip(("mass", "centroid", "inertia"), robot.body(i), strict=True))
            array = np.asarray(body.get(v.group, getattr(robot, v.group)[i if row.per_joint else ...]))
            yield v.name, float(array[v.index])
        elif v.causality in ("input", "parameter"):
            of_arm = element_name(v.group, (i, *v.index))  # with the joint of the whole arm
            yield v.name, values.get(of_arm, values.get(v.name, v.start))


def _is_off(robot: Robot, row: Row, i: int) -> bool:
    """Return whether a joint's number belongs to an option that the robot, or this joint, does not have."""
    if row.section not in OPTIONAL:
        return False
    return not getattr(robot, row.section) or bool(row.part_of and not getattr(robot, row.part_of)[i])
