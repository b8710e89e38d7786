"""`RobotView`: a robot at the pose of sliders, its frames, masses and modes."""

from __future__ import annotations

import math
import time as clock
from collections.abc import Callable, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from html import escape
from pathlib import Path
from typing import Any

import numpy as np

from vdfmu.arm.robot import Robot
from vdfmu.base.arrays import Floats
from vdfmu.base.errors import VdfmuError
from vdfmu.base.measure import JOINT_UNITS
from vdfmu.base.page import page
from vdfmu.study.analysis.modes import MOTORS, Modes, middle_pose, natural_modes
from vdfmu.study.report.scripts import data_element, libraries, look, packed, scripts_of
from vdfmu.study.report.shapes import Chain, DrawnShape, centres, drawing_of, inertia_parts, mesh_parts, own_shapes
from vdfmu.study.run.scene import arm_of
from vdfmu.study.view.server import PERIOD, PageServer

_SECTIONS = (("joints", "Joints"), ("modes", "Modes"))
_REST = 0.3
"""Time without a moving slider before modes are calculated anew [s]."""


class RobotView:
    """A robot in a browser, with a slider for each joint.

    Parameters
    ----------
    robot : Robot
    folder : Path, optional
        Folder of the robot's meshes.
    port : int, optional
        Port on loopback; default a free one.

    Raises
    ------
    UsageError
        If the port is taken.
    """

    def __init__(self, robot: Robot, folder: Path | None = None, port: int | None = None) -> None:
        self.robot = robot
        self._q: Floats = np.array(middle_pose(robot))
        self._motors, self._from = MOTORS[0], ""
        ellipsoids, self.notes = inertia_parts(robot)
        meshes, notes = mesh_parts(robot, folder)
        self.notes += notes
        """Parts of the robot that the view lacks."""
        self.sliders = [_slider(robot, i, float(self._q[i])) for i in range(robot.n)]
        """Limits and start of the slider of each joint, in its unit."""
        self._pool = ThreadPoolExecutor(1)
        self._future: Future[Modes] | None = None
        self._asked: Any = None
        self._seen: tuple[tuple[Any, ...], float] = ((), -math.inf)
        self.modes: Modes | None = None
        """At the pose and with the motors of the page, once they are calculated."""
        self._facts: dict[str, Any] = {}
        self._server = PageServer(port, self._take)
        self.address = self._server.address
        page = _page(robot, self._q, self.sliders, ellipsoids, meshes, self.notes)
        self._server.show(page, first=lambda: self._pose() | self._facts)

    @property
    def pose(self) -> Floats:
        """Pose that is shown, (n,) [rad or m]."""
        return self._q.copy()

    def _take(self, request: dict[str, Any]) -> None:
        """Take pose, motors and the name of a page, and pass them on to other pages; ValueError for others."""
        values, motors = request.get("q"), request.get("motors")
        numbers = [x for x in values if isinstance(x, float) and math.isfinite(x)] if isinstance(values, list) else []
        if len(numbers) != self.robot.n or numbers != values or motors not in MOTORS:
            raise ValueError
        self._q, self._motors, self._from = np.array(numbers), motors, str(request.get("from"))
        self._server.send(self._pose)

    def _pose(self) -> dict[str, Any]:
        return {"q": self._q.tolist(), "motors": self._motors, "from": self._from}

    def run(self, ended: Callable[[], bool] = lambda: False) -> None:
        """Find the modes at the pose of the sliders, until it has ended or Ctrl-C comes."""
        began = clock.monotonic()
        while not ended():
            self.step(clock.monotonic() - began)
            clock.sleep(PERIOD)

    def step(self, time: float) -> None:
        """Begin to find modes, or send found ones; the pose rests by increasing times [s]."""
        q, motors = self._q, self._motors
        asked = (*q, motors)
        if asked != self._seen[0]:
            self._seen = asked, time
        if asked != self._asked and self._future is None and time > self._seen[1] + _REST:
            self._asked = asked
            self._future = self._pool.submit(natural_modes, self.robot, q, motors=motors)
        if self._future is not None and self._future.done():
            self._facts, self._future = self._take_modes(self._future), None
            self._server.send(lambda: self._facts)

    def _take_modes(self, future: Future[Modes]) -> dict[str, Any]:
        """Take modes; return their facts for the page, or the reason of their absence."""
        try:
            self.modes = modes = future.result()
        except VdfmuError as error:
            self.modes = None
            return {"modes": [], "words": str(error)}
        return {"words": "", "modes": [mode_facts(modes, k) for k in range(len(modes.frequency))]}

    def show(self, q: Floats) -> None:
        """Show a pose, (n,) [rad or m]."""
        self._q, self._from = np.array(q, dtype=float), ""
        self._server.send(self._pose)

    def close(self) -> None:
        """End the server."""
        self._pool.shutdown(wait=False, cancel_futures=True)
        self._server.close()


def _slider(robot: Robot, i: int, q: float) -> dict[str, Any]:
    """Return ends and start of the slider of a joint, to a tenth of its unit within the end stops."""
    kind = robot.joint_types[i]
    unit = JOINT_UNITS[kind]
    low, high = (-np.pi, np.pi) if kind == "revolute" else (-0.5, 0.5)
    if robot.limits:
        low, high = float(robot.q_min[i]), float(robot.q_max[i])
    ends = [math.ceil(10.0 * unit.factor * low) / 10.0, math.floor(10.0 * unit.factor * high) / 10.0]
    start = min(max(unit.factor * q, ends[0]), ends[1])
    return {"unit": unit.position, "factor": unit.factor, "low": ends[0], "high": ends[1], "start": start}


def mode_facts(modes: Modes, k: int) -> dict[str, Any]:
    """Return the page's facts of mode k: real and imaginary parts of its shape, scaled to a largest length of 1."""
    shape = modes.links[k]
    shape = shape / (float(np.abs(shape).max()) or 1.0)
    joint = int(modes.joint[k])
    return {
        "frequency": float(modes.frequency[k]),
        "damping": float(modes.damping[k]),
        "joint": joint + 1,
        "share": float(modes.share[k, joint]),
        "real": shape.real.tolist(),
        "imaginary": shape.imag.tolist(),
    }


def _page(
    robot: Robot, q: Floats, sliders: Sequence[dict[str, Any]], ellipsoids: Sequence[DrawnShape],
    meshes: Sequence[dict[str, Any]], notes: Sequence[str],
) -> bytes:  # fmt: skip
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
        "runs": [{"name": robot.name, "arm": drawing, "frames": frames, "figures": [], "signals": []}],
        "robot": {
            "sliders": sliders,
            "motors": MOTORS,
            "weightless": Chain(arm).weightless,
            "centres": [[body, p.tolist()] for body, p in centres(robot)],
            "ellipsoids": [part.plain() for part in ellipsoids],
        },
    }
    items = "".join(f"<li>{escape(note)}</li>" for note in notes)
    body = "\n".join(
        [
            '<div class="bench"><section id="arm" class="card" aria-label="The arm in 3D"></section><div class="side">',
            *(f'<section id="{name}" class="card" aria-label="{title}"></section>' for name, title in _SECTIONS),
            "</div></div>",
            f'<section class="card"><h2>Notes</h2><ul>{items}</ul></section>' if notes else "",
            data_element(content),
            libraries(),
        ]
    )
    about = robot.description or f"A robot of {robot.n} joints"
    return page(robot.name, about, body, 92, look(), scripts=scripts_of("robot"))
