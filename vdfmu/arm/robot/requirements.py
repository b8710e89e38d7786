"""Conditions that the run-time parameters of a robot must meet together, as margins that can be traced.

The same conditions as those of :mod:`vdfmu.arm.robot.physical`, written without eigenvalues so that a native unit can
evaluate them.
"""

from __future__ import annotations

import re
from typing import Any

import numpy as np

from vdfmu.arm.drive.option import Condition
from vdfmu.arm.drive.options import options_of
from vdfmu.arm.robot.physical import CONTRACTION_LIMIT, INERTIA_TOLERANCE
from vdfmu.arm.robot.structure import parameters
from vdfmu.compiler.scalar.generic import minimum
from vdfmu.compiler.unit.machine import STRICT, Entry, Requirement


def requirements(robot: Any) -> list[Requirement]:
    """Return the conditions of a robot, joint by joint."""
    listed = dict.fromkeys(parameters(robot))
    inertias: list[list[Entry]] = [[] for _ in range(robot.n)]
    for p in listed:
        if p.field == "inertia":
            inertias[p.index[0]].append(p)
    found: list[Requirement] = []
    for i, inertia in enumerate(map(tuple, inertias)):
        f_c, f_s = Entry("f_c", (i,)), Entry("f_s", (i,))
        amplitude, ell = Entry("theta_err_amplitude", (i,)), Entry("ell", (i,))
        found.append(Requirement("f_s >= f_c", (f_s, f_c), lambda arm, at: arm.f_s[at.index] - arm.f_c[at.index]))
        found += [
            _of_option(condition, i)
            for option, _ in options_of(robot)
            for condition in option.conditions
            if Entry(condition.name, (i,)) in listed
        ]
        if amplitude in listed:
            text = f"2*ell*theta_err_amplitude < {CONTRACTION_LIMIT:g}"
            found.append(Requirement(text, (ell, amplitude), _kinematic_error))
        found += _of_inertia(inertia)
    payload = tuple(p for p in listed if p.field == "payload_inertia")
    return found + (_of_inertia(payload) if payload else [])


def _of_option(condition: Condition, i: int) -> Requirement:
    names = [condition.name, *re.findall(r"[A-Za-z]\w*", condition.bound)]
    return Requirement(
        f"{condition.name} > {condition.bound}",
        tuple(Entry(name, (i,)) for name in names),
        lambda arm, at: getattr(arm, at.field)[at.index] - condition.value(arm)[at.index] - STRICT,
    )


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


def _kinematic_error(robot: Any, first: Entry) -> Any:
    return CONTRACTION_LIMIT - 2.0 * robot.ell[first.index] * robot.theta_err_amplitude[first.index] - STRICT


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
