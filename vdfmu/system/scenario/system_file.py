"""Reads system files: components of a system and their connections."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import Any, NamedTuple, cast

from vdfmu.arm.robot import Robot, load_robot
from vdfmu.arm.robot.parameters import ENDS
from vdfmu.base.cache import cached_per_command
from vdfmu.base.errors import ModelError, UsageError
from vdfmu.base.text import nearest
from vdfmu.base.toml_file import locate
from vdfmu.base.toml_tables import Problems, Table, as_number, value_text
from vdfmu.engine.package.system import Connections, ends_of

_KEYS = ("extends", "name", "description", "components", "shared", "connections")
Box = tuple[float, float, float, float]


class Part(NamedTuple):
    """A component of a system."""

    unit: Any
    """Name of a shipped unit, ``file.py``, ``file.py:Name``, a class, or ``file.fmu`` of any tool."""
    box: Box | None = None
    """Lower left and upper right corners in a diagram [mm]; None for automatic ones."""
    robot: Robot | None = None
    """Robot of the component, if it differs from the robot of the scenario."""
    ends: tuple[str, ...] = ()
    """Flags of the component's robot, from :data:`~vdfmu.arm.robot.parameters.ENDS`."""

    def robot_of(self, robot: Robot | None) -> Robot | None:
        """Return the robot of the component, by default the scenario's."""
        robot = self.robot or robot
        return _with_ends(robot, self.ends) if robot and self.ends else robot

    @property
    def fmu(self) -> Path | None:
        """The FMU, from any tool; None for a unit."""
        named = str(self.unit)
        return Path(named) if not isinstance(self.unit, type) and named.lower().endswith(".fmu") else None


@cached_per_command
def _with_ends(robot: Robot, ends: tuple[str, ...]) -> Robot:
    return dataclasses.replace(robot, **dict.fromkeys(ends, True))


@dataclass(frozen=True, eq=False)
class SystemFile:
    """Content of a system file."""

    name: str
    description: str
    path: Path
    parts: Mapping[str, Part]
    """Components by name."""
    connections: Mapping[str, list[str]]
    """``component.output`` to inputs. Groups of signals are connected at every common index."""
    shared: Mapping[str, Mapping[str, str]]
    """Shared values: name in the parameter set to component to its group."""
    dropped: tuple[str, ...] = ()
    """Connections, ``output -> input``, dropped because a replacement lacks the signal."""
    joined: tuple[str, ...] = ()
    """Connections, ``output -> input``, added for replacements."""
    unfed: Mapping[str, list[str]] = field(default_factory=dict[str, list[str]])
    """New unconnected inputs of replacements, to this component's inputs that lost their connection."""

    @cached_property
    def fed(self) -> Mapping[str, str]:
        """Connected inputs, groups or elements, to their outputs."""
        return {end: start for start, targets in self.connections.items() for end in targets}


def read_system_file(problems: Problems, data: Mapping[str, Any], path: Path, base: SystemFile | None) -> SystemFile:
    """Read the content of a system file at `path` that extends the tables of `base`.

    An input that the file connects loses its connection in `base`, so that a unit can be inserted between two others.
    """
    if "units" in data:
        problems.add("units", "[components]", "[units]", "Rename the table.")
        data = {"components" if key == "units" else key: value for key, value in data.items()}
    file = Table(problems, data, "", _KEYS)
    name = file.name("name") if "name" in data or base is None else base.name
    description = file.text("description", "" if base is None else base.description)
    parts = dict(base.parts) if base is not None else {}
    for key, value in file.optional_table("components").data.items():
        file.check_name(f"components.{key}", key, dots=False)
        parts[key] = _part(problems, key, value, path.parent)
    if not parts:
        problems.add("components", "a table with a line for each component", "none", 'Write plant = "plant".')
    connected: dict[str, list[str]] = {}
    for source, value in file.optional_table("connections").data.items():
        targets = [value] if isinstance(value, str) else value
        if not isinstance(targets, list) or not all(isinstance(end, str) for end in cast("list[object]", targets)):
            problems.add(f"connections.{source}", 'a list such as ["plant.tau"]', value_text(value), "Name inputs.")
            continue
        ends = cast("list[str]", targets)
        for end in (source, *ends):
            component = end.partition(".")[0]
            if "." not in end or component not in parts:
                problems.add(
                    f"connections.{source}",
                    "component.signal of [components]",
                    value_text(end),
                    nearest(component, list(parts)),
                )
        connected[source] = ends
    connections = rewired(base.connections if base is not None else {}, connected)
    shared = dict(base.shared) if base is not None else {}
    for key, members in file.optional_table("shared").data.items():
        where = f"shared.{key}"
        file.check_name(where, key, dots=False)
        if not isinstance(members, dict) or not members or not all(isinstance(end, str) for end in members.values()):
            expected = 'a table such as { trajectory = "q_start", plant = "q_0" }'
            problems.add(where, expected, value_text(members), "Name a group of each component that shares its value.")
        elif unknown := [component for component in members if component not in parts]:
            problems.add(where, "names of [components]", ", ".join(unknown), nearest(unknown[0], list(parts)))
        elif key == "robot":
            problems.add(where, "another name", key, "It is in the robot's parameter set.")
        else:
            shared[key] = members
    return SystemFile(name, description, path, parts, connections, shared)


def rewired(connections: Mapping[str, list[str]], added: Connections) -> dict[str, list[str]]:
    """Return connections with additional ones, which replace the previous connection of an input."""
    pairs = ends_of(added)
    fed = {end for _, end in pairs}
    kept = {
        source: [end for end in ends if fed.isdisjoint((end, end.partition("[")[0]))]
        for source, ends in connections.items()
    }
    for source, end in pairs:
        kept.setdefault(source, []).append(end)
    return {source: ends for source, ends in kept.items() if ends}


def _part(problems: Problems, key: str, value: object, folder: Path) -> Part:
    """Read an entry of [components]: a box, a unit, or a table of both."""
    where = f"components.{key}"
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
    expected = 'a unit such as "plant" or "my_unit.py", or a table { unit = .., box = .., robot = .. }'
    problems.add(where, expected, value_text(value), "")
    return Part(key)


def _located(unit: str, folder: Path) -> str:
    """Return a unit whose file's path is resolved from the folder of the system file."""
    file, colon, name = unit.partition(":") if ".py:" in unit else (unit, "", "")
    if not file.lower().endswith((".py", ".fmu")):
        return unit
    return f"{folder / file}{colon}{name}"


def _box(problems: Problems, where: str, value: object) -> Box | None:
    numbers = cast("list[object]", value) if isinstance(value, list) else []
    corners = [number for each in numbers if (number := as_number(each)) is not None and math.isfinite(number)]
    if len(numbers) == len(corners) == 4:
        x1, y1, x2, y2 = corners
        if x1 < x2 and y1 < y2:
            return x1, y1, x2, y2
    expected = "corners [x1, y1, x2, y2] in mm, x1 < x2 and y1 < y2"
    problems.add(where, expected, value_text(value), "Or leave the box out.")
    return None
