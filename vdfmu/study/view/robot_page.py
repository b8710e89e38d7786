"""The page of a robot: the arm of the page of a run, with sliders in place of a run."""

from __future__ import annotations

from collections.abc import Sequence
from html import escape
from typing import Any

import numpy as np

from vdfmu.arm.robot import Robot
from vdfmu.base.arrays import Floats
from vdfmu.base.page import page
from vdfmu.study.analysis.modes import MOTORS
from vdfmu.study.report.content import arm_of
from vdfmu.study.report.curves import packed
from vdfmu.study.report.scripts import ROBOT, data_element, libraries, look, module_element
from vdfmu.study.report.shapes import Chain, DrawnShape, drawing_of, own_shapes
from vdfmu.study.view.shapes import centres


def robot_page(
    robot: Robot,
    q: Floats,
    sliders: Sequence[dict[str, Any]],
    ellipsoids: Sequence[DrawnShape],
    meshes: Sequence[dict[str, Any]],
    notes: Sequence[str],
) -> bytes:
    """Return the page of a robot at a pose q, (n,) [rad or m]."""
    arm = arm_of(robot, {})
    travel = np.maximum(np.abs(robot.q_min), np.abs(robot.q_max)) if robot.limits else np.full(robot.n, 0.5)
    drawing = drawing_of(arm, travel)
    if meshes:
        drawing["parts"] = [*meshes, *(part.plain() for part in own_shapes([v.to_dict() for v in robot.visuals]))]
    frames = {
        "time": packed(np.zeros(1), "<f8"),
        "q": packed(q[:, None], "<f4"),
        "recipes": {"q": [[1.0, []]] * robot.n},
    }
    content = {
        "runs": [{"name": robot.name, "arm": drawing, "frames": frames, "figures": [], "signals": [], "copies": {}}],
        "robot": {
            "sliders": sliders,
            "motors": MOTORS,
            "weightless": Chain(arm).weightless,
            "centres": [[body, p.tolist()] for body, p in centres(robot)],
            "ellipsoids": [part.plain() for part in ellipsoids],
        },
    }
    told = "".join(f"<li>{escape(note)}</li>" for note in notes)
    body = "\n".join(
        [
            '<div class="bench"><section id="arm" class="card" aria-label="The arm in 3D"></section><div class="side">',
            *(f'<section id="{name}" class="card" aria-label="{title}"></section>' for name, title in _SECTIONS),
            "</div></div>",
            f'<section class="card"><h2>Notes</h2><ul>{told}</ul></section>' if notes else "",
            data_element(content),
            libraries(),
            module_element(ROBOT),
        ]
    )
    what = robot.description or f"A robot of {robot.n} joints"
    return page(robot.name, what, body, 92, f'{look()}<link rel="icon" href="data:,">')


_SECTIONS = (("joints", "Joints"), ("modes", "Modes"))
