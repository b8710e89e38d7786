"""Physical checks of robots; each notes what it finds in a `Problems`."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from types import SimpleNamespace
from typing import Any

import numpy as np

from vdfmu.arm.drive.option import Condition
from vdfmu.arm.robot.parameters import PARAMETERS
from vdfmu.base.arrays import Floats
from vdfmu.base.toml_tables import Problems, value_text

# Entries of a rotation are at most 1, so ten printed digits leave R R^T - E below 1e-9.
ROTATION_TOLERANCE = 1e-9
# A thin body meets the triangle inequality with equality; rounding of the eigenvalues stays far below this.
INERTIA_TOLERANCE = 1e-9
# kappa = q + D + theta_err(kappa) is solved by iteration; its error shrinks by 2 ell A at every pass.
CONTRACTION_LIMIT = 0.5


def check_rotation(problems: Problems, key: str, rotation: Floats) -> None:
    """Note a rotation, shape (3, 3), that is not orthogonal or turns right-handed axes left-handed."""
    if not np.isfinite(rotation).all():
        return
    error = float(np.abs(rotation @ rotation.T - np.eye(3)).max())
    if error > ROTATION_TOLERANCE:
        got = f"a matrix with |R R^T - E| up to {error:.3g}"
        expected = f"an orthogonal matrix (to {ROTATION_TOLERANCE:g})"
        problems.add(key, expected, got, "Write the axes of B_i as columns, with at least 10 digits.")
    elif np.linalg.det(rotation) < 0:
        problems.add(
            key, "a rotation of determinant +1", "determinant -1", "It mirrors: change the sign of one column."
        )


def check_inertia(problems: Problems, key: str, inertia: Floats) -> None:
    """Note an inertia, shape (3, 3) [kg.m2], that no rigid body has."""
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
        problems.add(
            key,
            "no principal moment above the sum of the other two (triangle inequality)",
            got,
            "Give the inertia about the centre of mass; check products of inertia and units.",
        )


CONTRACTION = Condition(
    "theta_err_amplitude",
    f"2*ell*theta_err_amplitude < {CONTRACTION_LIMIT:g}",
    lambda robot: CONTRACTION_LIMIT - 2.0 * robot.ell * robot.theta_err_amplitude,
    "Lower the amplitude, or the rotor's position does not follow from the spring.",
)
STATIC_FRICTION = Condition(
    "f_s",
    "f_s >= f_c",
    lambda robot: robot.f_s - robot.f_c,
    "Set f_s = f_c for friction without the Stribeck effect.",
    strict=False,
)


def check_conditions(problems: Problems, path: str, conditions: Iterable[Condition], joint: Mapping[str, Any]) -> None:
    """Note conditions that a joint at `path`, field of `Robot` to its value, does not meet."""
    for condition in conditions:
        row, margin = PARAMETERS[condition.name], condition.margin(SimpleNamespace(**joint))
        broken = margin <= 0.0 if condition.strict else margin < 0.0
        if broken and (not row.part_of or joint[row.part_of] != 0.0):
            got = ", ".join(f"{name} = {joint[name]:g}" for name in condition.names)
            problems.add(f"{path}.{row.section}.{row.key}", condition.text, got, condition.way_out)
