"""A serial manipulator with flexible joints, as one structure of arrays."""

from __future__ import annotations

import dataclasses
import re
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np
import numpy.typing as npt

from vdfmu.errors import UsageError

Array = npt.NDArray[Any]

JOINT_TYPES = ("revolute", "prismatic")
FRICTION_ARRANGEMENTS = ("lumped", "split")
GEOMETRY_KEYS = ("rotation", "offset")
LINK_KEYS = ("mass", "centroid", "inertia")
SPRING_KEYS = ("ell", "K_f0", "c_f", "K_w0", "c_w", "theta_err_amplitude", "theta_err_phase")
"""What the deformation of a drive depends on."""
DRIVE_KEYS = ("ell", "I_m", *SPRING_KEYS[1:])
FRICTION_KEYS = ("f_c", "f_s", "f_v", "v_s", "f_ck", "eps")
LIMIT_KEYS = ("q_min", "q_max", "stop_stiffness", "stop_damping", "tau_stall", "kappa_dot_max")
JOINT_FIELDS = (*GEOMETRY_KEYS, *LINK_KEYS, *DRIVE_KEYS, *FRICTION_KEYS)
"""Fields of `Robot` with one entry a joint."""
PAYLOAD_FIELDS = ("payload_mass", "payload_centroid", "payload_inertia")
WHOLE_FIELDS = ("gravity", "tool_offset", *PAYLOAD_FIELDS)
"""Fields with one entry for the whole arm."""
ARRAY_FIELDS = (*WHOLE_FIELDS, *JOINT_FIELDS, *LIMIT_KEYS)
"""Every field of `Robot` that holds numbers."""


