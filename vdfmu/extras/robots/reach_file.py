"""The file of a first motion, and the margins of the whole arm along it."""

from __future__ import annotations

import os
from pathlib import Path
from typing import NamedTuple

from vdfmu.arm.robot import load_robot, robot_names
from vdfmu.base.errors import UsageError
from vdfmu.base.toml_file import locate
from vdfmu.engine.linear.loops import Margins
from vdfmu.extras.robots.reach import Gains, write_scenario
from vdfmu.study.analysis.loops import margins_along
from vdfmu.study.verdict import loop_sentences


class Reach(NamedTuple):
    """The written file, its gains, the margins of the whole arm along the motion, and notes on the motion."""

    path: Path
    gains: Gains
    margins: Margins | None
    """Smallest margins of each loop; None if they are unknown, for the reason in the last note."""
    notes: list[str]


def write_reach(robot: str | os.PathLike[str], out: str | os.PathLike[str]) -> Reach:
    """Write the scenario of a first motion of a robot, see :func:`~vdfmu.load_robot`, to a file."""
    path, place = Path(out), locate(robot, "robots")
    shipped = str(robot) in robot_names() and not Path(robot).exists()
    written = str(robot) if shipped else Path(os.path.relpath(place, path.parent)).as_posix()
    gains, notes = write_scenario(load_robot(robot), place.stem, written, path)
    try:
        margins = margins_along(path)
    except UsageError as error:
        return Reach(path, gains, None, [*notes, f"margins of the whole arm: {error}"])
    return Reach(path, gains, margins.judged.loops.margins(), [*notes, *loop_sentences(margins.judged.figures)[1]])
