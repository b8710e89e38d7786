"""``vdfmu margins``."""

from __future__ import annotations

import math
from typing import Annotated

import typer

from vdfmu.cli.terminal import (
    BackendOption,
    RobotOption,
    SetOption,
    console,
    load,
    parse_settings,
    say_notes,
)


def margins(
    system: Annotated[
        str, typer.Argument(metavar="SCENARIO|FILE.ssp", help="A scenario, or a system package.")
    ] = "tracking",
    robot: RobotOption = None,
    at: Annotated[
        list[float] | None,
        typer.Option(help="Time of the run in seconds; default five from start to end. Repeatable."),
    ] = None,
    opened: Annotated[
        list[str] | None,
        typer.Option(
            "--open",
            metavar="INPUT",
            help="Connected inputs at which loops are opened; default plant.tau. Repeatable.",
        ),
    ] = None,
    master: Annotated[
        str | None, typer.Option(help="gauss-seidel, or jacobi with a sample of delay; default the system's.")
    ] = None,
    growth: Annotated[float, typer.Option(help="Rate in 1/s up to which what grows counts as stable.")] = 0.0,
    settings: SetOption = None,
    backend: BackendOption = None,
) -> None:
    """Print margins of stability of the sampled loops of a system, with the delays of its master."""
    from rich.table import Table

    from vdfmu.analysis.system import margins_along
    from vdfmu.errors import UsageError

    package = system.lower().endswith(".ssp")
    if package and robot is not None:
        raise UsageError(f"margins: --robot is for a scenario; {system} has its own.")
    found = margins_along(
        system if package else load(system, robot), opened or ["plant.tau"], at, growth=growth, master=master,
        settings=parse_settings(settings), backend=backend,
    )  # fmt: skip
    table = Table("t", "opened at", "modulus", "gain", "phase", "delay", "largest pole", box=None)
    for t, each in zip(found.times, found.margins, strict=True):
        for i, name in enumerate(found.names):
            modulus, gain, phase, delay = (float(column[i]) for column in each[:4])
            table.add_row(
                f"{t:g} s" * (i == 0), name, f"{modulus:.3f}", f"{gain:.3g}", f"{math.degrees(phase):.1f} deg",
                f"{1e3 * delay:.3g} ms", f"{each.radius:.6f}" * (i == 0),
            )  # fmt: skip
    table.title, table.title_justify = f"Sampled at {found.step:g} s, {found.algorithm}", "left"
    console.print(table)
    say_notes(found.notes)
