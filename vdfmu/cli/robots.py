"""``vdfmu robot import``."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from vdfmu.cli.terminal import say, say_notes

app = typer.Typer(no_args_is_help=True, help="Robots from the files of other tools.")


@app.callback()
def _group() -> None:
    """Robots from the files of other tools."""


@app.command(
    "import", epilog="Example: [bold]vdfmu robot import panda.urdf --tip panda_hand -o panda.toml[/bold]"
)
def import_file(
    file: Annotated[Path, typer.Argument(help="A URDF, or a MuJoCo file (MJCF).")],
    base: Annotated[
        str | None, typer.Option(help="Link that stands still; default the root of the file.")
    ] = None,
    tip: Annotated[
        str | None, typer.Option(help="Link at which the arm ends; default the last, where there is one arm.")
    ] = None,
    drives: Annotated[
        Path | None,
        typer.Option(help="TOML file with drives, by names of joints; what it does not give is assumed."),
    ] = None,
    out: Annotated[
        Path | None,
        typer.Option("--out", "-o", help="Robot file to write; default FILE.toml, in this folder."),
    ] = None,
    overwrite: Annotated[bool, typer.Option("--overwrite", help="Replace a file of this name.")] = False,
) -> None:
    """Write a robot file from a URDF or a MuJoCo file. It says where each number is from."""
    from vdfmu.errors import UsageError
    from vdfmu.files import write_whole
    from vdfmu.model.robot import joint_free
    from vdfmu.robots import import_robot

    target = out if out is not None else Path(f"{file.stem}.toml")
    if target.exists() and not overwrite:
        raise UsageError(
            f"{target}: expected no file of this name. --overwrite replaces it, -o names another."
        )
    robot, text, notes = import_robot(file, base, tip, drives, out=target)
    write_whole(target, [text.encode()])
    say_notes(notes)
    assumed = [joint_free(key) for key, source in robot.sources.items() if source.startswith("Assumed")]
    if assumed:
        names = ", ".join(key.removeprefix("joints.") for key in dict.fromkeys(assumed))
        say_notes([f"assumed, for --drives to give what is known: {names}."])
    say(f"{target}: {robot.n} joint{'s' * (robot.n > 1)}")
