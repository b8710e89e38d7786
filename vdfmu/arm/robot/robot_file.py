"""Reads robot files, given by name or path, into a `Robot`, and reports all problems at once."""

from __future__ import annotations

import math
import os
from collections.abc import Container, Iterable, Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any, cast

import numpy as np

from vdfmu.arm.drive.options import OPTIONS
from vdfmu.arm.robot.catalogue import NAMED, catalogue, filled_from_catalogue
from vdfmu.arm.robot.drive_file import DriveFile
from vdfmu.arm.robot.own_drive import robot_class
from vdfmu.arm.robot.parameters import ENDS, JOINT_OPTIONS, Row, Section, read_only, section
from vdfmu.arm.robot.physical import CONTRACTION, STATIC_FRICTION, check_conditions, check_inertia, check_rotation
from vdfmu.arm.robot.robot import FRICTION_ARRANGEMENTS, Robot, joint_free, robot_argument
from vdfmu.arm.robot.visual import SHAPES, Visual
from vdfmu.base.arrays import Floats
from vdfmu.base.errors import UnitError, UsageError
from vdfmu.base.measure import JOINT_TYPES, POSITIVE, unit_of
from vdfmu.base.option import checks_types
from vdfmu.base.text import nearest
from vdfmu.base.toml_file import locate, read_toml, shipped_names, toml_names
from vdfmu.base.toml_tables import Problems, Table, shape_of, value_text

RIGID, LINEAR = 1e11, 1e-6
"""K_w0 [N.m/rad] and c_f, c_w [1/(N.m), 1/N] of a linear spring. Its compliance differs from 1 / K_f0 by less than the
fraction (c_f tau)^2, 1e-8 at 100 N.m, plus the compliance 1 / (ell^2 K_w0) of the wave generator."""
PLAIN = {
    "stiffness": (
        "stiffness",
        ("K_f0", "c_f", "K_w0", "c_w"),
        "Stiffness of a linear spring, link-side",
        f"K_f0 = stiffness, K_w0 = {RIGID:g} N.m/rad, c_f = c_w = {LINEAR:g}",
    ),
    "rotor_inertia": ("kg.m2", ("I_m",), "Rotor inertia, motor-side", "I_m = ell * rotor_inertia"),
}
"""Plain keys of a drive: unit of measurement or key of `unit_of`, the paper's keys, description, and conversion."""


def _keys(name: Section) -> list[str]:
    return [row.key for row in section(name)]


ROBOT_KEYS = (
    "name",
    "description",
    "friction",
    "rotor_coupling",
    *ENDS,
    "folded",
    "drive",
    *_keys("robot"),
    "tool_on_last_axis",
    "payload",
    "joints",
    "sources",
    "visuals",
)
JOINT_KEYS = ("type", *_keys("joint"), "link", "drive", "friction", *JOINT_OPTIONS, *NAMED, "name")


