"""What the page of a robot draws beside its shapes: ellipsoids of inertia, centres of mass, meshes."""

from __future__ import annotations

from importlib import import_module
from pathlib import Path
from typing import Any

import numpy as np

from vdfmu.arm.equations.rigid_body import principal
from vdfmu.arm.robot import Robot
from vdfmu.arm.robot.visual import read_mesh
from vdfmu.base.arrays import Floats
from vdfmu.study.report.scripts import packed
from vdfmu.study.report.shapes import DrawnShape, hex_of


def half_axes(mass: float, moments: Floats) -> Floats:
    """Half-axes (3,) [m] of the uniform solid ellipsoid with a mass [kg] and principal moments of inertia [kg.m2].

    Its moments about the centre of mass are ``I_x = m (b^2 + c^2) / 5`` and so on (Meriam and Kraige, Engineering
    Mechanics: Dynamics, Table D/4), so ``a^2 = 5 (I_y + I_z - I_x) / (2 m)``. Flat or thin bodies have axes of 0.
    """
    squares = 2.5 * (moments.sum() - 2.0 * moments) / mass
    return np.sqrt(np.maximum(squares, 0.0))


def inertia_parts(robot: Robot) -> tuple[list[DrawnShape], list[str]]:
    """Ellipsoids of inertia of links and payload, with axes at least 1 % of the longest, and notes on missing ones."""
    of_link = zip(robot.mass, robot.centroid, robot.inertia, strict=True)
    bodies = [(f"link {i}", i, *numbers) for i, numbers in enumerate(of_link, 1)]
    if robot.payload:
        p, R = robot.tool_offset, robot.tool_rotation
        centroid, inertia = p + R @ robot.payload_centroid, R @ robot.payload_inertia @ R.T
        bodies.append(("payload", robot.n, robot.payload_mass, centroid, inertia))
    parts: list[DrawnShape] = []
    notes: list[str] = []
    for name, body, mass, centroid, inertia in bodies:
        if not float(mass) > 0.0:
            notes.append(f"{name} has no mass")
            continue
        moments, axes = principal(inertia)
        if moments[0] < 0.0 or 2.0 * moments[2] > moments.sum() * (1.0 + 1e-9):
            notes.append(f"{name}: no body has principal moments {', '.join(f'{each:.3g}' for each in moments)}")
        size = half_axes(float(mass), moments)
        if not size.max() > 0.0:
            notes.append(f"{name} is a point mass")
            continue
        size = np.maximum(size, 0.01 * size.max())
        parts.append(DrawnShape(body, "ellipsoid", size.tolist(), centroid, axes, "#7c3aed"))
    return parts, notes


def centres(robot: Robot) -> list[tuple[int, Floats]]:
    """Body, and centre of mass in its frame [m], of each link that has a mass."""
    masses = zip(robot.mass, robot.centroid, strict=True)
    return [(i, centroid) for i, (mass, centroid) in enumerate(masses, 1) if float(mass) > 0.0]


def mesh_parts(robot: Robot, folder: Path | None) -> tuple[list[dict[str, Any]], list[str]]:
    """Meshes of a robot, and notes on unreadable files. One hides all meshes: half an arm could look complete."""
    meshes = [visual for visual in robot.visuals if visual.shape == "mesh"] if folder else []
    parts: list[dict[str, Any]] = []
    notes: list[str] = []
    try:
        _ = import_module("trimesh") if meshes else None
    except ImportError as error:
        install = "Install a reader: 'pip install vdfmu[view]'"
        return [], [f"{len(meshes)} meshes cannot be shown: {error}. {install}"]
    for visual in meshes:
        try:
            corners, triangles = read_mesh(Path(folder or "") / visual.file, visual.size)
        except Exception as error:  # a reader of a foreign format may raise anything
            notes.append(f"mesh {visual.file} cannot be shown: {error}")
            continue
        arrays = {"corners": packed(corners, "<f4"), "triangles": packed(triangles, "<u4")}
        look = (visual.offset, visual.rotation, hex_of(visual.color))
        shape = DrawnShape(visual.joint, "mesh", visual.size.tolist(), *look)
        parts.append(shape.plain() | {"mesh": arrays})
    return ([], notes) if notes else (parts, [])
