"""Physical checks of robots and scenarios; each notes what it finds in a `Problems`."""

from __future__ import annotations

import numpy as np

from vdfmu.model.read import FloatArray, Problems, shown
from vdfmu.model.scenario import Scenario

# Entries of a rotation are at most 1, so ten printed digits leave R R^T - E below 1e-9.
ROTATION_TOLERANCE = 1e-9
# A thin body meets the triangle inequality with equality; rounding of the eigenvalues stays far below this.
INERTIA_TOLERANCE = 1e-9
# kappa = q + D + theta_err(kappa) is solved by iteration; its error shrinks by 2 ell A at every pass.
CONTRACTION_LIMIT = 0.5
# stop/step is one rounded division, wrong by about 1e-16 of itself.
STEP_TOLERANCE = 1e-9
MOST_STEPS = 10**9
"""Communication steps of a run: 11 days at 1 kHz."""


def check_rotation(problems: Problems, key: str, rotation: FloatArray) -> None:
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
            key,
            "a rotation of determinant +1",
            "determinant -1",
            "It mirrors: change the sign of one column.",
        )


def check_inertia(problems: Problems, key: str, inertia: FloatArray) -> None:
    """Note an inertia, shape (3, 3) [kg.m2], that no rigid body has."""
    if not np.isfinite(inertia).all():
        return
    scale = float(np.abs(inertia).max())
    if np.abs(inertia - inertia.T).max() > INERTIA_TOLERANCE * scale:
        problems.add(
            key, "a symmetric matrix", shown(inertia.tolist()), "Make entries [i][j] and [j][i] equal."
        )
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


def check_stops(problems: Problems, key: str, q_min: float, q_max: float) -> None:
    """Note a lower end stop that is not below the upper one."""
    if q_min >= q_max:
        problems.add(
            f"{key}.q_max", f"q_max > q_min = {q_min:g}", f"{q_max:g}", "The joint moves between them."
        )


def model_notes(scenario: Scenario) -> list[str]:
    """Return what of a robot and its motion looks like a wrong sign or unit of measurement, though it may be meant."""
    robot = scenario.robot
    notes: list[str] = []
    size = float(np.abs(robot.gravity).max())
    if size > _STRONG_GRAVITY:
        notes.append(f"gravity of {size:g} m/s2 looks like another unit: 9.81 m/s2 on Earth.")
    elif -robot.gravity.min() > max(1.0, robot.gravity.max()):
        k = int(robot.gravity.argmin())
        notes.append(
            f"gravity[{k + 1}] = {robot.gravity[k]:g} m/s2 pulls towards +: it is written upward, +9.81 on the axis "
            "that points up."
        )
    masses = robot.mass.tolist() + ([float(robot.payload_mass)] if robot.payload else [])
    heavy = [m for m in masses if m > _HEAVY_LINK]
    if heavy:
        notes.append(f"a mass of {max(heavy):g} kg looks like grams.")
    angles = {f"trajectory.{name}": getattr(scenario.trajectory, name) for name in ("q_start", "q_end")}
    if robot.limits:
        angles |= {"q_min": robot.q_min, "q_max": robot.q_max}
    revolute = np.array([joint == "revolute" for joint in robot.joint_types])
    for name, q in angles.items():
        wide = np.flatnonzero(revolute & (np.abs(q) > _WIDE_ANGLE))
        if wide.size:
            i = int(wide[0])
            notes.append(f"{name}[{i + 1}] = {q[i]:g} rad looks like degrees: {np.radians(q[i]):.4g} rad.")
    return notes


_STRONG_GRAVITY = 30.0
"""Above that of every planet [m/s2], below 980 cm/s2."""
_HEAVY_LINK = 500.0
"""Links of the largest industrial robots have some hundred kg; a link of half a kilogram has 500 g."""
_WIDE_ANGLE = 4.0 * np.pi
"""Two turns [rad]: more than the joints of common arms make, less than 13 degrees."""


def check_step(problems: Problems, stop: float, step: float) -> None:
    """Note a stop time that is not a whole number of communication steps."""
    if not (stop > 0 and step > 0):
        return
    steps = stop / step
    if steps > MOST_STEPS:
        problems.add(
            "stop",
            f"at most {MOST_STEPS:g} steps of {step:g} s",
            f"{stop:g} s",
            "Give an earlier end or a longer step.",
        )
        return
    whole = max(1, round(steps))
    if abs(steps - whole) > STEP_TOLERANCE * whole:
        problems.add(
            "stop",
            f"a multiple of step = {step:g} s",
            f"{stop:g} s",
            f"The nearest is {whole * step:.12g} s.",
        )