def robot_from_dict(
    data: Mapping[str, Any], where: str = "robot", files: Mapping[str, str] | None = None, *, own_drive: bool = True
) -> Robot:
    """Build a robot from a TOML file, the inverse of `Robot.to_dict`. ModelError lists all problems of `where`.

    `files` are the texts of the files that the data names, see `Robot.files`. By default they are read from the folder
    of `where`. The file of a drive is run, unless `own_drive` is False: the drive and its tables are then omitted.
    """
    problems = Problems(where)
    file = Table(problems, data, "", ROBOT_KEYS)
    name = file.label("name")
    description = file.text("description", "")
    friction = file.text("friction", "lumped", FRICTION_ARRANGEMENTS)
    rotor_coupling = file.flag("rotor_coupling", True)
    flags = {flag: file.flag(flag, False) for flag in (*ENDS, "tool_on_last_axis")}
    folded = file.flag("folded", True)
    whole = section_numbers(file, "robot") | {row.name: np.zeros(row.shape) for row in section("payload")}
    if "payload" in file.data:
        whole |= section_numbers(file.table("payload", _keys("payload")), "payload")
    for row in section("robot"):
        if row.shape == (3, 3):
            check_rotation(problems, row.key, np.asarray(whole[row.name]))
    drive_class = _class(problems, file, Path(where).parent, files or {}) if own_drive else None
    made = drive_class or Robot
    sources = _sources(file, made)
    expected = "one table [[joints]] for each joint"
    joints = file.value("joints", expected)
    if joints is not None and (not isinstance(joints, list) or not joints):
        problems.add("joints", expected, value_text(joints), "Write [[joints]] in double brackets, at least once.")
        joints = None
    read: list[dict[str, Any]] = []
    of_catalogue: dict[str, str] = {}
    for i, joint in enumerate(cast("list[Any]", joints or []), 1):
        joint, of_words = in_paper_words(problems, joint, f"joints[{i}]")
        of_catalogue |= of_words
        if isinstance(joint, dict) and not joint.keys().isdisjoint(NAMED):
            joint, where_from = filled_from_catalogue(problems, joint, f"joints[{i}]")
            of_catalogue |= where_from
        read.append(_joint(problems, joint, f"joints[{i}]", drive_class))
    names = [joint["name"] for joint in read]
    for i, name_of in enumerate(names, 1):
        if name_of and names.index(name_of) < i - 1:
            other = names.index(name_of) + 1
            problems.add(f"joints[{i}].name", "its own name", f"the name of joints[{other}]", "Rename one.")
    options = {option: any(joint[option] for joint in read) for option in JOINT_OPTIONS}
    for i, joint in enumerate(read, 1):
        for option in (option for option in JOINT_OPTIONS if options[option] and not joint[option]):
            problems.add(f"joints[{i}].{option}", "a table, as other joints have", "nothing", "Give it to all or none.")
    visuals = _read_visuals(problems, file.data.get("visuals", []), len(read))
    problems.raise_any()
    arrays: dict[str, Any] = {
        name: read_only(whole[name] if name in whole else [joint.get(name, 0.0) for joint in read])
        for name in made.rows
    }
    return made(
        name=name,
        description=description,
        joint_types=tuple(cast(str, joint["type"]) for joint in read),
        joint_names=tuple(names),
        friction=friction,
        rotor_coupling=rotor_coupling,
        sources=of_catalogue | sources,
        payload="payload" in file.data or not folded,
        folded=folded,
        visuals=visuals,
        **options,
        **flags,
        **arrays,
    )


def robot_names() -> list[str]:
    """Return the names of the shipped robots."""
    return toml_names("robots")


@checks_types
def load_robot(path_or_name: str | os.PathLike[str], *, own_drive: bool = True) -> Robot:
    """Load a robot by the name of a shipped one or by the path of a TOML file.

    If the file names its own drive, ``drive = "my_drive.py"``, that file is run as by ``import``.

    Parameters
    ----------
    path_or_name : str or path
        A value with a path separator or the suffix ``.toml``, and the name of an existing file, are paths.
    own_drive : bool
        False omits the drive that the file names, and its tables; then no code is run.

    Returns
    -------
    Robot

    Raises
    ------
    UsageError
        If no shipped robot has the name.
    ModelError
        If the file cannot be read or describes no physical robot; it lists every problem.
    """
    path = locate(path_or_name, "robots")
    robot = robot_from_dict(read_toml(path), str(path), own_drive=own_drive)
    shipped = str(path_or_name) in shipped_names("robots") and path != Path(path_or_name)
    return robot if shipped else replace(robot, file=str(path_or_name))


def check_robot(robot: Robot, where: str = "") -> Robot:
    """Return a physical robot, for example from `Robot.with_parameters`; ModelError with every problem found."""
    robot_argument(robot)
    robot_from_dict(robot.to_dict(), where or f"robot {robot.name}", robot.files)
    return robot


def _class(problems: Problems, file: Table, folder: Path, files: Mapping[str, str]) -> type[Robot] | None:
    """Return `Robot`, or the class of robots with the drive whose file the key `drive` names; None if it fails."""
    if "drive" not in file.data:
        return Robot
    if not (name := file.text("drive")):
        return None
    try:
        return robot_class(DriveFile(name, files[name]) if name in files else DriveFile.read(name, folder))
    except (UsageError, UnitError) as error:
        problems.take(error)
    return None


