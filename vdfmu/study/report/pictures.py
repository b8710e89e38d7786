"""The pictures of a run: a file for each figure of its page, and for the error of the tool."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from vdfmu.arm.dynamics import forward_kinematics
from vdfmu.arm.robot import Robot
from vdfmu.base.measure import Shown
from vdfmu.engine.results.figure import Curve, Figure
from vdfmu.engine.results.folder import DRAWN
from vdfmu.engine.results.results import Recorded, Results, Signal
from vdfmu.study.report.content import run_figures


def write_pictures(results: Results, robot: Robot | None, folder: Path, kinds: Sequence[str], width: float) -> None:
    """Write the figures of a run, ``figure_tracking.pdf``; without any its signals. `width` in inches."""
    if not kinds:
        return
    from vdfmu.engine.results.picture import write_figures, write_signals  # takes long to import

    shown = results.thinned(DRAWN)
    figures = list(run_figures(shown, results.summary))
    write_figures(figures, shown, folder, kinds, width)
    if robot is not None and {"trajectory.q_d[1]", "plant.p_O[1]"} <= {*results.names}:
        write_figures([TOOL], tool_error(robot, shown), folder, kinds, width)
    elif not figures:
        write_signals(shown, folder, kinds, width)


TOOL = Figure("tool", "Tool position errors", Shown("mm", 1e3), [Curve(k, 0, [(1.0, k)]) for k in "xyz"])


def tool_error(robot: Robot, results: Results) -> Recorded:
    """Return the desired position of the tool minus the actual one, in {I}: signals x, y, z [m]."""
    desired, _ = forward_kinematics(robot, results["trajectory.q_d"])
    signals = [Signal(name, "real", "m", column) for column, name in enumerate("xyz")]
    return Recorded(results.time, signals, {"real": desired - results["plant.p_O"]})
