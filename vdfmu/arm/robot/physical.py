"""Physical checks of robots; each notes what it finds in a `Problems`."""

from __future__ import annotations

from collections.abc import Mapping
from types import SimpleNamespace
from typing import Any

import numpy as np

from vdfmu.arm.drive.option import DriveOption
from vdfmu.arm.robot.parameters import PARAMETERS
from vdfmu.base.arrays import Floats
from vdfmu.base.toml_tables import Problems, shown

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
        problems.add(key, "a symmetric matrix", shown(inertia.tolist()), "Make entries [i][j] and [j][i] equal.")
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


def check_drive(problems: Problems, key: str, ell: float, theta_err_amplitude: float) -> None:
    """Note a kinematic error so large that the rotor position does not follow from the spring."""
    slope = 2 * ell * theta_err_amplitude
    if slope >= CONTRACTION_LIMIT:
        problems.add(
            f"{key}.theta_err_amplitude",
            f"2*ell*theta_err_amplitude < {CONTRACTION_LIMIT:g}",
            f"{slope:.6g}",
            f"Lower the amplitude below {CONTRACTION_LIMIT / (2 * ell):.6g}.",
        )


def check_friction(problems: Problems, key: str, f_c: float, f_s: float) -> None:
    """Note a static friction below the Coulomb friction."""
    if f_s < f_c:
        problems.add(
            f"{key}.f_s",
            f"f_s >= f_c = {f_c:g} (static friction is not below Coulomb friction)",
            f"{f_s:g}",
            "Set f_s = f_c for friction without the Stribeck effect.",
        )


def check_option(problems: Problems, key: str, option: DriveOption, joint: Mapping[str, Any]) -> None:
    """Note parameters of an option that a joint, field of `Robot` to its value, cannot have."""
    for name in option.revolute_only:
        if joint["type"] == "prismatic" and joint[name] != 0.0:
            problems.add(f"{key}.{name}", "0 at a prismatic joint", f"{joint[name]:g}", "Its law is that of a turn.")
    for condition in option.conditions:
        whole, value = PARAMETERS[condition.name].part_of, joint[condition.name]
        bound = condition.value(SimpleNamespace(**joint))
        if value <= bound and (not whole or joint[whole] != 0.0):
            text = condition.bound if condition.bound == "0" else f"{condition.bound} = {bound:g}"
            problems.add(f"{key}.{condition.name}", f"{condition.name} > {text}", f"{value:g}", condition.way_out)
