"""Serial chains of any length that repeat one link."""

from __future__ import annotations

import dataclasses

import numpy as np

from vdfmu.arm.robot import Robot, load_robot
from vdfmu.arm.robot.parameters import PARAMETERS


def repeated_link(n: int, seed: int = 1) -> Robot:
    """Chain of `n` equal links on revolute joints, with skewed axes and no structural zero but the drives'.

    Parameters
    ----------
    seed : int
        Decides the link: rotation, offset, mass, centre of mass and full inertia.
    """
    random = np.random.default_rng(seed)
    Q, _ = np.linalg.qr(random.normal(size=(3, 3)))
    points = random.normal(scale=0.1, size=(8, 3))
    points -= points.mean(axis=0)
    mass = random.uniform(0.5, 3.0)
    link = {
        "rotation": Q * np.sign(np.linalg.det(Q)),
        "offset": random.normal(scale=0.2, size=3),
        "mass": mass,
        "centroid": random.normal(scale=0.1, size=3),
        "inertia": mass / 8 * sum(np.dot(p, p) * np.eye(3) - np.outer(p, p) for p in points),
    }
    pattern = load_robot("manipulator_6dof")  # its first drive and friction, which rigid dynamics do not use
    fields = {name: link.get(name, getattr(pattern, name)[0]) for name, row in PARAMETERS.items() if row.per_joint}
    return dataclasses.replace(
        pattern,
        name=f"chain_{n}",
        description=f"{n} equal links",
        joint_types=("revolute",) * n,
        gravity=np.array([1.0, -2.0, 9.5]),
        tool_offset=np.array([0.05, -0.1, 0.2]),
        tool_rotation=np.eye(3),
        sources={},
        joint_names=(),
        **{name: np.repeat(np.asarray(value, dtype=float)[None], n, axis=0) for name, value in fields.items()},
    )


def random_motion(n: int, seed: int = 2) -> list[np.ndarray]:
    """Positions, velocities and accelerations, each (n,)."""
    random = np.random.default_rng(seed)
    return [random.uniform(-a, a, n) for a in (np.pi, 2.0, 5.0)]
