"""The process that draws a run: ``python -m vdfmu.study.view.live_server PORT``; see `vdfmu.study.view.live`."""

from __future__ import annotations

import os
import pickle
import queue
import sys
import threading
import time as clock
from collections.abc import Mapping
from contextlib import suppress
from pathlib import Path
from typing import Any

import numpy as np

from vdfmu.base import palette
from vdfmu.base.arrays import Floats
from vdfmu.base.child import Parent
from vdfmu.base.errors import VdfmuError
from vdfmu.engine.run.isolated import mapped
from vdfmu.study.report.content import MOTOR_SIDE, SUMS
from vdfmu.study.report.joints import UNITS
from vdfmu.study.report.shapes import Chain
from vdfmu.study.view.live import HEAD, SIGNALS
from vdfmu.study.view.scene import PERIOD, ArmScene, address, clear, open_server, stage

QUANTITIES = {"torque": "Torque, link side", "error": "Tracking error", "torsion": "Torsion"}
_NUMBERS = 0.2
"""Time between two tables of numbers, and two pictures of curves [s]."""
_POINTS = 400
"""Points of a curve that grows, before every second is dropped."""
_HIGH = str.maketrans("-0123456789", "⁻⁰¹²³⁴⁵⁶⁷⁸⁹")
_LARGER = ("1", "10", "100", "1000", "10⁴", "10⁵")


