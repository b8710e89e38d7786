"""Conditions that the run-time parameters of a robot must meet together, as margins that can be traced.

They are the checks of :mod:`vdfmu.arm.robot.physical`, for inertias without eigenvalues, so that a native unit can
evaluate them.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from vdfmu.arm.drive.option import Condition
from vdfmu.arm.drive.options import options_of
from vdfmu.arm.robot.physical import CONTRACTION, INERTIA_TOLERANCE, STATIC_FRICTION
from vdfmu.arm.robot.structure import parameters
from vdfmu.compiler.scalar.generic import minimum
from vdfmu.compiler.unit.machine import STRICT, Entry, Requirement


def requirements(robot: Any) -> list[Requirement]:
    """Return the conditions of a robot, joint by joint."""
    listed = dict.fromkeys(parameters(robot))
    conditions = [one for option, _ in options_of(robot) for one in option.conditions]
    inertias: list[list[Entry]] = [[] for _ in range(robot.n)]
    for p in listed:
        if p.field == "inertia":
            inertias[p.index[0]].append(p)
    found: list[Requirement] = []
    for i, inertia in enumerate(map(tuple, inertias)):
        found += [
            _of_joint(condition, i)
            for condition in (STATIC_FRICTION, *conditions, CONTRACTION)
            if Entry(condition.name, (i,)) in listed
        ]
        found += _of_inertia(inertia)
    payload = tuple(p for p in listed if p.field == "payload_inertia")
    return found + (_of_inertia(payload) if payload else [])


def _of_joint(condition: Condition, i: int) -> Requirement:
    entries = tuple(Entry(name, (i,)) for name in condition.names)
    least = STRICT if condition.strict else 0.0
    return Requirement(condition.text, entries, lambda arm, at: condition.margin(arm)[at.index] - least)


def _of_inertia(inertia: tuple[Entry, ...]) -> list[Requirement]:
    text = "no principal moment of inertia above the sum of the other two"
    return [
        Requirement(
            "a positive definite inertia matrix",
            inertia,
            lambda arm, at: _smallest_minor(getattr(arm, at.field)[at.index[:-2]]),
        ),
        Requirement(text, inertia, _triangle),
    ]


def _triangle(robot: Any, first: Entry) -> Any:
    """Margin of ``tr(I)/2 E - I``, the second moments of mass, being semidefinite."""
    inertia = getattr(robot, first.field)[first.index[:-2]]
    half_trace = 0.5 * (inertia[0, 0] + inertia[1, 1] + inertia[2, 2])
    # check_inertia allows INERTIA_TOLERANCE times the largest moment, which is about half the trace where it counts
    return _smallest_minor(half_trace * (1.0 + 0.5 * INERTIA_TOLERANCE) * np.eye(3) - inertia)


def _smallest_minor(A: Any) -> Any:
    """Smallest leading minor of a symmetric matrix, (3, 3): above zero if it is positive definite."""
    a, b, c, d, e, f = A[0, 0], A[0, 1], A[0, 2], A[1, 1], A[1, 2], A[2, 2]
    minor_2 = a * d - b * b
    minor_3 = a * (d * f - e * e) - b * (b * f - c * e) + c * (b * e - c * d)
    return minimum(minimum(a, minor_2), minor_3) - STRICT
