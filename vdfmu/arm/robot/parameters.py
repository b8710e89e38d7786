"""The table of a robot's parameters, which declares every number of a robot once.

A new parameter is a field of `Parameters`, or of an option in `vdfmu.arm.drive`. The plant's torques, losses and
energies and the exact inverse must include it: ``tests/arm/laws/test_inverse_and_power.py`` walks the table. Exceptions
are declared in `NOT_INVERTED` and `NOT_BALANCED`.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, fields
from typing import Any, ClassVar, Literal

import numpy as np
import numpy.typing as npt

from vdfmu.arm.drive.option import Array, row
from vdfmu.arm.drive.options import OPTIONS, OptionName, OptionRows
from vdfmu.base.measure import LARGEST_NUMBER, POSITIVE, unit_of

Section = Literal["robot", "payload", "joint", "link", "drive", "friction"] | OptionName
Fold = Literal["never", "always", "zeros", "spare zeros", "inertia", "lumped friction"]

JOINT_OPTIONS: tuple[OptionName, ...] = tuple(OPTIONS)
"""Tables that either all joints of a robot have, or none."""
OPTIONAL: tuple[Section, ...] = ("payload", *JOINT_OPTIONS)
"""Optional sections of a robot; its flag has the same name."""
ENDS = ("moving_base", "coupled_tool")
"""Flags of a robot that couple one of its ends to its surroundings."""


def read_only(values: npt.ArrayLike) -> npt.NDArray[np.float64]:
    """Return a contiguous read-only float copy."""
    array = np.array(values, dtype=float)
    array.flags.writeable = False
    return array


@dataclass(frozen=True)
class Row:
    """One row of the table."""

    name: str
    """Field of `Robot` and group of the FMI variables."""
    section: Section
    """Place in the robot file: "robot" is its top level, "joint" the top level of each ``[[joints]]``, others are
    tables."""
    quantity: str
    """Unit of measurement, or a key of `unit_of` with different units for revolute and prismatic joints."""
    text: str
    """Description; ``Eq. {}`` cites `equation`."""
    equation: str = ""
    """Number of the paper's equation, "(2)"; empty if it is not in the paper."""
    largest: float = LARGEST_NUMBER
    """Largest absolute value in SI units, far above that of any machine."""
    smallest: float | None = None
    """Smallest value. `POSITIVE` means "above 0", None for minus the largest."""
    default: Any = None
    """Value of every entry, or all values, if it is not in the file. None if the file must have it."""
    shape: tuple[int, ...] = ()
    """Shape of one joint's value, or of the value itself."""
    fold: Fold = "never"
    """Entries that are constants of the functions, at no cost, instead of run-time parameters: none for "never", all
    for "always", zeros for "zeros", the zeros of a `folded` robot for "spare zeros", the off-diagonal zeros and the
    symmetric half for "inertia", all entries of an arm with lumped friction for "lumped friction"."""
    part_of: str = ""
    """Parameter of the joint that, if it is 0, switches this one off, which is then a constant."""
    hint: str = ""
    """Fix of a problem with it, by default the description."""
    foreign: str = ""
    """Its name in files of other tools: in a URDF's <limit> or <dynamics>, MJCF's armature and gravity, the tip."""
    scaled_as: str = ""
    """Word for scaling; parameters with the same word are scaled together."""
    start: Any = None
    """Start value in the unit of a single link or joint; None for the default, or 0. The unit of a joint always has the
    options without a state; with these values they have no effect, and results are bit-identical to those without
    them."""

    @property
    def per_joint(self) -> bool:
        """Whether each joint has its own value."""
        return self.section not in ("robot", "payload")

    @property
    def key(self) -> str:
        """Key in the table of the robot file."""
        return self.name.removeprefix(f"{self.section}_")

    @property
    def table(self) -> str:
        """Table of the robot file, ``joints.link``; empty for the top level of the file."""
        if not self.per_joint:
            return "" if self.section == "robot" else self.section
        return "joints" if self.section == "joint" else f"joints.{self.section}"

    @property
    def path(self) -> str:
        """Key in the robot file, as in its [sources]: ``joints.link.mass``."""
        return f"{self.table}.{self.key}".lstrip(".")

    @property
    def description(self) -> str:
        """The text with the number of the equation."""
        return self.text.replace("{}", self.equation)

    @property
    def fix(self) -> str:
        """Last sentence of a problem with it."""
        return self.hint or f"It is the {self.description[0].lower()}{self.description[1:]}."

    def unit(self, joint_type: str = "revolute") -> str:
        """Return the unit of measurement for a joint type."""
        return unit_of(self.quantity, joint_type)

    def is_free(self, robot: Any, index: tuple[int, ...]) -> bool:
        """Return whether an entry of this robot's array is a parameter at run time."""
        if self.section in OPTIONAL and not getattr(robot, self.section):
            return False
        if self.part_of and not getattr(robot, self.part_of)[index]:
            return False
        array = getattr(robot, self.name)
        match self.fold:
            case "zeros":
                return bool(array[index] != 0.0)
            case "spare zeros":
                return bool(not robot.folded or array[index] != 0.0)
            case "inertia":  # an all-zero inertia of a point mass has no parameters
                j, k = index[-2:]
                return bool((j == k and array.any()) or (j < k and array[index] != 0.0))
            case "lumped friction":
                return robot.friction == "split"
            case _:
                return self.fold == "never"