def _joint(problems: Problems, data: object, path: str, drive_class: type[Robot] | None) -> dict[str, Any]:
    """Read a [[joints]] table: return field of `Robot` to this joint's value. Without a class any table is allowed."""
    made = drive_class or Robot
    sections: Any = made.own_sections()
    table = Table(problems, data, path, None if drive_class is None else (*JOINT_KEYS, *sections))
    kind = table.text("type", choices=(*JOINT_TYPES,))
    options = {option: option in table.data for option in JOINT_OPTIONS}
    name = table.label("name") if "name" in table.data else ""
    joint: dict[str, Any] = {"name": name, "type": kind, **options} | section_numbers(table, "joint", kind)
    check_rotation(problems, f"{path}.rotation", joint["rotation"])
    parts: tuple[Section, ...] = ("link", "drive", "friction", *(part for part in JOINT_OPTIONS if options[part]))
    for part in parts:
        joint |= section_numbers(table.table(part, [*_keys(part), *(PLAIN if part == "drive" else ())]), part, kind)
    for part in sections:
        rows = [row for row in made.rows.values() if row.section == part]
        joint |= section_numbers(table.optional_table(part, [row.key for row in rows]), part, kind, rows=rows)
    check_conditions(problems, path, (CONTRACTION, STATIC_FRICTION), joint)
    for option in made.own_options:
        check_conditions(problems, path, option.conditions, joint, made.rows)
    for option in JOINT_OPTIONS:
        if not options[option]:
            continue
        for name in OPTIONS[option].revolute_only:
            if JOINT_TYPES[kind].slides and joint[name] != 0.0:
                key = f"{path}.{option}.{name}"
                problems.add(key, "0 at a prismatic joint", f"{joint[name]:g}", "It acts only on revolute joints.")
        check_conditions(problems, path, OPTIONS[option].conditions, joint)
    return joint


def section_numbers(
    table: Table,
    part: Section,
    joint_type: str = "revolute",
    keys: Container[str] | None = None,
    rows: Iterable[Row] | None = None,
) -> dict[str, float | Floats]:
    """Read the numbers of a section, or some of its `keys`: return field of `Robot` to its value."""
    numbers: dict[str, float | Floats] = {}
    for row in (row for row in rows or section(part) if keys is None or row.key in keys):
        unit = row.unit(joint_type)
        options: dict[str, Any] = {"above": 0.0} if row.smallest == POSITIVE else {"at_least": row.smallest}
        options |= {"at_most": row.largest, "fix": row.fix, "unit": "" if unit == "1" else unit}
        if row.fold == "inertia":
            numbers[row.name] = _inertia(table, row, options)
        elif row.shape:
            default = None if row.default is None else np.full(row.shape, row.default).tolist()
            numbers[row.name] = table.numbers(row.key, row.shape, default=default, **options)
        else:
            numbers[row.name] = table.number(row.key, default=row.default, **options)
    return numbers


def _inertia(table: Table, row: Row, options: dict[str, Any]) -> Floats:
    """Read an inertia (3, 3) from one number, three moments or a matrix; with a default it may be 0, a point mass."""
    key, value = row.key, table.data.get(row.key)
    shape = shape_of(value)
    if value is None and row.default is not None:
        inertia = np.full(row.shape, row.default)
    elif shape == row.shape:
        inertia = table.numbers(key, row.shape, **options)
    elif shape != () or value is None:
        inertia = np.diag(table.numbers(key, (3,), **options))
    else:
        inertia = table.number(key, **options) * np.eye(3)
    if row.default is None or inertia.any():
        check_inertia(table.problems, table.key(key), inertia)
    return inertia


def _sources(file: Table, made: type[Robot]) -> dict[str, str]:
    """Read [sources], whose keys may be quoted or nested: "joints.link.mass" or joints.link.mass."""
    texts: dict[str, str] = {}
    keys = [*(row.path for row in made.rows.values()), *(f"joints.drive.{word}" for word in PLAIN)]

    def walk(value: object, path: str) -> None:
        if isinstance(value, dict):
            for key, entry in cast("dict[str, object]", value).items():
                walk(entry, f"{path}.{key}" if path else key)
        elif not isinstance(value, str):
            file.problems.add(f"sources.{path}", "a string", value_text(value), "Name the source of the number.")
        elif joint_free(path) not in keys:
            file.problems.add(f"sources.{path}", "a key of this file", "an unknown one", nearest(path, keys))
        else:
            file.check_text(f"sources.{path}", value)
            texts[path] = value

    sources = file.value("sources", "a table", {})
    if isinstance(sources, dict):
        walk(cast(object, sources), "")
    else:
        file.problems.add("sources", "a table", value_text(sources), "Its entries are: key = source of the number.")
    return texts


