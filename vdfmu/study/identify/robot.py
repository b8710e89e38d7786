"""A robot file of identified parameters."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np

from vdfmu.arm.equations.rigid_body import body_parameters
from vdfmu.arm.imports.write import ROUNDING
from vdfmu.arm.robot import Robot, check_robot
from vdfmu.arm.robot.parameters import PARAMETERS
from vdfmu.base.arrays import Floats
from vdfmu.base.errors import ModelError
from vdfmu.base.toml_text import toml_text
from vdfmu.study.identify.base import link_errors
from vdfmu.study.identify.fit import Identified
from vdfmu.study.identify.problem import DRIVES, SPRINGS


def identified_robot(found: Identified, robot: Robot, where: str) -> tuple[Robot, list[str]]:
    """Return the robot with the identified values, whose sources name the log, and notes.

    Base parameters leave the parameters of the links open: of all that match, the ones nearest to the robot file are
    taken, of the same shape if possible. If these are not parameters of bodies, the links stay as they are. `robot` is
    the one used for the identification, and `where` names the log, for sources.
    """
    values = dict(zip(found.names, found.values, strict=True))
    sources, arrays, notes = dict(robot.sources), dict[str, Any](), list[str]()
    text = f"Identified from {where}"
    deviation = dict(zip(found.names, found.deviation, strict=True))
    for name in (*DRIVES, *SPRINGS, *(["F_cb"] if robot.counterbalance else [])):
        own = [f"{name}[{i + 1}]" for i in range(robot.n)]
        arrays[name] = np.array([values.get(each, here) for each, here in zip(own, getattr(robot, name), strict=True)])
        for i, each in enumerate(own):
            if each not in found.held and deviation.get(each, 0.0) > 0.0:
                path = PARAMETERS[name].path.replace("joints", f"joints[{i + 1}]", 1)
                told = f"{text}, +- {1.96 * deviation[each]:.2g} (95 %)"
                sources[path] = f"{told}, near {sources.get(path, 'the robot file')}" if each in found.weak else told
    made = robot.with_parameters(**arrays)
    links = _links(found, robot)
    if robot.payload:
        notes.append("the links stay as they are: the payload is identified with the last of them")
    else:
        try:
            bodies = check_robot(made.with_parameters(**links))
        except ModelError as error:
            notes.append(f"the links stay as they are, for what was identified is that of no bodies: {error}")
        else:
            made = bodies
            nearest = f"{text}: with its base parameters, nearest to the robot file"
            sources |= {PARAMETERS[name].path: nearest for name in links}
    return replace(check_robot(made), sources=sources), notes


def _links(found: Identified, robot: Robot) -> dict[str, Floats]:
    """Mass, centre of mass and inertia of the links, with the base parameters and nearest to the robot file."""
    phi, ways = body_parameters(robot), link_errors(robot, 1.0)
    base, matrix = found.values[found.links], found.base.matrix
    steps: Any = np.linalg.lstsq(matrix @ ways, base - matrix @ phi, rcond=None)[0]
    m, x, y, z, *I = (phi + ways @ steps).reshape(-1, 10).T
    c = np.stack([x, y, z], axis=1) / m[:, None]
    rows = [[I[0], I[1], I[3]], [I[1], I[2], I[4]], [I[3], I[4], I[5]]]
    about_origin = np.moveaxis(np.array(rows), -1, 0)
    square = np.einsum("ni,ni->n", c, c)[:, None, None] * np.eye(3) - np.einsum("ni,nj->nij", c, c)
    return {"mass": m, "centroid": c, "inertia": about_origin - m[:, None, None] * square}


def robot_text(robot: Robot, head: str) -> str:
    """Return the content of a robot file, under a comment."""
    return f"# {head}\n# SI units, angles in rad.\n\n{toml_text(robot.to_dict(), ROUNDING)}"
