"""``vdfmu robot import`` and ``reach``."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Annotated

import typer

from vdfmu.cli.terminal import console, say, say_notes

app = typer.Typer(no_args_is_help=True, help="Robots from the files of other tools.")

OverwriteOption = Annotated[bool, typer.Option("--overwrite", help="Replace a file of this name.")]


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
    overwrite: OverwriteOption = False,
) -> None:
    """Write a robot file from a URDF or a MuJoCo file. It says where each number is from."""
    from vdfmu.files import write_whole
    from vdfmu.model.robot import joint_free
    from vdfmu.robots import import_robot

    target = target_file(out, f"{file.stem}.toml", overwrite)
    robot, text, notes = import_robot(file, base, tip, drives, out=target)
    write_whole(target, [text.encode()])
    say_notes(notes)
    assumed = [joint_free(key) for key, source in robot.sources.items() if source.startswith("Assumed")]
    if assumed:
        names = ", ".join(key.removeprefix("joints.") for key in dict.fromkeys(assumed))
        say_notes([f"assumed, for --drives to give what is known: {names}."])
    say(f"{target}: {robot.n} joint{'s' * (robot.n > 1)}")


@app.command("reach", epilog="Example: [bold]vdfmu robot reach ./panda.toml -o reach.toml[/bold]")
def reach(
    robot: Annotated[str, typer.Argument(help="Name of a shipped robot, or path of a robot file.")],
    out: Annotated[
        Path | None,
        typer.Option("--out", "-o", help="Scenario to write; default ROBOT_reach.toml, in this folder."),
    ] = None,
    overwrite: OverwriteOption = False,
) -> None:
    """Write the scenario of a first motion, with gains by one rule, and print the margins of the arm's loops."""
    from rich.table import Table

    from vdfmu.analysis.reach import write_reach
    from vdfmu.model.toml_file import locate

    target = target_file(out, f"{locate(robot, 'robots').stem}_reach.toml", overwrite)
    found = write_reach(robot, target)
    table = Table("joint", "K_p", "K_v", "modulus margin", "gain margin", "phase margin deg", box=None)
    for i, (K_p, K_v) in enumerate(zip(found.gains.K_p, found.gains.K_v, strict=True)):
        modulus, gain, phase = (float(margin[i]) for margin in found.margins[:3])
        table.add_row(
            str(i + 1),
            f"{K_p:.4g}",
            f"{K_v:.4g}",
            f"{modulus:.2f}",
            f"{gain:.2f}",
            f"{math.degrees(phase):.0f}",
        )
    console.print(table)
    say_notes(found.notes)
    say(f"{target}: run it with 'vdfmu run {target}'; margins are with a sample of delay, all joints moving")


def target_file(out: Path | None, name: str, overwrite: bool) -> Path:
    """Return the file to write; UsageError for one that is there, unless it may be replaced."""
    from vdfmu.errors import UsageError

    target = out if out is not None else Path(name)
    if target.exists() and not overwrite:
        raise UsageError(
            f"{target}: expected no file of this name. --overwrite replaces it, -o names another."
        )
    return target
