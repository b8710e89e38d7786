"""Numbers of drives, friction and limits: from a file of drives, the robot's own file, or assumed by one rule."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from vdfmu.arm.imports.tree import MOVING, Body, Numbers
from vdfmu.arm.robot.catalogue import NAMED, tables_of
from vdfmu.arm.robot.parameters import PARAMETERS, Section, section
from vdfmu.arm.robot.robot_file import section_numbers
from vdfmu.base.files import data_path
from vdfmu.base.measure import measure
from vdfmu.base.text import matching, nearest
from vdfmu.base.toml_file import read_toml
from vdfmu.base.toml_tables import Problems, Table

PARTS: tuple[Section, ...] = ("drive", "friction", "limits")
_TABLES: tuple[Section, ...] = (*PARTS, "link")
_FULL = 0.95
"""Share of a motor's no-load speed that a limit of the speed is, up to which the torque is the whole effort."""
_ACCELERATION = 10.0
"""Acceleration [rad/s2, m/s2] that a joint without a given torque is assumed to be made for besides its weight."""
_MOTOR_SIDE = ("N.m", "rotor inertia")
"""Quantities of the table that are given link-side in a robot's file, ell times as large."""


class DriveNumbers(NamedTuple):
    """The numbers of a joint's drive, friction and limits; its largest torque [N.m, N], and where that is from."""

    numbers: Numbers
    rating: float
    rated_by: str


def drive_joints(bodies: Sequence[Body], file: str, chosen: Sequence[Numbers], gravity: float) -> list[DriveNumbers]:
    """Return the numbers of every joint; those of limits for all joints, if any joint has one that is given.

    Bodies, and their entries `chosen` of the file of drives, by :func:`read_drives`, go from base to tip; `file` is the
    robot's, for sources; gravity in m/s2.
    """
    assumed = read_toml(data_path("models") / "drives" / "assumed.toml")
    given = [_given(body, file, one) for body, one in zip(bodies, chosen, strict=True)]
    limits = {row.path for row in section("limits")}
    parts = PARTS if any(limits & {*one, *other} for one, other in zip(chosen, given, strict=True)) else PARTS[:-1]
    found: list[DriveNumbers] = []
    for i, body in enumerate(bodies):
        kind = MOVING[body.joint.kind]
        rating, rated_by = _rating(bodies[i:], file, gravity)
        like = assumed[kind]
        numbers = {row.path: chosen[i][row.path] for row in section("link") if row.path in chosen[i]}
        source = f"Assumed: {like['source']}, for the largest torque in the comment above the joint"
        ratio = chosen[i].get(PARAMETERS["ell"].path, (like["drive"]["ell"], ""))[0]
        for row in (row for part in parts for row in section(part)):
            scale = (rating / like["rating"]) ** measure(row.unit(kind)).exponents.get("kg", 0)
            if row.path in chosen[i]:
                numbers[row.path] = chosen[i][row.path]
            elif row.path in given[i]:
                value, source_given = given[i][row.path]
                numbers[row.path] = (value / ratio if row.quantity in _MOTOR_SIDE else value), source_given
            elif row.key in like[row.section]:
                numbers[row.path] = float(f"{like[row.section][row.key] * scale:.6g}"), source
        found.append(DriveNumbers(numbers, rating, rated_by))
    return found


def _given(body: Body, file: str, chosen: Numbers) -> Numbers:
    """Return what the robot's file gives, link-side.

    Its limits of speed and torque are a rectangle: the whole effort up to the speed. What a file of drives has `chosen`
    of the motor's line is taken as it is.
    """
    joint, found = body.joint, dict[str, tuple[float, str]]()
    top, share = (row.path for row in section("limits") if row.given == "velocity")
    stops = joint.kind != "continuous" and joint.given.get("lower", 0.0) < joint.given.get("upper", 0.0)
    for row in (row for part in PARTS for row in section(part)):
        value = joint.given.get(row.given)
        lowest = -row.largest if row.smallest is None else row.smallest
        if value is None or not lowest <= value <= row.largest:
            continue
        if stops or row.given not in ("lower", "upper"):
            found[row.path] = value, f"{file}: {row.given} of the joint"
    found.pop(share, None)
    if top in found and top not in chosen:
        full, (speed, source) = chosen.get(share, (_FULL, ""))[0], found[top]
        found[share] = full, f"{source}, up to which there is the whole torque"
        found[top] = speed / (full or 1.0), f"{source}, over {full:g}" if full else source
    return found


