"""A serial manipulator with flexible joints, as one structure of arrays."""

from __future__ import annotations

import dataclasses
import inspect
import re
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np
import numpy.typing as npt

from vdfmu.arm.drive.option import DriveOption
from vdfmu.arm.robot.parameters import (
    ENDS,
    JOINT_OPTIONS,
    OPTIONAL,
    PARAMETERS,
    Array,
    Parameters,
    Row,
    Section,
    read_only,
)
from vdfmu.arm.robot.physical import requirements
from vdfmu.arm.robot.structure import parameters, set_parameters, shorter_robots, structure_key, symbolic_robot, values
from vdfmu.arm.robot.visual import Visual
from vdfmu.arm.world.payload import link_body
from vdfmu.base.errors import UsageError
from vdfmu.compiler.unit.declaration import Entry

JOINT_TYPES = ("revolute", "prismatic")
FRICTION_ARRANGEMENTS = ("lumped", "split")


@dataclass(frozen=True, eq=False, kw_only=True)
class Robot(Parameters):
    """Parameters of a serial chain of n links on revolute or prismatic joints with flexible drives.

    Frame {B_i} is fixed to link i, its z axis is the axis of joint i; {B_0} is the inertial frame {I}, {O} that of the
    end effector. SI units, angles in rad; a unit after "or" is that of a prismatic joint, whose motor side stays
    rad and N.m. The kinematic error of Eq. (3) is ``A*sin(2*ell*kappa + phase)``.

    Nothing is checked here: the equations also run with fields that hold symbols. `vdfmu.arm.robot.robot_file` checks.

    Parameters
    ----------
    name, description : str
        Name and description of the robot.
    joint_types : (n,) tuple of "revolute" or "prismatic"
    joint_names : (n,) tuple of str
        Names that the file of another tool has for the joints; empty for none.
    friction : "lumped" or "split"
        Arrangement of the friction: all at the rotor, or Eq. (54) on the link and Eq. (55) on the rotor.
    rotor_coupling : bool
        Whether the rotors turn with the links that carry them, as bodies of Eq. (4), (7) and (11), or in pure
        rotation about their own axis, Eq. (56).
    sources : mapping of str to str
        Provenance: key of the robot file to where its number is from.
    payload : bool
        Whether the last link carries a body of its own; the fields ``payload_`` count only then.
    {options} : bool
        Whether joints have this option of the drives; the fields of its table, such as ``[joints.limits]``, count
        only then.
    moving_base : bool
        Whether the base moves, as inputs of the plant say; else it is at rest in {I}.
    coupled_tool : bool
        Whether the plant shows how its end effector moves, and takes a load that has a mass.
    visuals : tuple of Visual
        Shapes of the links in pictures; no calculation uses them.
    file : str
        The path or name from which it was loaded, if it is not a shipped one.
    """

    reader: ClassVar[str] = "vdfmu.arm.robot.robot_file:robot_from_dict"
    flags: ClassVar[tuple[str, ...]] = (*OPTIONAL, *ENDS)
    joint_fields: ClassVar[tuple[str, ...]] = tuple(
        name for name, row in PARAMETERS.items() if row.per_joint and not row.shape
    )

    # see Machine
    entries, with_values, symbolic, key = parameters, set_parameters, symbolic_robot, structure_key
    values, requirements, shorter = values, requirements, shorter_robots
    body = link_body

    own: ClassVar[tuple[DriveOption, ...]] = ()
    """Options of a drive of its own, see :mod:`vdfmu.arm.robot.own_drive`."""
    drive: ClassVar[str] = ""
    """Text of the file of that drive."""

    name: str
    description: str
    joint_types: tuple[str, ...]
    friction: str
    rotor_coupling: bool
    sources: Mapping[str, str]
    payload: bool = False
    moving_base: bool = False
    coupled_tool: bool = False
    visuals: tuple[Visual, ...] = ()
    joint_names: tuple[str, ...] = ()
    file: str = ""

    @property
    def n(self) -> int:
        """Number of joints."""
        return len(self.joint_types)

    @classmethod
    def own_sections(cls) -> list[Any]:
        """Tables of a joint in its file that its own drive adds."""
        return [*dict.fromkeys(row.section for name, row in cls.rows.items() if name not in PARAMETERS)]

    @property
    def joint_labels(self) -> list[str]:
        """Number of each joint, from 1, and its name, if it has one: for tables."""
        names = self.joint_names or ("",) * self.n
        return [f"{i} {name}".rstrip() for i, name in enumerate(names, 1)]

    def to_dict(self, looks: bool = True) -> dict[str, Any]:
        """Return the robot in the layout of its TOML file, as plain lists, numbers and strings; `looks` with visuals.

        `vdfmu.arm.robot.robot_file.robot_from_dict` is the inverse.
        """

        def numbers(name: Section, entry: Any) -> dict[str, Any]:
            return {r.key: getattr(self, r.name)[entry].tolist() for r in self.rows.values() if r.section == name}

        options: list[Section] = [part for part in JOINT_OPTIONS if getattr(self, part)]
        parts: tuple[Section, ...] = ("link", "drive", "friction", *options, *self.own_sections())
        return {
            "name": self.name,
            "description": self.description,
            "friction": self.friction,
            "rotor_coupling": self.rotor_coupling,
            **{flag: True for flag in ENDS if getattr(self, flag)},
            **({"drive": self.drive} if self.drive else {}),
            **numbers("robot", ()),
            **({"payload": numbers("payload", ())} if self.payload else {}),
            "joints": [
                {
                    **({"name": self.joint_names[i]} if any(self.joint_names[i : i + 1]) else {}),
                    "type": kind,
                    **numbers("joint", i),
                    **{part: numbers(part, i) for part in parts},
                }
                for i, kind in enumerate(self.joint_types)
            ],
            "sources": dict(self.sources),
            **({"visuals": [visual.to_dict() for visual in self.visuals]} if looks and self.visuals else {}),
        }

    def with_parameters(self, **arrays: npt.ArrayLike) -> Robot:
        """Return a copy with some numbers replaced; nothing physical is checked.

        Parameters
        ----------
        **arrays : array_like
            New values by field name. A value is broadcast to the shape of the field, so a scalar sets every
            joint.

        Raises
        ------
        UsageError
            If a name is not one of `PARAMETERS`, or a value does not fit its shape.
        """
        new: dict[str, Array] = {}
        for key, value in arrays.items():
            row = self.rows.get(key)
            if row is None:
                raise UsageError(f"robot {self.name}: no parameter {key!r}. There are: {', '.join(self.rows)}.")
            if row.section in OPTIONAL and not getattr(self, row.section):
                whose = "joints tables" if row.per_joint else "file a table"
                raise UsageError(f"robot {self.name}: {key}: it has no {row.section}. Give its {whose} [{row.table}].")
            shape = getattr(self, key).shape
            try:
                new[key] = read_only(np.broadcast_to(np.asarray(value, dtype=float), shape))
            except (TypeError, ValueError) as error:
                got = np.shape(value) if not isinstance(value, str) else repr(value)
                raise UsageError(f"robot {self.name}: {key}: expected numbers of shape {shape}, got {got}.") from error
        return dataclasses.replace(self, **new)

    def facts(self, entry: Entry) -> tuple[str, float, float, str]:
        """Return unit of measurement, minimum, maximum and description of a number."""
        row = self.rows[entry.field]
        counted = ",".join(str(i + 1) for i in entry.index)
        text = f"{row.description}{_PLACES[row.per_joint, len(row.shape)]} {counted}".rstrip()
        if row.per_joint and not row.shape:
            text = f"Joint {counted}: {row.description}"
        unit = row.unit(self.joint_types[entry.index[0]] if row.per_joint else "revolute")
        return unit, (-row.largest if row.smallest is None else row.smallest), row.largest, text

    def source_of(self, key: str) -> str | None:
        """Return where the number at `key`, such as ``joints[2].link.mass``, is from; None if not said.

        A per-joint entry overrides that of all joints, ``joints.link.mass``.
        """
        return self.sources.get(key, self.sources.get(joint_free(key)))


