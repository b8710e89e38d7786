"""``vdfmu view``, and ``--live`` of runs."""

from __future__ import annotations

import signal
from collections.abc import Generator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from vdfmu.base.errors import UsageError
from vdfmu.cli.terminal import completing, console, say, say_error, say_notes
from vdfmu.study.options import known_robots

if TYPE_CHECKING:
    from vdfmu.study.view.live import LiveView

PortOption = Annotated[
    int | None,
    typer.Option(min=1, max=65535, help="Port of the view on 127.0.0.1; default one that is free.", show_default=False),
]
LiveOption = Annotated[
    bool, typer.Option("--live", help="Show the arm, errors, torques and torsion in a browser while the run goes on.")
]


def view(
    robot: Annotated[
        str,
        typer.Argument(
            help="Name of a shipped robot, or path of a robot file, a URDF or a MuJoCo file (MJCF).",
            autocompletion=completing(known_robots),
        ),
    ],
    base: Annotated[str | None, typer.Option(help="Of a URDF or MJCF: link that stands still.")] = None,
    tip: Annotated[str | None, typer.Option(help="Of a URDF or MJCF: link at which the arm ends.")] = None,
    port: PortOption = None,
) -> None:
    """Show a robot in a browser: sliders of its joints, frames, masses, ellipsoids of inertia, and modes that move."""
    from vdfmu.base.interrupt import InterruptGuard

    path = Path(robot)
    if path.suffix.lower() in (".urdf", ".xml", ".mjcf"):
        from vdfmu.arm.imports import import_robot

        arm, _, notes = import_robot(path, base, tip)
        folder = path.parent
    else:
        if base is not None or tip is not None:
            raise UsageError("base, tip: expected a URDF or MJCF, of which they choose the arm.")
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
    """Make the view of a run, which stays after it until the user ends it, if the run failed, too."""
    if not wanted:
        if port is not None:
            raise UsageError("--port: expected --live, which it is for.")
        yield None
        return
    from vdfmu.base.errors import CosimError
    from vdfmu.study.view.live import LiveView

    arm: dict[str, Any] | None = None
    if robot is not None:
        from vdfmu.arm.robot import load_robot
        from vdfmu.study.run.scene import arm_of

        arm = arm_of(load_robot(robot), {})

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
            raise typer.Exit(1) from failure