@dataclass(frozen=True, eq=False)
class Robot:
    """Parameters of a serial chain of n links on revolute or prismatic joints with flexible drives.

    Frame {B_i} is fixed to link i, its z axis is the axis of joint i; {B_0} is the inertial frame {I}. SI
    units, angles in rad. For a prismatic joint read "rad" on the link side as "m" and "N.m" as "N": q in m,
    tau_s in N, ell in rad/m. The motor side stays rad and N.m.

    Nothing is checked here: the equations also run with fields that hold symbols. `vdfmu.model.load` checks.

    Parameters
    ----------
    name, description : str
        What the robot is called and what it is.
    joint_types : (n,) tuple of "revolute" or "prismatic"
    rotation : (n, 3, 3)
        Axes of {B_i} in {B_(i-1)} at q_i = 0: the constant part of Eq. (34)-(36).
    offset : (n, 3) [m]
        Origin of {B_i} in {B_(i-1)} at q_i = 0.
    mass : (n,) [kg]
    centroid : (n, 3) [m]
        Centre of mass of link i in {B_i}.
    inertia : (n, 3, 3) [kg.m2]
        About the centre of mass, axes of {B_i}.
    gravity : (3,) [m/s2]
        In {I}, +9.81 along the upward axis: the sign of Eq. (62).
    tool_offset : (3,) [m]
        Origin of the end-effector frame {O} in {B_n}.
    ell : (n,) [1]
        Reduction ratio. rad/m for a prismatic joint.
    I_m : (n,) [kg.m2]
        Inertia of the rotor times ell, Eq. (56).
    K_f0 : (n,) [N.m/rad], link side
        Flexspline stiffness at zero torque, Eq. (2).
    c_f : (n,) [1/(N.m)], link side
        Growth of the flexspline stiffness, Eq. (2).
    K_w0 : (n,) [N.m/rad], motor side
        Wave generator stiffness at zero torque, Eq. (3).
    c_w : (n,) [1/(N.m)], motor side
        Growth of the wave generator stiffness, Eq. (3).
    theta_err_amplitude, theta_err_phase : (n,) [rad]
        Kinematic error of Eq. (3), ``A*sin(2*ell*kappa + phase)``, amplitude on the link side.
    f_c, f_s : (n,) [N.m]
        Coulomb and static friction, Eq. (54).
    f_v : (n,) [N.m.s/rad]
        Viscous friction, Eq. (54).
    v_s : (n,) [rad/s]
        Stribeck velocity, Eq. (54).
    f_ck : (n,) [N.m], motor side
        Coulomb friction of the rotor, Eq. (55).
    eps : (n,) [rad/s]
        Width of tanh(v/eps), which stands for sgn(v) in Eq. (54)-(55).
    friction : "lumped" or "split"
        Arrangement of the friction: all at the rotor, or Eq. (54) on the link and Eq. (55) on the rotor.
    rotor_coupling : bool
        Whether the rotors turn with the links that carry them, as bodies of Eq. (4), (7) and (11), or in pure
        rotation about their own axis, Eq. (56).
    sources : mapping of str to str
        Provenance: key of the robot file to where its number is from.
    payload : bool
        Whether the last link carries a body of its own; the fields below count only then.
    payload_mass : () [kg]
    payload_centroid : (3,) [m]
        Its centre of mass in {O}.
    payload_inertia : (3, 3) [kg.m2]
        About its centre of mass, axes of {O}. Zero is a point mass.
    limits : bool
        Whether joints have end stops and motors a torque-speed line; the fields below count only then.
    q_min, q_max : (n,) [rad]
        Where the end stops begin.
    stop_stiffness : (n,) [N.m/rad]
    stop_damping : (n,) [s/rad]
        Damping of the stops over their stiffness and depth.
    tau_stall : (n,) [N.m], motor side
        Largest torque of the motor.
    kappa_dot_max : (n,) [rad/s]
        Speed at which the motor has no torque left, divided by ell.
    """

    name: str
    description: str
    joint_types: tuple[str, ...]
    rotation: Array
    offset: Array
    mass: Array
    centroid: Array
    inertia: Array
    gravity: Array
    tool_offset: Array
    ell: Array
    I_m: Array
    K_f0: Array
    c_f: Array
    K_w0: Array
    c_w: Array
    theta_err_amplitude: Array
    theta_err_phase: Array
    f_c: Array
    f_s: Array
    f_v: Array
    v_s: Array
    f_ck: Array
    eps: Array
    friction: str
    rotor_coupling: bool
    sources: Mapping[str, str]
    payload: bool = False
    payload_mass: Array = field(default_factory=lambda: read_only(0.0))
    payload_centroid: Array = field(default_factory=lambda: read_only(np.zeros(3)))
    payload_inertia: Array = field(default_factory=lambda: read_only(np.zeros((3, 3))))
    limits: bool = False
    q_min: Array = field(default_factory=lambda: read_only([]))
    q_max: Array = field(default_factory=lambda: read_only([]))
    stop_stiffness: Array = field(default_factory=lambda: read_only([]))
    stop_damping: Array = field(default_factory=lambda: read_only([]))
    tau_stall: Array = field(default_factory=lambda: read_only([]))
    kappa_dot_max: Array = field(default_factory=lambda: read_only([]))

    @property
    def n(self) -> int:
        """Number of joints."""
        return len(self.joint_types)

    def to_dict(self) -> dict[str, Any]:
        """Return the robot in the layout of its TOML file, as plain lists, numbers and strings.

        `vdfmu.model.load.robot_from_dict` is the inverse.
        """
        return {
            "name": self.name,
            "description": self.description,
            "friction": self.friction,
            "rotor_coupling": self.rotor_coupling,
            "gravity": self.gravity.tolist(),
            "tool_offset": self.tool_offset.tolist(),
            **(
                {"payload": {key: getattr(self, f"payload_{key}").tolist() for key in LINK_KEYS}}
                if self.payload
                else {}
            ),
            "joints": [
                {
                    "type": self.joint_types[i],
                    **{key: getattr(self, key)[i].tolist() for key in GEOMETRY_KEYS},
                    "link": {key: getattr(self, key)[i].tolist() for key in LINK_KEYS},
                    "drive": {key: float(getattr(self, key)[i]) for key in DRIVE_KEYS},
                    "friction": {key: float(getattr(self, key)[i]) for key in FRICTION_KEYS},
                    **(
                        {"limits": {key: float(getattr(self, key)[i]) for key in LIMIT_KEYS}}
                        if self.limits
                        else {}
                    ),
                }
                for i in range(self.n)
            ],
            "sources": dict(self.sources),
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
            If a name is not one of `ARRAY_FIELDS`, or a value does not fit its shape.
        """
        new: dict[str, Array] = {}
        for key, value in arrays.items():
            if key not in ARRAY_FIELDS:
                raise UsageError(
                    f"robot {self.name}: no parameter {key!r}. There are: {', '.join(ARRAY_FIELDS)}."
                )
            if key in PAYLOAD_FIELDS and not self.payload:
                raise UsageError(
                    f"robot {self.name}: {key}: it has no payload. Give its file a table [payload]."
                )
            if key in LIMIT_KEYS and not self.limits:
                raise UsageError(
                    f"robot {self.name}: {key}: it has no limits. Give its joints tables [joints.limits]."
                )
            shape = getattr(self, key).shape
            try:
                new[key] = read_only(np.broadcast_to(np.asarray(value, dtype=float), shape))
            except (TypeError, ValueError) as error:
                got = np.shape(value) if not isinstance(value, str) else repr(value)
                raise UsageError(
                    f"robot {self.name}: {key}: expected numbers of shape {shape}, got {got}."
                ) from error
        return dataclasses.replace(self, **new)

    def source_of(self, key: str) -> str | None:
        """Return where the number at `key`, such as ``joints[2].link.mass``, is from; None if not said.

        An entry for the very joint goes before the one for all joints, ``joints.link.mass``.
        """
        return self.sources.get(key, self.sources.get(joint_free(key)))


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


def read_only(values: npt.ArrayLike) -> npt.NDArray[np.float64]:
    """Return a contiguous float copy that refuses assignment."""
    array = np.array(values, dtype=float)
    array.flags.writeable = False
    return array