_PLACES = {
    (False, 0): "", (False, 1): ", axis", (False, 2): ", (row, column)",
    (True, 0): "", (True, 1): ", (link, axis)", (True, 2): ", (link, row, column)",
}  # fmt: skip
"""Whether each joint has its own and number of axes, to what the indices are."""


def _documented(row: Row) -> str:
    """Entry of the docstring of `Robot`."""
    shape = (*(("n",) if row.per_joint else ()), *row.shape)
    size = f"({', '.join(map(str, shape))}{',' if len(shape) == 1 else ''})"
    units = " or ".join(dict.fromkeys(row.unit(joint_type) for joint_type in JOINT_TYPES))
    text = row.description[0].upper() + row.description[1:]
    return f"{row.name} : {size} [{units}]\n    {text}."


_WORDS = inspect.cleandoc(Robot.__doc__ or "").replace("{options}", ", ".join(JOINT_OPTIONS))
Robot.__doc__ = "\n".join((_WORDS, *map(_documented, PARAMETERS.values())))


def joint_free(key: str) -> str:
    """Return a key without indices: ``joints[2].link.mass`` gives ``joints.link.mass``."""
    return re.sub(r"\[\d+\]", "", key)


def robot_argument(value: Any) -> Robot:
    """Return a robot that a user passed; UsageError for anything else, such as its name."""
    if not isinstance(value, Robot):
        raise UsageError(
            f"expected a Robot, got {type(value).__name__} {value!r:.60}. Load it with vdfmu.load_robot(path_or_name)."
        )
    return value