def _rating(outward: Sequence[Body], file: str, gravity: float) -> tuple[float, str]:
    """Return the largest torque of the first of some bodies' joint, and where it is from.

    That of the file; else twice what holds and accelerates the bodies up to the tip, stretched out across the axis.
    """
    joint = outward[0].joint
    effort = joint.given.get("effort", 0.0)
    if effort > 0.0 and np.isfinite(effort):
        return effort, f"the effort in {file}"
    weight = inertia = mass = reach = 0.0
    for i, body in enumerate(outward):
        reach += float(np.linalg.norm(body.placement.p)) if i else 0.0
        far = reach + float(np.linalg.norm(body.centroid))
        mass += body.mass
        weight += body.mass * far
        inertia += body.mass * far**2 + float(np.linalg.eigvalsh(body.inertia)[-1])
    moved = (mass, mass) if MOVING[joint.kind] == "prismatic" else (weight, inertia)
    load = moved[0] * gravity + moved[1] * _ACCELERATION
    return 2.0 * load, f"twice what holds the stretched arm and accelerates it by {_ACCELERATION:g} SI units"


def read_drives(path: Path | None, bodies: Sequence[Body], problems: Problems) -> list[Numbers]:
    """Return the numbers that a file of drives has of each joint.

    It has tables by the name of a joint, or a pattern with ``*``, with ``gear`` and ``motor`` of the catalogue, tables
    of `PARTS` and ``link`` as in a robot file, and ``source``, a text. A later one overrides an earlier one.
    """
    chosen: list[Numbers] = [{} for _ in bodies]
    if path is None:
        return chosen
    here = Problems(str(path))
    names = [body.joint.name for body in bodies]
    named: dict[str, dict[str, Any]] = {}
    for pattern, entry in read_toml(path).items():
        table = Table(here, entry, pattern, (*NAMED, *_TABLES, "source"))
        meant = set(matching(names, [pattern]))
        if not meant:
            here.add(pattern, 'a joint of the arm, or a pattern such as "*"', "none", nearest(pattern, names))
        source = table.text("source", "") or f"{path.name}: {pattern}"
        for body, numbers in zip(bodies, chosen, strict=True):
            if body.joint.name in meant:
                kind = MOVING[body.joint.kind]
                own = _of_table(table, kind, source)
                ell = own.get(PARAMETERS["ell"].path, (None,))[0]
                names_now = {what: table.data[what] for what in NAMED if what in table.data}
                if names_now:  # a later entry may name the gear or the motor alone
                    named[body.joint.name] = named.get(body.joint.name, {}) | names_now
                    tables = tables_of(here, pattern, named[body.joint.name], kind, ell)
                    for row in (row for part in PARTS for row in section(part)):
                        if row.key in tables.get(row.section, {}):
                            numbers[row.path] = tables[row.section][row.key]
                numbers.update(own)
    problems.lines += dict.fromkeys(here.lines)
    return chosen


def _of_table(table: Table, kind: str, source: str) -> Numbers:
    """Return the numbers that a table of a file of drives has, for a type of joint."""
    found: Numbers = {}
    for part in _TABLES:
        inner = table.optional_table(part, tuple(row.key for row in section(part)))
        for name, value in section_numbers(inner, part, kind, inner.data).items():
            found[PARAMETERS[name].path] = value, source
    return found