class Scene:
    """The drawing of one run of an arm, see :func:`vdfmu.study.report.content.arm_of`, from `start` to `stop` [s].

    Of `vdfmu.study.view.live.SIGNALS` it has those `given`.
    """

    def __init__(
        self, server: Any, title: str, arm: Mapping[str, Any], start: float, stop: float, given: set[str]
    ) -> None:
        clear(server, title)
        self._server, self.chain = server, (chain := Chain(arm))
        self.start, self.stop = start, stop
        stage(server, chain, np.vstack([chain.points(np.zeros(chain.n)), 0.8 * chain.reach * chain.up]))
        self._arm = ArmScene(server, chain)
        self._arm.frame(chain.n, "tool", 0.1 * chain.reach, chain.tool_offset, chain.tool_rotation)
        self._ghost = ArmScene(server, chain, "desired", ghost=True) if "q_d" in given else None
        self._peaks: dict[str, Floats] = {}
        self._time: list[float] = []
        self._curves: dict[str, list[Floats]] = {}
        self._stride, self._count = 1, 0
        self.recorded: dict[str, Floats] | None = None
        gui = server.gui
        self._state = gui.add_markdown("Starting")
        self.slider: Any = None
        self._numbers = gui.add_markdown("")
        names = [key for key, needs in NEEDS.items() if needs <= given]
        self._chosen = gui.add_dropdown("Colour of joints", [QUANTITIES[key] for key in names]) if names else None
        self._desired = gui.add_checkbox("Desired arm", True) if self._ghost else None
        self._larger = gui.add_dropdown("Errors drawn times", _LARGER) if self._ghost else None
        self._keys = names
        self._plots: dict[str, Any] = {}

    def values(self, found: Mapping[str, Floats]) -> dict[str, Floats]:
        """Return the shown values of rows of the signals: tracking error, link-side torque, torsion, in SI units."""

        def link_side(signal: str) -> Floats:
            return found[_KEYS[signal]] * (self.chain.ell if signal in MOTOR_SIDE else 1.0)

        return {key: np.sum([factor * link_side(signal) for factor, signal in SUMS[key]], axis=0) for key in self._keys}

    def add(self, time: float, found: Mapping[str, Floats]) -> None:
        """Take a row during the run."""
        for key, values in self.values(found).items():
            self._peaks[key] = np.maximum(np.abs(values), self._peaks.get(key, 0.0))
            if self._count % self._stride == 0:
                self._curves.setdefault(key, []).append(values)
        if self._count % self._stride == 0:
            self._time.append(time)
        self._count += 1
        if len(self._time) > _POINTS:
            self._stride *= 2
            self._time = self._time[::2]
            self._curves = {key: rows[::2] for key, rows in self._curves.items()}

    def finish(self, time: Floats, found: Mapping[str, Floats]) -> None:
        """Take the rows of the whole run, and let a slider go through them."""
        self.recorded = {"time": time, **found}
        whole = self.values(found)
        self._peaks = {key: np.abs(values).max(axis=0) for key, values in whole.items()}
        self._time, self._curves = time.tolist(), {key: list(values) for key, values in whole.items()}
        gui, first, last = self._server.gui, float(time[0]), float(time[-1])
        words = "The run is complete." if last >= self.stop - 1e-9 * abs(self.stop) else "The run ended early."
        self._state.content = f"{words} {first:g} to {last:g} s:"
        if last > first:
            self.slider = gui.add_slider(
                "Time [s]", first, last, (last - first) / 1000.0, last, order=self._state.order + 0.1
            )
            self.playing = gui.add_checkbox("Play", False, order=self._state.order + 0.2)
            self.rate = gui.add_dropdown("Speed", ("1", "0.1", "0.3", "3", "10"), order=self._state.order + 0.3)
        self.curves()

    def at(self, time: float) -> dict[str, Floats]:
        """Return the recorded row nearest to a time."""
        assert self.recorded is not None
        k = int(np.abs(self.recorded["time"] - time).argmin())
        return {key: values[k] for key, values in self.recorded.items() if key != "time"}

    def choices(self) -> list[Any]:
        """Return the choice in the panel."""
        return [each.value for each in (self._chosen, self._desired, self._larger) if each is not None]

    def draw(self, found: Mapping[str, Floats]) -> None:
        """Draw a row."""
        q, values = found["q"], self.values(found)
        larger = 10.0 ** _LARGER.index(self._larger.value) if self._larger else 1.0
        with self._server.atomic():
            self._arm.set(q - (larger - 1.0) * values["error"] if self._ghost else q)
            if self._ghost and self._desired:
                self._ghost.root.visible = self._desired.value
                self._ghost.set(found["q_d"])
            if self._chosen:
                key = self._keys[self._chosen.options.index(self._chosen.value)]
                peak = self._peaks.get(key, np.ones(self.chain.n))
                self._arm.colour(values[key] / np.where(peak > 0.0, peak, 1.0))

    def tell(self, time: float, found: Mapping[str, Floats]) -> None:
        """Show the numbers of a row."""
        if self.recorded is None:
            share = (time - self.start) / (self.stop - self.start) if self.stop > self.start else 1.0
            self._state.content = f"Running: t = {time:.3f} s, {100.0 * share:.0f} %"
        values = self.values(found)
        one = len(set(self.chain.types)) == 1
        units = {key: _unit(key, self.chain.types[0]) for key in ("position", *values)}
        lines = ["| | " + " | ".join(f"{key} [{unit}]" if one else key for key, unit in units.items()) + " |"]
        lines.append("| --- " * (2 + len(values)) + "|")
        for i, kind in enumerate(self.chain.types):
            cells = [f"{UNITS[kind].factor * found['q'][i]:.2f}"]
            cells += [f"{_factor(key, kind) * each[i]:.3g}" for key, each in values.items()]
            if not one:
                cells = [f"{cell} {_unit(key, kind)}" for key, cell in zip(units, cells, strict=True)]
            cells = [cell.replace("-", "−") for cell in cells]  # which does not break a line
            lines.append(f"| {i + 1}  | " + " | ".join(cells) + " |")
        self._numbers.content = "\n".join(lines)

    def curves(self) -> None:
        """Draw the curves as they are now."""
        if len(self._time) < 2:
            return
        time = np.array(self._time)
        for key, rows in self._curves.items():
            values = np.array(rows) * [_factor(key, kind) for kind in self.chain.types]
            largest = float(np.abs(values).max())
            power = 0 if not 0.0 < largest < 0.1 else 3 * int(np.floor(np.log10(largest) / 3.0))  # of the axis
            units = ", ".join(dict.fromkeys(_unit(key, kind) for kind in self.chain.types))
            title = f"{QUANTITIES[key]} [{f'10{str(power).translate(_HIGH)} ' * (power < 0)}{units}]"
            data = (time, *(10.0**-power * values).T)
            if key in self._plots:
                self._plots[key].data, self._plots[key].title = data, title
                continue
            count = len(COLOURS)
            looks = [
                {"label": f"{i + 1}", "stroke": COLOURS[i % count], "dash": _DASHES[i // count % len(_DASHES)]}
                for i in range(self.chain.n)
            ]
            self._plots[key] = self._server.gui.add_uplot(
                data, ({"label": "s"}, *({**look, "width": 1.5} for look in looks)), title=title, aspect=1.4,
                scales={"x": {"time": False}}, legend={"show": True}, padding=_ROOM,
            )  # fmt: skip


def _unit(key: str, kind: str) -> str:
    return UNITS[kind].torque if key == "torque" else UNITS[kind].position


def _factor(key: str, kind: str) -> float:
    return 1.0 if key == "torque" else UNITS[kind].factor


_KEYS = {signal: key for key, signal in SIGNALS.items()}
NEEDS = {name: {_KEYS[signal] for _, signal in SUMS[name]} for name in QUANTITIES}
"""Quantity to the signals that it takes."""
COLOURS = palette.LIGHT
_DASHES = ((), (9, 4), (9, 3, 2, 3), (2, 3))
_ROOM = (14, 16, 0, 0)
"""Room above and right of curves for the last number of each axis [px]."""


class ViewServer:
    """Takes messages of `LiveView`, and draws."""

    def __init__(self, server: Any) -> None:
        self._server = server
        self._scene: Scene | None = None
        self._words: Floats | None = None
        self._places: dict[str, list[int]] = {}
        self._seen, self._told, self._clients = 0.0, 0.0, 0
        self._shown: Any = None

    def begin(
        self, title: str, arm: Mapping[str, Any], path: str, places: dict[str, list[int]], start: float, stop: float
    ) -> None:
        """Draw the arm of a run that begins."""
        self._scene = Scene(self._server, title, arm, start, stop, set(places))
        self._words, self._places, self._seen, self._told = mapped(Path(path)), places, 0.0, 0.0
        with suppress(OSError):  # it is open; on Windows it is removed with its folder
            os.unlink(path)

    def words(self, title: str, text: str) -> None:
        """Show a text instead of an arm."""
        self._scene = self._words = None
        clear(self._server, title)
        self._server.gui.add_markdown(text)

    def end(self, time: Floats, found: Mapping[str, Floats]) -> None:
        """Show the rows of the finished run."""
        self._words, self._shown = None, None
        if self._scene is not None:
            self._scene.finish(time, found)

    def step(self) -> None:
        """Draw all changes."""
        scene, now = self._scene, clock.monotonic()
        if scene is None:
            return
        row = self._row() if self._words is not None else None
        if row is not None:
            time, found = row
            scene.add(time, found)
            scene.draw(found)
            if now > self._told + _NUMBERS:
                self._told = now
                scene.tell(time, found)
                scene.curves()
        elif scene.recorded is not None:
            self._replay(scene)

    def _row(self) -> tuple[float, dict[str, Floats]] | None:
        """Return the row in the memory, if it is a new one and whole."""
        assert self._words is not None
        count = float(self._words[0])
        row = self._words.copy()
        if count == self._seen or count % 2.0 or not count == row[0] == self._words[0]:
            return None
        self._seen = count
        return float(row[1]), {key: row[HEAD:][places] for key, places in self._places.items()}

    def _replay(self, scene: Scene) -> None:
        assert scene.recorded is not None
        first, last = scene.recorded["time"][[0, -1]]
        if scene.slider is not None and scene.playing.value:
            time = scene.slider.value + PERIOD * float(scene.rate.value)
            scene.slider.value = float(first if scene.slider.value >= last else min(time, last))
        shown = (last if scene.slider is None else scene.slider.value, *scene.choices())
        if shown != self._shown:
            self._shown = shown
            found = scene.at(shown[0])
            scene.draw(found)
            scene.tell(shown[0], found)


def main() -> None:
    """Serve until the pipe closes."""
    parent = Parent()
    with suppress(AttributeError, OSError):
        os.nice(5)  # the run comes first

    try:
        server = open_server(int(sys.argv[1]) if sys.argv[1] else None, "vdfmu")
    except VdfmuError as error:
        parent.reply({"error": str(error)})
        return
    parent.reply({"address": address(server)})
    tasks: queue.Queue[tuple[str, tuple[Any, ...]]] = queue.Queue()

    def read() -> None:
        for request in parent.requests():
            tasks.put(pickle.loads(request))
        os._exit(0)

    threading.Thread(target=read, daemon=True).start()
    drawer, clients = ViewServer(server), 0
    while True:
        with suppress(queue.Empty):
            name, arguments = tasks.get_nowait()
            getattr(drawer, name)(*arguments)
        drawer.step()
        if len(server.get_clients()) != clients:
            clients = len(server.get_clients())
            parent.reply(clients)
        clock.sleep(PERIOD)


if __name__ == "__main__":
    main()