_VECTOR, _MATRIX = (3,), (3, 3)
_ALIGNED = ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0))
_MOMENTS = "One number (isotropic), 3 principal moments or a symmetric 3 x 3 matrix will do."


@dataclass(frozen=True, eq=False, kw_only=True)
class ArmParameters:
    """The table for every arm, without its options."""

    # fmt: off
    gravity: Array = row(
        "robot", "m/s2", "Gravity vector of Eq. {} in {I}, upward", "(62)", 1e4, shape=_VECTOR, fold="spare zeros",
        hint="Write +9.81 along the upward axis.", foreign="gravity", start=(0.0, 0.0, 9.81))
    tool_offset: Array = row(
        "robot", "m", "Origin of the end-effector frame {O} in the last link frame", "(44)", 1e4, default=0.0,
        shape=_VECTOR, fold="spare zeros", foreign="tip")
    tool_rotation: Array = row(
        "robot", "1", "Rotation matrix from {O} to the last link frame", "(44)", default=_ALIGNED, shape=_MATRIX,
        fold="always", foreign="tip_axes")
    payload_mass: Array = row(
        "payload", "kg", "Mass of the payload", "(51)", 1e6, 0.0, hint="Give 0 for none; it can be set at run time.",
        scaled_as="payload")
    payload_centroid: Array = row(
        "payload", "m", "Centre of mass of the payload in {O}", "(51)", 1e4, default=0.0, shape=_VECTOR)
    payload_inertia: Array = row(
        "payload", "kg.m2", "Inertia of the payload about its centre of mass", "(51)", 1e9, default=0.0,
        shape=_MATRIX, fold="inertia", hint=_MOMENTS)
    rotation: Array = row(
        "joint", "1", "Rotation matrix from the link frame to the frame of the previous link at q = 0", "(34)-(36)",
        shape=_MATRIX, fold="always", start=_ALIGNED)
    offset: Array = row(
        "joint", "m", "Origin of the link frame in the frame of the previous link", "(34)-(36)", 1e4, shape=_VECTOR,
        fold="zeros")
    centroid: Array = row(
        "link", "m", "Centre of mass in the link frame", "(60)", 1e4, shape=_VECTOR, fold="spare zeros")
    mass: Array = row("link", "kg", "mass of the link", "(60)", 1e6, POSITIVE, scaled_as="mass", start=1.0)
    inertia: Array = row(
        "link", "kg.m2", "Inertia about the centre of mass", "(60)", 1e9, shape=_MATRIX, fold="inertia",
        hint=_MOMENTS, scaled_as="mass", start=((0.1, 0.0, 0.0), (0.0, 0.1, 0.0), (0.0, 0.0, 0.1)))
    ell: Array = row(
        "drive", "ratio", "reduction ratio", "(1)", 1e6, 1.0,
        hint="Give the rotor angle for one unit of joint motion.", start=100.0)
    I_m: Array = row("drive", "rotor inertia", "rotor inertia times ell, Eq. {}", "(56)", 1e6, POSITIVE,
        foreign="armature", start=1e-3)
    K_f0: Array = row("drive", "stiffness", "flexspline stiffness, link-side, Eq. {}", "(2)", 1e12, POSITIVE,
        scaled_as="stiffness", start=1e4)
    c_f: Array = row(
        "drive", "per torque", "flexspline stiffening, link-side, Eq. {}", "(2)", 1e6, POSITIVE,
        hint="For a linear spring give a small value such as 1e-6.", start=1e-3)
    K_w0: Array = row("drive", "N.m/rad", "wave generator stiffness, motor-side, Eq. {}", "(3)", 1e12, POSITIVE,
        scaled_as="stiffness", start=1.0)
    c_w: Array = row(
        "drive", "1/(N.m)", "wave generator stiffening, motor-side, Eq. {}", "(3)", 1e9, POSITIVE,
        hint="For a linear spring give a small value such as 1e-3.", start=10.0)
    f_c: Array = row(
        "friction", "torque", "Coulomb friction, link-side, Eq. {}", "(54)", 1e9, 0.0, foreign="friction",
        scaled_as="friction")
    f_s: Array = row(
        "friction", "torque", "static friction, link-side, Eq. {}", "(54)", 1e9, 0.0, foreign="friction",
        scaled_as="friction")
    f_v: Array = row(
        "friction", "damping", "viscous friction, link-side, Eq. {}", "(54)", 1e9, 0.0, foreign="damping",
        scaled_as="friction")
    v_s: Array = row(
        "friction", "velocity", "Stribeck velocity, Eq. {}", "(54)", 1e6, POSITIVE,
        hint="For friction without the Stribeck effect set f_s = f_c.", start=0.1)
    eps: Array = row(
        "friction", "velocity", "velocity that regularises sgn as tanh(v/eps)", "(54)-(55)", 1e6, POSITIVE,
        default=1e-3)
    f_ck: Array = row(
        "friction", "N.m", "Coulomb friction of the rotor, motor-side, Eq. {}", "(55)", 1e9, 0.0,
        fold="lumped friction", scaled_as="friction")


