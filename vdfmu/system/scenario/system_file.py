"""System files: which components a system has, and what is connected to what."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any, cast

from vdfmu.arm.robot import Robot, load_robot
from vdfmu.arm.robot.parameters import ENDS
from vdfmu.base.errors import ModelError, UsageError
from vdfmu.base.once import cached_per_command
from vdfmu.base.text import nearest
from vdfmu.base.toml_file import locate
from vdfmu.base.toml_tables import Problems, Table, as_number, value_text

_KEYS = ("extends", "name", "description", "units", "shared", "connections")
Box = tuple[float, float, float, float]


@dataclass(frozen=True)
class Part:
    """A component of a system."""

    unit: Any
    """Name of a unit of the package, ``file.py`` or ``file.py:Name`` of one's own, a class, or ``file.fmu`` of any
    tool."""
    box: Box | None = None
    """Corners in a diagram [mm], lower left and upper right; None: a place is found."""
    robot: Robot | None = None
    """Robot of the component's own; None: that of the scenario."""
    ends: tuple[str, ...] = ()
    """Flags that its robot has here, of :data:`~vdfmu.arm.robot.parameters.ENDS`."""

    def robot_of(self, robot: Robot | None) -> Robot | None:
        """Return the robot of the component in a scenario with a robot, or without one."""
        robot = self.robot or robot
        return _with_ends(robot, self.ends) if robot and self.ends else robot

    @property
    def fmu(self) -> Path | None:
        """The FMU of any tool; None for a unit."""
        named = str(self.unit)
        return Path(named) if not isinstance(self.unit, type) and named.lower().endswith(".fmu") else None


@cached_per_command
def _with_ends(robot: Robot, ends: tuple[str, ...]) -> Robot:
    return dataclasses.replace(robot, **dict.fromkeys(ends, True))


@dataclass(frozen=True, eq=False)
class SystemFile:
    """A system as its file has it."""

    name: str
    description: str
    path: Path
    parts: Mapping[str, Part]
    """Components by name."""
    connections: Mapping[str, list[str]]
    """``component.output`` to what it feeds, groups of signals: one connection for every index that both have."""
    shared: Mapping[str, Mapping[str, str]]
    """Values that components share under names of their own: name of the parameter set, to component to group."""
    dropped: tuple[str, ...] = ()
    """Connections, ``output -> input``, that were left out for units instead of those of the file."""
    joined: tuple[str, ...] = ()
    """Connections, ``output -> input``, that units instead of those of the file have in addition."""

    @cached_property
    def fed(self) -> Mapping[str, str]:
        """Ends of the connections, groups of inputs or single ones, to the output that feeds them."""
        return {end: start for start, targets in self.connections.items() for end in targets}


def read_system_file(problems: Problems, data: Mapping[str, Any], path: Path, base: SystemFile | None) -> SystemFile:
    """Read the content of a system file at `path`; the tables of `base`, which it extends, come before its own.

    What the file feeds itself, nothing of `base` feeds any more: so a unit is put between two others.
    """
    file = Table(problems, data, "", _KEYS)
    name = file.name("name") if "name" in data or base is None else base.name
    description = file.text("description", "" if base is None else base.description)
    parts = dict(base.parts) if base is not None else {}
    for key, value in file.optional_table("units").data.items():
        file.check_name(f"units.{key}", key, dots=False)
        parts[key] = _part(problems, key, value, path.parent)
    if not parts:
        problems.add("units", "a table with a line for each component", "none", 'Write plant = "plant".')
    own: dict[str, list[str]] = {}
    for source, value in file.optional_table("connections").data.items():
        targets = [value] if isinstance(value, str) else value
        if not isinstance(targets, list) or not all(isinstance(one, str) for one in cast("list[object]", targets)):
            problems.add(f"connections.{source}", 'a list such as ["plant.tau"]', value_text(value), "Name inputs.")
            continue
        ends = cast("list[str]", targets)
        for end in (source, *ends):
            component = end.partition(".")[0]
            if "." not in end or component not in parts:
                problems.add(
                    f"connections.{source}", "component.signal of components in [units]", value_text(end),
                    nearest(component, list(parts)),
                )  # fmt: skip
        own[source] = ends
    fed = {end for ends in own.values() for end in ends}
    kept = {
        key: [end for end in ends if fed.isdisjoint((end, end.partition("[")[0]))]
        for key, ends in (base.connections.items() if base else ())
    }
    connections = {key: ends for key, ends in kept.items() if ends}
    for source, ends in own.items():
        connections[source] = [*connections.get(source, ()), *ends]
    shared = dict(base.shared) if base is not None else {}
    for key, members in file.optional_table("shared").data.items():
        where = f"shared.{key}"
        file.check_name(where, key, dots=False)
        if not isinstance(members, dict) or not members or not all(isinstance(one, str) for one in members.values()):
            expected = 'a table such as { trajectory = "q_start", plant = "q_0" }'
            problems.add(where, expected, value_text(members), "Name a group of each component that shares its value.")
        elif unknown := [one for one in members if one not in parts]:
            problems.add(where, "components in [units]", ", ".join(unknown), nearest(unknown[0], list(parts)))
        elif key == "robot":
            problems.add(where, "another name", key, "The parameter set of the robot has it.")
        else:
            shared[key] = members
    return SystemFile(name, description, path, parts, connections, shared)


def _part(problems: Problems, key: str, value: object, folder: Path) -> Part:
    """Read one entry of [units]: a box, a unit, or a table of both."""
    where = f"units.{key}"
    if isinstance(value, str):
        return Part(_located(value, folder))
    if isinstance(value, list):
        return Part(key, _box(problems, where, value))
    if isinstance(value, dict):
        table = Table(problems, value, where, ("unit", "box", "robot", *ENDS))
        unit = table.text("unit", key)
        box = _box(problems, f"{where}.box", table.data["box"]) if "box" in table.data else None
        robot: Robot | None = None
        if "robot" in table.data and (named := table.text("robot")):
            try:
                robot = load_robot(locate(named, "robots", folder))
            except (ModelError, UsageError) as error:
                problems.take(error, f"{where}.robot")
        return Part(_located(unit, folder), box, robot, tuple(end for end in ENDS if table.flag(end, False)))
    problems.add(
        where,
        'a unit such as "plant" or "my_unit.py", or a table { unit = .., box = .., robot = .. }',
        value_text(value),
        "",
    )
    return Part(key)


def _located(unit: str, folder: Path) -> str:
    """Return a unit with its file found from the folder of the system file."""
    file, colon, name = unit.partition(":") if ".py:" in unit else (unit, "", "")
    if not file.lower().endswith((".py", ".fmu")):
        return unit
    return f"{folder / file}{colon}{name}"


def _box(problems: Problems, where: str, value: object) -> Box | None:
    numbers = cast("list[object]", value) if isinstance(value, list) else []
    corners = [number for one in numbers if (number := as_number(one)) is not None and math.isfinite(number)]
    if len(numbers) == len(corners) == 4:
        x1, y1, x2, y2 = corners
        if x1 < x2 and y1 < y2:
            return x1, y1, x2, y2
    problems.add(
        where, "corners [x1, y1, x2, y2] in mm, x1 < x2 and y1 < y2", value_text(value), "Or leave the box out."
    )
    return None
