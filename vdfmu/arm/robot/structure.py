"""Which numbers of a robot stay parameters at run time, and which are folded into the traced functions.

Structural zeros and the fixed rotations of the frames are folded: the functions are three times as fast for
it. A folded value cannot be changed later, so :func:`parameters` is the one list of what can; the table of
:mod:`vdfmu.arm.robot.parameters` says of each entry whether it can.
"""

from __future__ import annotations

import dataclasses
import json
from collections.abc import Sequence
from hashlib import sha256
from typing import Any, TypeVar

import casadi as ca
import numpy as np

from vdfmu.arm.robot.parameters import ENDS, OPTIONAL, Parameters, read_only
from vdfmu.compiler.functions.sources import source_digest
from vdfmu.compiler.scalar import ZERO, Symbol
from vdfmu.compiler.unit.declaration import Entry

R = TypeVar("R", bound=Parameters)


def parameters(robot: Parameters) -> list[Entry]:
    """Run-time parameters of a robot, in the order of the parameter vector of every traced function."""
    return [
        Entry(name, index)
        for name, row in robot.rows.items()
        for index in np.ndindex(getattr(robot, name).shape)
        if row.is_free(robot, index)
    ]


def values(robot: Parameters) -> np.ndarray:
    """Parameter vector of a robot, in the order of :func:`parameters`."""
    return np.array([getattr(robot, p.field)[p.index] for p in parameters(robot)], dtype=float)


def set_parameters(robot: R, vector: Sequence[float] | np.ndarray) -> R:
    """Copy of a robot with the run-time parameters replaced by `vector`; the inverse of :func:`values`."""
    return _replace(robot, parameters(robot), list(vector), float)


def symbolic_robot(robot: R) -> tuple[R, ca.SX]:
    """Copy of a robot with symbols for run-time parameters, constants elsewhere; and the symbols' vector."""
    listed = parameters(robot)
    vector = ca.SX.sym("p", len(listed))
    constants = {
        f.name: _constants(getattr(robot, f.name))
        for f in dataclasses.fields(robot)
        if isinstance(getattr(robot, f.name), np.ndarray)
    }
    robot = dataclasses.replace(robot, **constants)
    return _replace(robot, listed, [Symbol(vector[i]) for i in range(len(listed))], object), vector


def _constants(array: np.ndarray) -> np.ndarray:
    out = np.empty(array.shape, dtype=object)
    for index in np.ndindex(array.shape):
        out[index] = Symbol(float(array[index])) if array[index] or np.signbit(array[index]) else ZERO
    return out


def _replace(robot: R, listed: Sequence[Entry], new: Sequence[Any], dtype: Any) -> R:
    arrays: dict[str, np.ndarray] = {}
    for parameter, value in zip(listed, new, strict=True):
        array = arrays.setdefault(parameter.field, np.array(getattr(robot, parameter.field), dtype=dtype))
        array[parameter.index] = value
        if robot.rows[parameter.field].fold == "inertia":
            *joint, j, k = parameter.index
            array[(*joint, k, j)] = value
    for array in arrays.values():
        array.flags.writeable = False
    return dataclasses.replace(robot, **arrays)


_UNLIKE = 3
"""Joints at each end that may be unlike the others in a robot of which shorter ones are the same."""

_MANY = 1.1
"""Joints by those of the shorter robots together from which these are traced in less time than the robot itself."""


def shorter_robots(robot: Any) -> list[Any]:
    """Return two robots without joints of the middle, where these repeat after one, two or four; else none.

    The traced functions of a long robot follow from theirs.
    """
    n = len(robot.joint_types)
    listed = parameters(robot)
    fixed = set_parameters(robot, [0.0] * len(listed))
    arrays = {name: getattr(robot, name) for name, row in robot.rows.items() if row.per_joint}
    free: list[list[tuple[str, tuple[int, ...]]]] = [[] for _ in range(n)]
    for p in listed:
        if p.field in arrays:
            free[p.index[0]].append((p.field, p.index[1:]))
    folded = [[getattr(fixed, name)[i].tobytes() for name in arrays] for i in range(n)]
    kinds = list(zip(robot.joint_types, free, folded, strict=True))
    inner = kinds[_UNLIKE : n - _UNLIKE]
    period = next((p for p in (1, 2, 4) if inner[p:] == inner[:-p]), None)
    if period is None:
        return []
    step, least = (2, 14) if period == 1 else (4, 20)  # signs may alternate
    first = least + (n - least) % step
    sizes = [first, first + step]
    if n < max(_MANY * sum(sizes), sizes[-1] + 3 * step):
        return []
    found: list[Any] = []
    for m in sizes:
        kept = [*range(m // 2), *range(n - m + m // 2, n)]
        parts = {name: read_only(array[kept]) for name, array in arrays.items()}
        joint_types = tuple(robot.joint_types[i] for i in kept)
        found.append(dataclasses.replace(robot, joint_types=joint_types, joint_names=(), visuals=(), **parts))
    return found


def structure_key(robot: Any) -> str:
    """Key of the traced functions: equal for robots that differ in run-time parameters only."""
    listed = parameters(robot)
    fixed = set_parameters(robot, [0.0] * len(listed))
    structure = {
        "source": source_digest("arm.kernel", "compiler.functions"),
        "joints": robot.joint_types,
        "friction": robot.friction,
        "rotor_coupling": robot.rotor_coupling,
        "flags": [name for name in (*OPTIONAL, *ENDS) if getattr(robot, name)],
        "parameters": [p.name for p in listed],
        "folded": {name: np.asarray(getattr(fixed, name), dtype=float).tolist() for name in robot.rows},
        "drive": robot.drive,
    }
    return sha256(json.dumps(structure, sort_keys=True).encode()).hexdigest()[:32]
