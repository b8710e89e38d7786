"""Numbers of drives, friction and limits: from a file of drives, from the robot's own file, or assumed by a rule."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from vdfmu.arm.robot.catalogue import NAMED, tables_of
from vdfmu.arm.robot.parameters import PARAMETERS, Section, section
from vdfmu.arm.robot.robot_file import PLAIN, in_paper_words, section_numbers
from vdfmu.base.files import data_path
from vdfmu.base.measure import JOINT_TYPES, measure
from vdfmu.base.text import matching, nearest
from vdfmu.base.toml_file import read_toml
from vdfmu.base.toml_tables import Problems, Table
from vdfmu.extras.robots.tree import MOVING, Body, Numbers

PARTS: tuple[Section, ...] = ("drive", "friction", "limits")
_TABLES: tuple[Section, ...] = (*PARTS, "link")
FULL = 0.95
"""Speed limit relative to the motor's no-load speed; up to it the whole effort is available."""
_ACCELERATION = 10.0
"""Assumed acceleration [rad/s2, m/s2] of a joint whose file has no torque, in addition to its weight."""
_MOTOR_SIDE = ("N.m", "rotor inertia")
"""Quantities of the table that are link-side in a robot's file, ell times as large."""


class DriveNumbers(NamedTuple):
    """The numbers of a joint's drive, friction and limits; its largest torque [N.m, N] and the source of that."""

    numbers: Numbers
    rating: float
    rated_by: str


def drive_joints(bodies: Sequence[Body], file: str, chosen: Sequence[Numbers], gravity: float) -> list[DriveNumbers]:
    """Return the numbers of every joint. All joints get limits if a file has limits for any joint.

    `bodies`, and their entries `chosen` in the file of drives, see :func:`read_drives`, are in the order from base to
    tip. `file` is the robot's file, which is named in sources. Gravity is in m/s2.
    """
    assumed = read_toml(data_path("models") / "drives" / "assumed.toml")
    of_file = [_numbers_of_file(body, file, numbers) for body, numbers in zip(bodies, chosen, strict=True)]
    limits = {row.path for row in section("limits")}
    parts = PARTS if any(limits & numbers.keys() for numbers in (*chosen, *of_file)) else PARTS[:-1]
    drives: list[DriveNumbers] = []
    for i, body in enumerate(bodies):
        kind = MOVING[body.joint.kind]
        rating, rated_by = _rating(bodies[i:], file, gravity)
        like = assumed[kind]
        numbers = {row.path: chosen[i][row.path] for row in section("link") if row.path in chosen[i]}
        source = f"Assumed: {like['source']}, scaled to the largest torque, which is in the comment above the joint"
        ratio = (of_file[i] | chosen[i]).get(PARAMETERS["ell"].path, (float(f"{like['drive']['ell']:.6g}"), ""))[0]
        for row in (row for part in parts for row in section(part)):
            scale = (rating / like["rating"]) ** measure(row.unit(kind)).exponents.get("kg", 0)
            if row.path in chosen[i]:
                numbers[row.path] = chosen[i][row.path]
            elif row.path in of_file[i]:
                value, place = of_file[i][row.path]
                numbers[row.path] = (value / ratio if row.quantity in _MOTOR_SIDE else value), place
            elif row.key in like[row.section]:
                numbers[row.path] = float(f"{like[row.section][row.key] * scale:.6g}"), source
        drives.append(DriveNumbers(numbers, rating, rated_by))
    return drives


def _numbers_of_file(body: Body, file: str, chosen: Numbers) -> Numbers:
    """Return the numbers in the robot's file, link-side.

    Its limits of speed and torque form a rectangle, with the whole effort up to the largest speed. If a file of drives
    has `chosen` numbers of the motor's torque-speed line, these are kept.
    """
    joint, numbers = body.joint, dict[str, tuple[float, str]]()
    top, share = (row.path for row in section("limits") if row.foreign == "velocity")
    stops = joint.kind != "continuous" and joint.numbers.get("lower", 0.0) < joint.numbers.get("upper", 0.0)
    for row in (row for part in PARTS for row in section(part)):
        value = joint.numbers.get(row.foreign)
        lowest = -row.largest if row.smallest is None else row.smallest
        if value is None or not lowest <= value <= row.largest:
            continue
        if stops or row.foreign not in ("lower", "upper"):
            numbers[row.path] = value, f"{file}: {row.foreign} of the joint"
    if "stiffness" in joint.numbers:
        drive = {key: joint.numbers[key] for key in ("ell", "stiffness")}
        paper, _ = in_paper_words(Problems(""), {"drive": drive}, "joints", MOVING[joint.kind])
        spring = f"{file}: tendon between the joint and its rotor"
        numbers |= {f"joints.drive.{key}": (value, spring) for key, value in paper["drive"].items()}
    numbers.pop(share, None)
    if top in numbers and top not in chosen:
        full, (speed, source) = chosen.get(share, (FULL, ""))[0], numbers[top]
        numbers[share] = full, f"{source}, up to which there is the whole torque"
        numbers[top] = speed / (full or 1.0), f"{source}, over {full:g}" if full else source
    return numbers


