"""``vdfmu robot import`` and ``reach``."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Annotated

import typer

from vdfmu.cli.app import App
from vdfmu.cli.terminal import console, say, say_notes

app = App(name="robot", no_args_is_help=True, help="Robots from the files of other tools.")

OverwriteOption = Annotated[bool, typer.Option("--overwrite", help="Replace a file of this name.")]


@app.callback()
def _group() -> None:
    """Robots from the files of other tools."""


@app.command("import", epilog="Example: [bold]vdfmu robot import panda.urdf --tip panda_hand -o panda.toml[/bold]")
def import_file(
    file: Annotated[Path, typer.Argument(help="A URDF, or a MuJoCo file (MJCF).")],
    base: Annotated[str | None, typer.Option(help="Link that stands still; default the root of the file.")] = None,
    tip: Annotated[
        str | None, typer.Option(help="Link at which the arm ends; default the last, where there is one arm.")
    ] = None,
    drives: Annotated[
        Path | None, typer.Option(help="TOML file with drives, by names of joints; what it does not give is assumed.")
    ] = None,
    density: Annotated[
        float | None,
        typer.Option(
            help="kg/m3 of the boxes, cylinders and spheres of bodies to which the file gives no mass or inertia."
        ),
    ] = None,
    out: Annotated[
        Path | None, typer.Option("--out", "-o", help="Robot file to write; default FILE.toml, in this folder.")
    ] = None,
    overwrite: OverwriteOption = False,
) -> None:
    """Write a robot file from a URDF or a MuJoCo file. It says where each number is from."""
    from vdfmu.arm.imports import import_robot
    from vdfmu.arm.robot.robot import joint_free
    from vdfmu.base.files import write_whole

    target = target_file(out, f"{file.stem}.toml", overwrite)
    robot, text, notes = import_robot(file, base, tip, drives, density, out=target)
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
        Path | None, typer.Option("--out", "-o", help="Scenario to write; default ROBOT_reach.toml, in this folder.")
    ] = None,
    overwrite: OverwriteOption = False,
) -> None:
    """Write the scenario of a first motion, with gains by one rule, and print the margins of the arm's loops."""
    from rich.table import Table

    from vdfmu.arm.robot import load_robot
    from vdfmu.base.toml_file import locate
    from vdfmu.study.analysis.reach import write_reach

    target = target_file(out, f"{locate(robot, 'robots').stem}_reach.toml", overwrite)
    found = write_reach(robot, target)
    table = Table("joint", "K_p", "K_v", "modulus margin", "gain margin", "phase margin deg", box=None)
    labels = load_robot(robot).joint_labels
    for i, (K_p, K_v) in enumerate(zip(found.gains.K_p, found.gains.K_v, strict=True)):
        modulus, gain, phase = (float(margin[i]) for margin in found.margins[:3])
        table.add_row(
            labels[i], f"{K_p:.4g}", f"{K_v:.4g}", f"{modulus:.2f}", f"{gain:.2f}", f"{math.degrees(phase):.0f}"
        )
    console.print(table)
    say_notes(found.notes)
    say(f"{target}: run it with 'vdfmu run {target}'; margins are with a sample of delay, all joints moving")


@app.command("drives", epilog="Example: [bold]vdfmu robot drives CSG-25-100[/bold]")
def list_drives(
    name: Annotated[
        str | None, typer.Argument(help="A gear or a motor, for its numbers and where they are from.")
    ] = None,
) -> None:
    """List the gears and motors that a joint's gear = ".." and motor = ".." can name."""
    from rich.table import Table

    from vdfmu.arm.drive.fit import catalogue_torsion, fit_spring
    from vdfmu.arm.robot.catalogue import catalogue
    from vdfmu.base.errors import UsageError
    from vdfmu.base.text import nearest

    gears, motors, texts = (catalogue()[key] for key in ("gears", "motors", "sources"))
    if name is not None:
        entry = gears.get(name) or motors.get(name)
        if entry is None:
            raise UsageError(f"no gear or motor {name!r}. {nearest(name, [*gears, *motors])}")
        of_gear = entry.get("sources", {entry.get("source"): ["all numbers"]})
        for key, value in entry.items():
            if key not in ("sources", "source"):
                tables = ", ".join(f"{k} {v:g}" for k, v in value.items()) if isinstance(value, dict) else f"{value:g}"
                console.print(f"{key} {tables}", markup=False, soft_wrap=True)
        for source, keys in of_gear.items():
            console.print(f"{', '.join(keys)}: {texts[source]}", markup=False, soft_wrap=True)
        return
    table = Table("gear", "rated N.m", "repeated N.m", "K1 N.m/rad", "K3 N.m/rad", "fit off by", box=None)
    for key, gear in gears.items():
        K, T = [gear[f"K{i}"] for i in (1, 2, 3)], [gear[f"T{i}"] for i in (1, 2)]
        residual = fit_spring(gear["ratio"], K, T, gear["repeated"])[1]
        share = residual / float(catalogue_torsion(gear["repeated"], K, T))
        numbers = (f"{gear[number]:g}" for number in ("rated", "repeated", "K1", "K3"))
        table.add_row(key, *numbers, f"{math.degrees(residual) * 60.0:.2f} arcmin, {share:.1%}")
    console.print(table)
    table = Table("motor", "inertia kg.m2", "winding", box=None)
    for key, motor in motors.items():
        table.add_row(key, f"{motor['inertia']:g}", "yes" if "winding" in motor else "no")
    console.print(table)


def target_file(out: Path | None, name: str, overwrite: bool) -> Path:
    """Return the file to write; UsageError for one that is there, unless it may be replaced."""
    from vdfmu.base.errors import UsageError

    target = out if out is not None else Path(name)
    if target.exists() and not overwrite:
        raise UsageError(f"{target}: expected no file of this name. --overwrite replaces it, -o names another.")
    return target
