"""Mass and inertia of bodies: joined from links, from a file of drives, or of shapes with one density."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import replace
from math import pi
from typing import Any, NamedTuple

import numpy as np

from vdfmu.arm.imports.tree import Body, Numbers, Tree
from vdfmu.arm.robot.parameters import section
from vdfmu.arm.robot.physical import check_inertia
from vdfmu.arm.robot.visual import Visual
from vdfmu.base.arrays import Floats


class Mass(NamedTuple):
    """Mass [kg], its centre (3,) [m], and the inertia about that (3, 3) [kg.m2], in one frame."""

    mass: float
    centroid: Floats
    inertia: Floats


def joined(parts: Sequence[Mass]) -> Mass:
    """Join masses to one."""
    if len(parts) == 1:
        return parts[0]  # without rounding
    mass = sum(part.mass for part in parts)
    center = sum((part.mass * part.centroid for part in parts), np.zeros(3)) / (mass or 1.0)
    inertia = np.zeros((3, 3))
    for part in parts:
        d = part.centroid - center
        inertia += part.inertia + part.mass * (d @ d * np.eye(3) - np.outer(d, d))
    return Mass(mass, center, inertia)


def of_shapes(shapes: Iterable[Visual]) -> Mass | None:
    """Return mass and inertia of solid shapes of 1 kg/m3, their volumes added; None without shapes or with a mesh."""
    parts: list[Mass] = []
    for shape in shapes:
        size: Any = shape.size
        match shape.shape:
            case "box":
                volume, moments = size.prod(), (size @ size - size**2) / 12.0
            case "sphere":
                volume, moments = 4.0 / 3.0 * pi * size[0] ** 3, np.full(3, 0.4 * size[0] ** 2)
            case "cylinder":
                across = (3.0 * size[0] ** 2 + size[1] ** 2) / 12.0
                volume, moments = pi * size[0] ** 2 * size[1], np.array([across, across, size[0] ** 2 / 2.0])
            case _:
                return None
        R = shape.rotation
        parts.append(Mass(abs(float(volume)), shape.offset, abs(float(volume)) * R @ np.diag(moments) @ R.T))
    whole = joined(parts)
    return whole if whole.mass else None


def with_inertia(
    bodies: Sequence[Body], chosen: Sequence[Numbers], density: float | None, file: str, tree: Tree
) -> tuple[Body, ...]:
    """Return bodies with the numbers of ``link`` in a file of drives, or else with their shapes' inertia.

    Shapes count if a body lacks mass or inertia, and their density [kg/m3] or the mass of the body is known. Bodies,
    and their entries `chosen` of the file of drives, go from base to tip; numbers of shapes are added to `chosen`.
    `file` is the robot's, for sources. `tree` takes notes and problems.
    """
    problems = tree.problems
    wholes: list[Body] = []
    for body, numbers in zip(bodies, chosen, strict=True):
        rows = section("link")
        names = ", ".join(body.links)
        values = {row.name: numbers[row.path][0] for row in rows if row.path in numbers}
        mass = values.get("mass", body.mass)
        shape = of_shapes(body.shapes)
        if not (body.mass and body.inertia.any()) and shape and (density or "mass" in values):
            mass = mass or (density or 0.0) * shape.mass
            solid = {"mass": mass, "centroid": shape.centroid, "inertia": shape.inertia * (mass / shape.mass)}
            solid_of = f"shapes of {names} in {file}, {mass / shape.mass:.6g} kg/m3"
            tree.notes.append(f"joint {body.joint.name}: {mass:.4g} kg, with the inertia of the {solid_of}.")
            kept = ("mass", "centroid") if body.mass else ()
            for row in (row for row in rows if row.name not in values and row.name not in kept):
                values[row.name] = solid[row.name]
                numbers[row.path] = solid[row.name], f"Assumed: {solid_of}"
        whole = replace(body, **values)
        wholes.append(whole)
        ways = (
            f"Give them by --drives: [{body.joint.name}] link = {{ mass, centroid, inertia }}; the mass alone, or "
            "--density, will do for a body of boxes, cylinders and spheres"
        )
        if not whole.mass:
            problems.add(
                f"joint {body.joint.name}", "a link with mass, which it moves",
                f"no <inertial> with a mass in {names}", f'{ways}. Or make the joint type="fixed".',
            )  # fmt: skip
        elif not whole.inertia.any():
            got = "principal moments 0, 0, 0 kg.m2"
            problems.add(f"link {names}", "positive definite, in kg.m2", got, f"{ways}.")
        else:
            check_inertia(problems, f"link {names}", whole.inertia)
    return tuple(wholes)
