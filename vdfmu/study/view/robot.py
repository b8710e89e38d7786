"""`RobotView`: a robot at the pose of sliders, its frames, masses and modes."""

from __future__ import annotations

import contextlib
import io
import math
import time as clock
from collections.abc import Callable
from concurrent.futures import Future, ThreadPoolExecutor
from pathlib import Path
from typing import Any

import numpy as np

from vdfmu.arm.robot import Robot
from vdfmu.base.arrays import Floats
from vdfmu.base.errors import VdfmuError
from vdfmu.study.analysis.modes import MOTORS, Modes, middle_pose, natural_modes
from vdfmu.study.report.content import arm_of
from vdfmu.study.report.joints import UNITS
from vdfmu.study.report.shapes import Chain, turn_to
from vdfmu.study.view.scene import PERIOD, ArmScene, address, open_server, stage
from vdfmu.study.view.shapes import centres, inertia_parts

_REST = 0.3
"""Time for which the sliders rest before modes are calculated anew [s]."""
_SECONDS = 1.5
"""Time that a cycle of any mode takes on the screen [s]."""

_LOOKS = {"solid": None, "see-through": 0.4, "hidden": None}
"""Looks of links, and their opacity."""


class RobotView:
    """A robot in a browser, with a slider for each joint.

    Parameters
    ----------
    robot : Robot
    folder : Path, optional
        Folder relative to which the robot names its meshes.
    port : int, optional
        Port on loopback; default a free one.

    Raises
    ------
    UsageError
        viser is missing, or the port is taken.
    """

    def __init__(self, robot: Robot, folder: Path | None = None, port: int | None = None) -> None:
        self.robot, self._server = robot, open_server(port, robot.name)
        self.address = address(self._server)
        self.chain = chain = Chain(arm_of(robot, {}))
        self._q: Floats = np.array(middle_pose(robot))
        travel = [0.5] * chain.n
        if robot.limits:
            travel = np.maximum(np.abs(robot.q_min), np.abs(robot.q_max)).tolist()
        stage(self._server, chain, chain.points(self._q))
        visuals = [visual.to_dict() for visual in robot.visuals]
        self.arm = ArmScene(self._server, chain, travel=travel, visuals=visuals, folder=folder)
        ellipsoids, self.notes = inertia_parts(robot)
        self.notes += self.arm.notes
        self._groups = self._add_groups(ellipsoids)
        self._add_controls()
        self._pool = ThreadPoolExecutor(1)
        self._finding: Future[Modes] | None = None
        self._asked: Any = None
        self.modes: Modes | None = None
        """At the pose and with the motors of the panel, once they are found."""
        self._moved = clock.monotonic()
        self.show(self._q)

    def _add_groups(self, ellipsoids: list[Any]) -> dict[str, list[Any]]:
        """Add the parts that the boxes of the panel show; return their names, and the handles of each."""
        chain, scene, length = self.chain, self._server.scene, 0.1 * self.chain.reach
        groups: dict[str, list[Any]] = {}
        frames = [self.arm.frame(0, "frame", 1.3 * length)]
        frames += [self.arm.frame(i, "frame", length) for i in range(1, chain.n + 1)]
        frames.append(self.arm.frame(chain.n, "tool", 1.3 * length, chain.tool_offset, chain.tool_rotation))
        names = ["{I}", *(f"{{B_{i}}}" for i in range(1, chain.n + 1)), "{O}"]
        for name, frame in zip(names, list(frames), strict=True):  # at the end of z; these may lie on others
            tip = np.roll([0.0, 0.0, 1.25 * length], {"{O}": 1, "{I}": 2}.get(name, 0))
            frames.append(scene.add_label(f"{frame.name}/label", name, position=tip, anchor="center-center"))
        groups["Frames"] = frames
        groups["Centres of mass"] = [
            scene.add_icosphere(f"{self.arm.names[i]}/centre", 0.014 * chain.reach, (190, 24, 93), position=p)
            for i, p in centres(self.robot)
        ]
        groups["Ellipsoids of inertia"] = [
            self.arm.add(part, f"inertia_{k}", opacity=0.45, cast_shadow=False) for k, part in enumerate(ellipsoids)
        ]
        if not chain.weightless:
            start = chain.reach * turn_to(chain.up) @ np.array([0.05, 0.45, 0.3])
            arrow = np.array([[start, start - 0.2 * chain.reach * chain.up]])
            groups["Gravity"] = [
                scene.add_arrows("gravity", arrow, (70, 80, 92), shaft_radius=0.006 * chain.reach,
                                 head_radius=0.018 * chain.reach, head_length=0.05 * chain.reach),
                scene.add_label("gravity_label", "g", position=start, anchor="bottom-left"),
            ]  # fmt: skip
        return groups

    def _add_controls(self) -> None:
        gui, robot = self._server.gui, self.robot
        self.sliders: list[Any] = []
        self._factors: Floats = np.array([UNITS[kind].factor for kind in robot.joint_types])
        with gui.add_folder("Joints"):
            for i, kind in enumerate(robot.joint_types):
                low, high = (-np.pi, np.pi) if kind == "revolute" else (-0.5, 0.5)
                if robot.limits:
                    low, high = float(robot.q_min[i]), float(robot.q_max[i])
                ends = [
                    math.ceil(10.0 * self._factors[i] * low) / 10.0,
                    math.floor(10.0 * self._factors[i] * high) / 10.0,
                ]
                start = min(max(float(self._factors[i] * self._q[i]), ends[0]), ends[1])
                label = f"{i + 1} [{UNITS[kind].position}]"
                self.sliders.append(gui.add_slider(label, *ends, 0.1, start))
            self._home = gui.add_button("Back to the start")
            start = [slider.value for slider in self.sliders]

            @self._home.on_click
            def _(_: Any) -> None:
                for slider, value in zip(self.sliders, start, strict=True):
                    slider.value = value

        self._boxes: dict[str, Any] = {}
        with gui.add_folder("Show"):
            self._links = gui.add_dropdown("Links", tuple(_LOOKS), initial_value="see-through")
            for name in self._groups:
                self._boxes[name] = gui.add_checkbox(name, name != "Ellipsoids of inertia")
        self._shown, self._look = dict.fromkeys(self._groups, True), "solid"
        with gui.add_folder("Modes"):
            self._motors = gui.add_dropdown("Motors", MOTORS)
            self._mode = gui.add_dropdown("Mode", ("none",))
            self._amplitude = gui.add_slider(
                "Amplitude", 0.0, 0.5, 0.01, 0.2, hint="rad or m, of the link that moves most"
            )
            self._words = gui.add_markdown("")
        if self.notes:
            gui.add_markdown("\n".join(f"- {note}" for note in self.notes))

    @property
    def pose(self) -> Floats:
        """Pose of the sliders, (n,) [rad or m]."""
        return np.array([slider.value for slider in self.sliders]) / self._factors

    def run(self, ended: Callable[[], bool] = lambda: False) -> None:
        """Show the panel's choice, until it has ended or Ctrl-C comes."""
        began = clock.monotonic()
        while not ended():
            self.step(clock.monotonic() - began)
            clock.sleep(PERIOD)

    def step(self, time: float) -> None:
        """Show the picture of a time [s], which moves the chosen mode."""
        q, motors = self.pose, self._motors.value
        for name, box in self._boxes.items():
            if box.value != self._shown[name]:
                self._shown[name] = box.value
                for handle in self._groups[name]:
                    handle.visible = box.value
        if self._links.value != self._look:
            self._look = self._links.value
            for handle in self.arm.bodies:
                handle.visible, handle.opacity = self._look != "hidden", _LOOKS[self._look]
        if not np.array_equal(q, self._q):
            self._q, self._moved = q, clock.monotonic()
            self.show(q)
        asked = (*q, motors)
        if asked != self._asked and self._finding is None and clock.monotonic() > self._moved + _REST:
            self._asked = asked
            self._finding = self._pool.submit(natural_modes, self.robot, q, motors=motors)
        if self._finding is not None and self._finding.done():
            self._take(self._finding)
            self._finding = None
        chosen = self._chosen()
        if chosen is not None and self.modes is not None:
            self.show(q + float(self._amplitude.value) * displacement(self.modes, chosen, time / _SECONDS))
        elif self._swings:
            self.show(q)
        self._swings = chosen is not None

    _swings = False

    def _chosen(self) -> int | None:
        name = self._mode.value
        return None if name == "none" or self.modes is None else self._mode.options.index(name) - 1

    def _take(self, found: Future[Modes]) -> None:
        """Take modes that are found, or say why there are none; the number of the mode that is chosen stays."""
        chosen = self._chosen()
        try:
            self.modes = modes = found.result()
        except VdfmuError as error:
            self.modes, self._mode.options, self._words.content = None, ("none",), str(error)
            return
        pairs = zip(modes.frequency, modes.damping, strict=True)
        names = [f"{i}: {f:.2f} Hz, damping {d + 0.0:.4f}" for i, (f, d) in enumerate(pairs, 1)]
        self._mode.options = ("none", *names)
        if chosen is not None and chosen < len(names):
            self._mode.value = names[chosen]
        self._words.content = table(modes)

    def show(self, q: Floats) -> None:
        """Draw a pose, (n,) [rad or m]."""
        with self._server.atomic():
            self.arm.set(q)

    def close(self) -> None:
        """End the server."""
        self._pool.shutdown(wait=False, cancel_futures=True)
        with contextlib.redirect_stdout(io.StringIO()):
            self._server.stop()


def displacement(modes: Modes, k: int, cycles: float) -> Floats:
    """Displacement of the links in mode k after a number of cycles, undamped; the largest is 1: (n,) [rad or m]."""
    shape = modes.links[k]
    largest = float(np.abs(shape).max())
    return (shape / (largest or 1.0) * np.exp(2j * np.pi * cycles)).real


def table(modes: Modes) -> str:
    """Return joint and share of the energy of the springs of each mode, and its shape, in Markdown."""
    lines = ["| mode | spring | links |", "| --- | --- | --- |"]
    for k, joint in enumerate(modes.joint):
        links = " ".join(f"{round(v, 2) + 0.0:.2f}" for v in modes.links[k].real)
        lines.append(f"| {k + 1} | {joint + 1} ({100.0 * modes.share[k, joint]:.0f} %) | {links} |")
    return "\n".join(lines)