def _rating(outward: Sequence[Body], file: str, gravity: float) -> tuple[float, str]:
    """Return the largest torque of the first body's joint, and its source.

    It is the effort in the file, or twice the torque that holds and accelerates the arm when stretched out from the
    axis.
    """
    joint = outward[0].joint
    effort = joint.numbers.get("effort", 0.0)
    if effort > 0.0 and np.isfinite(effort):
        return effort, f"the effort in {file}"
    weight = inertia = mass = reach = 0.0
    for i, body in enumerate(outward):
        reach += float(np.linalg.norm(body.placement.p)) if i else 0.0
        far = reach + float(np.linalg.norm(body.centroid))
        mass += body.mass
        weight += body.mass * far
        inertia += body.mass * far**2 + float(np.linalg.eigvalsh(body.inertia)[-1])
    moved = (mass, mass) if JOINT_TYPES[MOVING[joint.kind]].slides else (weight, inertia)
    load = moved[0] * gravity + moved[1] * _ACCELERATION
    return 2.0 * load, f"twice what holds the stretched arm and accelerates it by {_ACCELERATION:g} SI units"


def read_drives(path: Path | None, bodies: Sequence[Body], problems: Problems) -> list[Numbers]:
    """Return the numbers of each joint in a file of drives.

    Its tables are named by a joint or a pattern with ``*``. They contain ``gear`` and ``motor`` of the catalogue,
    tables of `PARTS` and ``link`` as in a robot file, and ``source``, a text. Later tables override earlier ones.
    """
    chosen: list[Numbers] = [{} for _ in bodies]
    if path is None:
        return chosen
    here = Problems(str(path))
    names = [body.joint.name for body in bodies]
    named: dict[str, dict[str, Any]] = {}
    for pattern, entry in read_toml(path).items():
        table = Table(here, entry, pattern, (*NAMED, *_TABLES, "source"))
        matched = set(matching(names, [pattern]))
        if not matched:
            here.add(pattern, 'a joint of the arm, or a pattern such as "*"', "none", nearest(pattern, names))
        source = table.text("source", "") or f"{path.name}: {pattern}"
        for body, numbers in zip(bodies, chosen, strict=True):
            if body.joint.name in matched:
                kind = MOVING[body.joint.kind]
                paper, words = in_paper_words(here, entry, pattern, kind)
                table_numbers = _numbers_of_table(Table(here, paper, pattern, None), kind, source)
                for place, text in words.items():
                    key = place.replace(pattern, "joints", 1)
                    table_numbers[key] = table_numbers[key][0], f"{text}; {source}"
                ell = table_numbers.get(PARAMETERS["ell"].path, (None,))[0]
                entries = {part: table.data[part] for part in NAMED if part in table.data}
                if entries:  # a later table may name only the gear or the motor
                    named[body.joint.name] = named.get(body.joint.name, {}) | entries
                    tables = tables_of(here, pattern, named[body.joint.name], kind, ell)
                    for row in (row for part in PARTS for row in section(part)):
                        if row.key in tables.get(row.section, {}):
                            numbers[row.path] = tables[row.section][row.key]
                numbers.update(table_numbers)
    problems.lines += dict.fromkeys(here.lines)
    return chosen


def _numbers_of_table(table: Table, kind: str, source: str) -> Numbers:
    """Return the numbers in a table of a file of drives, for a type of joint."""
    numbers: Numbers = {}
    for part in _TABLES:
        keys = [*(row.key for row in section(part)), *(PLAIN if part == "drive" else ())]
        inner = table.optional_table(part, keys)
        values = section_numbers(inner, part, kind, inner.data)
        numbers |= {PARAMETERS[name].path: (value, source) for name, value in values.items()}
    return numbers
