"""A serial manipulator with flexible joints: its arrays and its run-time parameters."""

from __future__ import annotations

import dataclasses
import inspect
import json
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from hashlib import sha256
from typing import Any, ClassVar, Self

import casadi as ca
import numpy as np
import numpy.typing as npt

from vdfmu.arm.drive.option import Array, DriveOption
from vdfmu.arm.robot.drive_file import DriveFile
from vdfmu.arm.robot.parameters import ENDS, JOINT_OPTIONS, OPTIONAL, PARAMETERS, Parameters, Row, Section, read_only
from vdfmu.arm.robot.physical import requirements
from vdfmu.arm.robot.visual import Visual
from vdfmu.arm.world.payload import link_body
from vdfmu.base.cache import cached_per_command
from vdfmu.base.errors import UsageError
from vdfmu.base.measure import JOINT_TYPES
from vdfmu.base.sources import source_digest
from vdfmu.compiler.scalar import ZERO, Symbol
from vdfmu.compiler.unit.declaration import Entry

FRICTION_ARRANGEMENTS = ("lumped", "split")


@dataclass(frozen=True, eq=False, kw_only=True)
class Robot(Parameters):
    """Parameters of a serial chain of n links with revolute or prismatic joints and flexible drives.

    Frame {B_i} is fixed to link i, its z axis is the axis of joint i; {B_0} is the inertial frame {I}, {O} the
    end-effector frame. SI units, angles in rad. A unit after "or" applies to prismatic joints, whose motor side stays
    in rad and N.m. The kinematic error of Eq. (3) is ``A*sin(2*ell*kappa + phase)``.

    Nothing is checked here, because the equations also run with symbols as fields; `vdfmu.arm.robot.robot_file` does
    the checks.

    Parameters
    ----------
    name, description : str
        Name and description of the robot.
    joint_types : (n,) tuple of "revolute" or "prismatic"
    joint_names : (n,) tuple of str
        Names of the joints in the file of another tool; empty for none.
    friction : "lumped" or "split"
        Arrangement of the friction: all at the rotor, or Eq. (54) on the link and Eq. (55) on the rotor.
    rotor_coupling : bool
        Whether the rotors turn with the links that carry them, as bodies of Eq. (4), (7) and (11), or in pure
        rotation about their own axis, Eq. (56).
    sources : mapping of str to str
        Provenance: key of the robot file to the source of its number.
    payload : bool
        Whether the last link carries another body; the ``payload_`` fields are only used then.
    {options} : bool
        Whether joints have this option of the drives; the fields of its table, such as ``[joints.limits]``, are only
        used then.
    folded : bool
        Whether zeros of gravity, centres of mass and tool are constants of the functions; otherwise they are run-time
        parameters, like a payload.
    moving_base : bool
        Whether inputs of the plant move the base; otherwise it is at rest in {I}.
    coupled_tool : bool
        Whether the plant outputs the motion of its end effector and accepts a load with a mass.
    tool_on_last_axis : bool
        Whether {O} lies intentionally on the axis of the last joint, like a flange, so that the tool's position does
        not depend on that joint. Otherwise such a tool is reported as a likely mistake.
    visuals : tuple of Visual
        Shapes of the links in pictures; no calculation uses them.
    file : str
        Path or name from which it was loaded; empty for a shipped robot.
    """

    reader: ClassVar[str] = "vdfmu.arm.robot.robot_file:robot_from_dict"
    flags: ClassVar[tuple[str, ...]] = (*OPTIONAL, *ENDS)
    joint_fields: ClassVar[tuple[str, ...]] = tuple(
        name for name, row in PARAMETERS.items() if row.per_joint and not row.shape
    )

    def __post_init__(self) -> None:
        unknown = [kind for kind in self.joint_types if kind not in JOINT_TYPES]
        if unknown:
            raise UsageError(
                f"robot {self.name}: joint_types: expected {' or '.join(JOINT_TYPES)}, got {unknown[0]!r}. A screw "
                "that only moves its nut is a prismatic joint with ell = 2 pi / lead."
            )

    requirements = requirements
    body = link_body

    own_options: ClassVar[tuple[DriveOption, ...]] = ()
    """Options of its own drive; see :mod:`vdfmu.arm.robot.own_drive`."""
    drive: ClassVar[DriveFile | None] = None
    """File of its own drive."""

    name: str
    description: str
    joint_types: tuple[str, ...]
    friction: str
    rotor_coupling: bool
    sources: Mapping[str, str]
    payload: bool = False
    folded: bool = True
    moving_base: bool = False
    coupled_tool: bool = False
    tool_on_last_axis: bool = False
    visuals: tuple[Visual, ...] = ()
    joint_names: tuple[str, ...] = ()
    file: str = ""

    @property
    def n(self) -> int:
        """Number of joints."""
        return len(self.joint_types)

    @classmethod
    def own_sections(cls) -> list[Any]:
        """Tables of a joint in its file that belong to its own drive."""
        return [*dict.fromkeys(row.section for name, row in cls.rows.items() if name not in PARAMETERS)]

    @cached_per_command
    def entries(self) -> list[Entry]:
        """Run-time parameters, in the order of the parameter vector of every traced function.

        Structural zeros and fixed rotations are folded, which makes the functions three times as fast, but a folded
        number cannot change later.
        """
        return [
            Entry(name, index)
            for name, row in self.rows.items()
            for index in np.ndindex(getattr(self, name).shape)
            if row.is_free(self, index)
        ]

    def constants(self) -> list[str]:
        """Names of the numbers in its file that are not run-time parameters: whole arrays, or elements."""
        names: list[str] = []
        for name, row in self.rows.items():
            if row.section in OPTIONAL and not getattr(self, row.section):
                continue
            indices = [*np.ndindex(getattr(self, name).shape)]
            if row.fold == "inertia":  # symmetric
                indices = [index for index in indices if index[-2] <= index[-1]]
            fixed = [Entry(name, index).name for index in indices if not row.is_free(self, index)]
            names += [name] if len(fixed) == len(indices) else fixed
        return names

    def values(self) -> np.ndarray:
        """Parameter vector, in the order of :meth:`entries`."""
        return np.array([getattr(self, p.field)[p.index] for p in self.entries()], dtype=float)

    def with_values(self, vector: Sequence[float] | np.ndarray) -> Self:
        """Copy with another parameter vector."""
        return self._with_entries(self.entries(), list(vector), float)

    def symbolic(self) -> tuple[Self, ca.SX]:
        """Copy with symbols for run-time parameters, constants elsewhere; and the symbols' vector."""
        entries = self.entries()
        vector = ca.SX.sym("p", len(entries))
        arrays = {f.name: getattr(self, f.name) for f in dataclasses.fields(self)}
        constants = {name: _constants(array) for name, array in arrays.items() if isinstance(array, np.ndarray)}
        symbols = [Symbol(vector[i]) for i in range(len(entries))]
        return dataclasses.replace(self, **constants)._with_entries(entries, symbols, object), vector

    def _with_entries(self, entries: Sequence[Entry], new: Sequence[Any], dtype: Any) -> Self:
        arrays: dict[str, np.ndarray] = {}
        for entry, value in zip(entries, new, strict=True):
            array = arrays.setdefault(entry.field, np.array(getattr(self, entry.field), dtype=dtype))
            array[entry.index] = value
            if self.rows[entry.field].fold == "inertia":
                *joint, j, k = entry.index
                array[(*joint, k, j)] = value
        for array in arrays.values():
            array.flags.writeable = False
        return dataclasses.replace(self, **arrays)

    @cached_per_command
    def key(self) -> str:
        """Key of the traced functions, equal for robots that differ only in run-time parameters."""
        entries = self.entries()
        fixed = self.with_values([0.0] * len(entries))
        structure = {
            "source": source_digest("arm.kernel", "compiler.functions"),
            "joints": self.joint_types,
            "friction": self.friction,
            "rotor_coupling": self.rotor_coupling,
            "drive": self.drive.text if self.drive else "",
            "flags": [name for name in self.flags if getattr(self, name)],
            "parameters": [p.name for p in entries],
            "folded": {name: np.asarray(getattr(fixed, name), dtype=float).tolist() for name in self.rows},
        }
        return sha256(json.dumps(structure, sort_keys=True).encode()).hexdigest()[:32]

    @cached_per_command
    def joint(self, i: int) -> Self:
        """Return an arm with only joint `i`, counted from 0, without parameters that no equation uses."""
        arrays = {name: read_only(getattr(self, name)[[i]]) for name, row in self.rows.items() if row.per_joint}
        if self.friction == "lumped":
            arrays["f_ck"] = read_only(np.zeros(1))
        return dataclasses.replace(
            self,
            joint_types=(self.joint_types[i],),
            joint_names=(),
            visuals=(),
            payload=self.payload and i == self.n - 1,
            **arrays,
        )

    @property
    def joint_labels(self) -> list[str]:
        """Number of each joint, from 1, and its name if it has one, for tables."""
        names = self.joint_names or ("",) * self.n
        return [f"{i} {name}".rstrip() for i, name in enumerate(names, 1)]

    def to_dict(self, looks: bool = True) -> dict[str, Any]:
        """Return the content of its TOML file, with visuals if `looks`: the inverse of `robot_from_dict`.

        It names the file of a drive, whose text is in `files`.
        """

        def numbers(name: Section, entry: Any) -> dict[str, Any]:
            return {r.key: getattr(self, r.name)[entry].tolist() for r in self.rows.values() if r.section == name}

        options: list[Section] = [part for part in JOINT_OPTIONS if getattr(self, part)]
        parts: tuple[Section, ...] = ("link", "drive", "friction", *options, *self.own_sections())
        joints = [
            {
                **({"name": self.joint_names[i]} if any(self.joint_names[i : i + 1]) else {}),
                "type": kind,
                **numbers("joint", i),
                **{part: numbers(part, i) for part in parts},
            }
            for i, kind in enumerate(self.joint_types)
        ]
        texts = ("name", "description", "friction", "rotor_coupling")
        return {
            **{name: getattr(self, name) for name in texts},
            **{flag: True for flag in (*ENDS, "tool_on_last_axis") if getattr(self, flag)},
            **({} if self.folded else {"folded": False}),
            **({"drive": self.drive.name} if self.drive else {}),
            **numbers("robot", ()),
            **({"payload": numbers("payload", ())} if self.payload else {}),
            "joints": joints,
            "sources": dict(self.sources),
            **({"visuals": [visual.to_dict() for visual in self.visuals]} if looks and self.visuals else {}),
        }

    @property
    def files(self) -> dict[str, str]:
        """Name to text of the files that `to_dict` names."""
        return {self.drive.name: self.drive.text} if self.drive else {}

    def unfolded(self) -> Self:
        """Return a copy whose gravity, centres of mass, payload and tool, zeros included, are run-time parameters."""
        return dataclasses.replace(self, folded=False, payload=True)

    def with_parameters(self, **arrays: npt.ArrayLike) -> Robot:
        """Return an unchecked copy with other numbers, scalars for all joints. UsageError for a wrong name or shape."""
        new: dict[str, Array] = {}
        for key, value in arrays.items():
            row = self.rows.get(key)
            if row is None:
                raise UsageError(f"robot {self.name}: no parameter {key!r}. There are: {', '.join(self.rows)}.")
            if row.section in OPTIONAL and not getattr(self, row.section):
                whose = "joints tables" if row.per_joint else "file a table"
                raise UsageError(f"{key}: robot {self.name} has no {row.section}. Give its {whose} [{row.table}].")
            shape = getattr(self, key).shape
            try:
                new[key] = read_only(np.broadcast_to(np.asarray(value, dtype=float), shape))
            except (TypeError, ValueError) as error:
                got = np.shape(value) if not isinstance(value, str) else repr(value)
                raise UsageError(f"robot {self.name}: {key}: expected numbers of shape {shape}, got {got}.") from error
        return dataclasses.replace(self, **new)

    def facts(self, entry: Entry) -> tuple[str, float, float, str]:
        """Return unit of measurement, bounds and text of the variable for an entry."""
        row = self.rows[entry.field]
        counted = ",".join(str(i + 1) for i in entry.index)
        text = f"{row.description}{_PLACES[row.per_joint, len(row.shape)]} {counted}".rstrip()
        if row.per_joint and not row.shape:
            text = f"Joint {counted}: {row.description}"
        unit = row.unit(self.joint_types[entry.index[0]] if row.per_joint else "revolute")
        return unit, (-row.largest if row.smallest is None else row.smallest), row.largest, text

    def source_of(self, key: str) -> str | None:
        """Return the source of ``joints[2].link.mass``, else of all joints' ``joints.link.mass``, or None."""
        return self.sources.get(key, self.sources.get(joint_free(key)))


def _constants(array: np.ndarray) -> np.ndarray:
    out = np.empty(array.shape, dtype=object)
    for index in np.ndindex(array.shape):
        out[index] = Symbol(float(array[index])) if array[index] or np.signbit(array[index]) else ZERO
    return out


_PLACES = {
    (False, 0): "",
    (False, 1): ", axis",
    (False, 2): ", (row, column)",
    (True, 0): "",
    (True, 1): ", (link, axis)",
    (True, 2): ", (link, row, column)",
}
"""Whether it is per joint, and number of axes, to the label of the indices."""


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
    """Return a robot that a user passed; UsageError for another type, such as its name."""
    if not isinstance(value, Robot):
        raise UsageError(
            f"expected a Robot, got {type(value).__name__} {value!r:.60}. Load it with vdfmu.load_robot(path_or_name)."
        )
    return value