def in_paper_words(problems: Problems, joint: Any, path: str, kind: str = "") -> tuple[Any, dict[str, str]]:
    """Return a joint's table with the paper's keys instead of plain keys, and sources. Having both is a problem."""
    drive = joint.get("drive") if isinstance(joint, dict) else None
    if not isinstance(drive, dict) or PLAIN.keys().isdisjoint(drive):
        return joint, {}
    drive = cast("dict[str, Any]", drive)
    paper = {key: value for key, value in drive.items() if key not in PLAIN}
    sources: dict[str, str] = {}
    for word, (quantity, keys, text, _) in PLAIN.items():
        if word not in drive:
            continue
        unit = unit_of(quantity, kind or joint.get("type", ""))
        table = Table(problems, {word: drive[word]}, f"{path}.drive", None)
        value = table.number(word, above=0.0, at_most=1e12, unit=unit, fix=f"It is the {text[0].lower()}{text[1:]}.")
        value = 1.0 if math.isnan(value) else value  # one problem is enough for a wrong value
        if both := [key for key in keys if key in drive]:
            problems.add(
                table.key(word), f"{word} or {', '.join(keys)}", f"{word} and {', '.join(both)}", "Delete one."
            )
        if word == "stiffness":
            numbers = {"K_f0": value, "c_f": LINEAR, "K_w0": RIGID, "c_w": LINEAR}
        else:
            ell = drive.get("ell", catalogue()["gears"].get(str(joint.get("gear")), {}).get("ratio"))
            if ell is None:
                problems.add(table.key(word), "ell beside it", "nothing", "I_m is ell * rotor_inertia: add ell.")
            numbers = {"I_m": value * ell if isinstance(ell, int | float) else value}
        paper |= numbers
        sources |= {f"{path}.drive.{key}": f"{word} = {value:g} {unit}" for key in numbers}
    return {**joint, "drive": paper}, sources


def plain_notes(sources: Mapping[str, str]) -> list[str]:
    """Return a note on the conversion of each plain key in a robot's file, found in the sources of its numbers."""
    words = {text.partition(" = ")[0] for text in sources.values()}
    return [f"{word} was converted: {note}." for word, (*_, note) in PLAIN.items() if word in words]


_VISUAL_KEYS = ("joint", "shape", "file", "size", "rotation", "offset", "color")


def _read_visuals(problems: Problems, data: object, n: int) -> tuple[Visual, ...]:
    """Read the tables [[visuals]] of a robot of `n` joints."""
    if not isinstance(data, list):
        problems.add("visuals", "tables", value_text(data), "Write [[visuals]] in double brackets.")
        return ()
    return tuple(_visual(problems, entry, f"visuals[{i}]", n) for i, entry in enumerate(data, 1))


def _visual(problems: Problems, data: object, path: str, n: int) -> Visual:
    table = Table(problems, data, path, _VISUAL_KEYS)
    joint = table.value("joint", f"a joint from 0 to {n}")
    if joint is not None and (isinstance(joint, bool) or not isinstance(joint, int) or not 0 <= joint <= n):
        problems.add(f"{path}.joint", f"a joint from 0 to {n}", value_text(joint), "0 is for shapes at rest.")
    shape = table.text("shape", choices=tuple(SHAPES))

    def numbers(key: str, size: tuple[int, ...], unit: str, default: Any, **bounds: Any) -> Floats:
        return read_only(table.numbers(key, size, unit, default, **bounds))

    rotation = numbers("rotation", (3, 3), "", np.eye(3).tolist())
    check_rotation(problems, f"{path}.rotation", rotation)
    mesh, size = shape == "mesh", (SHAPES.get(shape, 0),)
    return Visual(
        joint=joint if isinstance(joint, int) else 0, shape=shape, rotation=rotation,
        size=numbers("size", size, "", [1.0] * 3) if mesh else numbers("size", size, "m", None, at_least=0.0),
        offset=numbers("offset", (3,), "m", [0.0] * 3),
        color=numbers("color", (4,), "", [0.7, 0.7, 0.7, 1.0], at_least=0.0, at_most=1.0),
        file=table.text("file") if mesh else table.text("file", ""),
    )  # fmt: skip
