"""Physical conditions of robots: checks that add to `Problems`, and traceable margins without eigenvalues."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from itertools import groupby
from types import SimpleNamespace
from typing import Any

import numpy as np

from vdfmu.arm.drive.option import Condition
from vdfmu.arm.drive.options import options_of
from vdfmu.arm.robot.parameters import PARAMETERS, Row
from vdfmu.base.arrays import Floats
from vdfmu.base.toml_tables import Problems, value_text
from vdfmu.compiler.scalar import minimum
from vdfmu.compiler.unit.declaration import STRICT, Entry, Requirement

# Entries of a rotation are at most 1, so ten printed digits leave R R^T - E below 1e-9.
ROTATION_TOLERANCE = 1e-9
# A thin body meets the triangle inequality with equality; rounding of the eigenvalues is far below this.
INERTIA_TOLERANCE = 1e-9
# kappa = q + D + theta_err(kappa) is solved by iteration, whose error shrinks by 2 ell A in every step.
CONTRACTION_LIMIT = 0.5


def check_rotation(problems: Problems, key: str, rotation: Floats) -> None:
    """Add a problem if a rotation, (3, 3), is not orthogonal or is a reflection."""
    if not np.isfinite(rotation).all():
        return
    error = float(np.abs(rotation @ rotation.T - np.eye(3)).max())
    if error > ROTATION_TOLERANCE:
        got = f"a matrix with |R R^T - E| up to {error:.3g}"
        expected = f"an orthogonal matrix (to {ROTATION_TOLERANCE:g})"
        problems.add(key, expected, got, "Write the axes of B_i as columns, with at least 10 digits.")
    elif np.linalg.det(rotation) < 0:
        problems.add(
            key, "a rotation of determinant +1", "determinant -1", "It is a reflection: change the sign of one column."
        )


def check_inertia(problems: Problems, key: str, inertia: Floats) -> None:
    """Add a problem if no rigid body can have the inertia, (3, 3) [kg.m2]."""
    if not np.isfinite(inertia).all():
        return
    scale = float(np.abs(inertia).max())
    if np.abs(inertia - inertia.T).max() > INERTIA_TOLERANCE * scale:
        problems.add(key, "a symmetric matrix", value_text(inertia.tolist()), "Make entries [i][j] and [j][i] equal.")
        return
    moments = np.linalg.eigvalsh(inertia)
    got = "principal moments " + ", ".join(f"{moment:.6g}" for moment in moments) + " kg.m2"
    if moments[0] <= 0:
        problems.add(key, "positive definite, in kg.m2", got, "Every principal moment of a body is > 0.")
    elif moments[0] + moments[1] < moments[2] * (1 - INERTIA_TOLERANCE):
        expected = "no principal moment above the sum of the other two (triangle inequality)"
        fix = "Give the inertia about the centre of mass; check products of inertia and units."
        problems.add(key, expected, got, fix)


CONTRACTION = Condition(
    "theta_err_amplitude",
    f"2*ell*theta_err_amplitude < {CONTRACTION_LIMIT:g}",
    lambda robot: CONTRACTION_LIMIT - 2.0 * robot.ell * robot.theta_err_amplitude,
    "Lower the amplitude; otherwise the spring does not determine the rotor's position uniquely.",
)
STATIC_FRICTION = Condition(
    "f_s",
    "f_s >= f_c",
    lambda robot: robot.f_s - robot.f_c,
    "Set f_s = f_c for friction without the Stribeck effect.",
    strict=False,
)


def check_conditions(
    problems: Problems,
    path: str,
    conditions: Iterable[Condition],
    joint: Mapping[str, Any],
    rows: Mapping[str, Row] = PARAMETERS,
) -> None:
    """Add problems for violated conditions of a joint at `path`, given by field of `Robot` and value."""
    for condition in conditions:
        row, margin = rows[condition.name], condition.margin(SimpleNamespace(**joint))
        broken = margin <= 0.0 if condition.strict else margin < 0.0
        if broken and (not row.part_of or joint[row.part_of] != 0.0):
            got = ", ".join(f"{name} = {joint[name]:g}" for name in condition.names)
            problems.add(f"{path}.{row.section}.{row.key}", condition.text, got, condition.fix)


def requirements(robot: Any) -> list[Requirement]:
    """Return the conditions of a robot, joint by joint."""
    entries = dict.fromkeys(robot.entries())
    conditions = (STATIC_FRICTION, *(c for option, _ in options_of(robot) for c in option.conditions), CONTRACTION)
    inertias = groupby((p for p in entries if p.field == "inertia"), lambda p: p.index[0])
    listed: list[Requirement] = []
    for i, inertia in inertias:
        listed += [_of_joint(condition, i) for condition in conditions if Entry(condition.name, (i,)) in entries]
        listed += _of_inertia(tuple(inertia))
    payload = tuple(p for p in entries if p.field == "payload_inertia")
    return listed + (_of_inertia(payload) if payload else [])


def _of_joint(condition: Condition, i: int) -> Requirement:
    entries = tuple(Entry(name, (i,)) for name in condition.names)
    least = STRICT if condition.strict else 0.0
    return Requirement(condition.text, entries, lambda arm, at: condition.margin(arm)[at.index] - least)


def _of_inertia(inertia: tuple[Entry, ...]) -> list[Requirement]:
    def definite(arm: Any, at: Entry) -> Any:
        return _smallest_minor(getattr(arm, at.field)[at.index[:-2]])

    text = "no principal moment of inertia above the sum of the other two"
    return [Requirement("a positive definite inertia matrix", inertia, definite), Requirement(text, inertia, _triangle)]


def _triangle(robot: Any, first: Entry) -> Any:
    """Margin by which ``tr(I)/2 E - I``, the matrix of second moments of mass, is positive definite."""
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