@dataclass(frozen=True, eq=False, kw_only=True)
class Parameters(OptionRows, ArmParameters):
    """The table, whose fields are rows in the order of the FMI value references. Arrays have the joint axis first."""

    rows: ClassVar[dict[str, Row]]
    """Name of a parameter to its row: :data:`PARAMETERS`, and the rows of the robot's own drive."""

    # fmt: off
    theta_err_amplitude: Array = row(
        "drive", "position", "amplitude of the kinematic error, link-side, Eq. {}", "(3)", 1.0, 0.0, default=0.0,
        fold="zeros", hint="Give 0 for none; shift the phase by pi for a sign.")
    theta_err_phase: Array = row(
        "drive", "rad", "phase of the kinematic error, Eq. {}", "(3)", 1e6, default=0.0,
        part_of="theta_err_amplitude")


PARAMETERS = {f.name: Row(f.name, *f.metadata["row"], **f.metadata["rest"]) for f in fields(Parameters) if f.metadata}
"""Name of a parameter to its row."""
Parameters.rows = PARAMETERS


NOT_INVERTED: Mapping[str, str] = {
    "rotor_coupling": "the acceleration of each rotor takes two more derivatives of q_d for each joint before it",
    "hysteresis": "its torque depends on the past",
    "bristles": "their torque depends on the past",
    "winding": "the current follows with the bandwidth of its loop",
    "thermal": "the oil has the temperature of the surroundings",
    "limits": "no torque takes a joint through its stops, or a motor beyond its own",
}
"""Options, flags and parameters that affect the plant but not its exact inverse, with reasons."""
NOT_BALANCED: Mapping[str, str] = {
    "theta_err_amplitude": "the rotor feels tau_s / ell, whatever the kinematic error does, as the paper has it",
    "theta_err_phase": "as the amplitude",
    "stop_damping": "the stops get warm, not the drives, whose losses heat them",
}
"""Parameters whose power is in neither the losses nor the energies, with reasons."""


def section(name: Section) -> list[Row]:
    """Return the rows of a section."""
    return [row for row in PARAMETERS.values() if row.section == name]


SPRING_KEYS = tuple(row.name for row in section("drive") if row.name != "I_m")
"""Parameters on which the deformation of a drive depends: all of the drive except the inertia of its rotor."""
