"""``vdfmu view``, and ``--live`` of runs."""

from __future__ import annotations

import signal
from collections.abc import Generator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import click

from vdfmu.base.errors import UsageError
from vdfmu.base.option import Option
from vdfmu.cli.app import runs_code
from vdfmu.cli.parameters import Positional
from vdfmu.cli.terminal import console, say, say_error, say_notes
from vdfmu.study.options import known_robots

if TYPE_CHECKING:
    from vdfmu.study.view.live import LiveView


def _port(number: int) -> int:
    if not 1 <= number <= 65535:
        raise click.BadParameter(f"expected 1 to 65535, got {number}")
    return number


PortOption = Annotated[int | None, Option("Port of the view on 127.0.0.1 (default a free one).", read=_port)]
LiveOption = Annotated[bool, Option("Show the arm and its errors while the run goes on.")]


@runs_code
def view(
    robot: Annotated[str, Positional("Name of a robot, a TOML file, URDF or MJCF.", names=known_robots)],
    base: Annotated[str | None, Option("Fixed link of a URDF or MJCF.", metavar="LINK")] = None,
    tip: Annotated[str | None, Option("Last link of the arm in a URDF or MJCF.", metavar="LINK")] = None,
    port: PortOption = None,
) -> None:
    """Show a robot in a browser.

    The view has sliders of the joints, frames, masses, ellipsoids of inertia, and modes that move.
    """
    from vdfmu.base.interrupt import InterruptGuard

    path = Path(robot)
    if path.suffix.lower() in (".urdf", ".xml", ".mjcf"):
        from vdfmu.arm.imports import import_robot

        arm, _, notes = import_robot(path, base, tip)
        folder = path.parent
    else:
        if base is not None or tip is not None:
            raise UsageError("base, tip: expected a URDF or MJCF. They choose its arm.")
        from vdfmu.arm.robot import load_robot
        from vdfmu.base.toml_file import locate

        arm, notes, folder = load_robot(robot), [], locate(robot, "robots").parent
    from vdfmu.study.view.robot import RobotView

    shown = RobotView(arm, folder, port)
    say_notes([*notes, *shown.notes])
    say(f"{arm.name}, until Ctrl-C: {shown.address}")
    console.leave()
    with InterruptGuard() as guard:
        shown.run(lambda: guard.number != 0)
        shown.close()
        guard.number = 0 if guard.number == signal.SIGINT else guard.number


@contextmanager
def live_view(wanted: bool, port: int | None, robot: str | None = None) -> Generator[LiveView | None]:
    """Yield the view of a run. It stays after the run, also after a failed one, until the user ends it."""
    if not wanted:
        if port is not None:
            raise UsageError("--port needs --live.")
        yield None
        return
    from vdfmu.base.errors import CosimError
    from vdfmu.study.view.live import LiveView

    arm = None
    if robot is not None:
        from vdfmu.arm.robot import load_robot

        arm = load_robot(robot)

    def tell(text: str) -> None:  # --quiet leaves the address
        note = text.removeprefix("note: ")
        say(text) if note == text else say_notes([note])

    with LiveView(port=port, arm=arm, say=tell) as shown:
        failure: CosimError | None = None
        try:
            yield shown
        except CosimError as error:
            say_error(failure := error)
        console.leave()
        shown.stay()
        if failure:
            raise SystemExit(1) from failure
