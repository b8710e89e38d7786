"""``vdfmu margins``."""

from __future__ import annotations

import math
from typing import Annotated, Any

import typer

from vdfmu.base.option import read_settings
from vdfmu.cli.options import choice
from vdfmu.cli.terminal import (
    BackendOption,
    JsonOption,
    RobotOption,
    SetOption,
    console,
    load,
    say_error,
    say_json,
    say_notes,
    table,
)


def margins(
    system: Annotated[
        str, typer.Argument(metavar="SCENARIO|FILE.ssp", help="A scenario, or a system package.")
    ] = "tracking",
    robot: RobotOption = None,
    at: Annotated[
        list[float] | None, typer.Option(help="Time of the run in seconds; default five from start to end. Repeatable.")
    ] = None,
    opened: Annotated[
        list[str] | None,
        typer.Option(
            "--loop", metavar="INPUT", help="Connected inputs at which loops are opened; default plant.tau. Repeatable."
        ),
    ] = None,
    master: Annotated[
        str | None,
        typer.Option(**choice("gauss-seidel", "jacobi"), help="jacobi has a sample of delay; default the system's."),
    ] = None,
    growth: Annotated[
        float | None,
        typer.Option(help="Rate in 1/s up to which what grows counts as stable; default 2, as in a run's verdict."),
    ] = None,
    settings: SetOption = None,
    backend: BackendOption = None,
    as_json: JsonOption = False,
) -> None:
    """Print margins of stability of the sampled loops of a system, with the delays of its master.

    The exit code is 1 if it is unstable at one of the times.
    """
    from vdfmu.base.errors import UsageError
    from vdfmu.study.analysis.system import margins_along

    package = system.lower().endswith(".ssp")
    if package and robot is not None:
        raise UsageError(f"margins: --robot is for a scenario; {system} has its own.")
    found = margins_along(
        system if package else load(system, robot), opened or ["plant.tau"], at, master=master,
        settings=read_settings(settings), backend=backend, **({} if growth is None else {"growth": growth}),
    )  # fmt: skip
    shown = table("t", "opened at", "modulus", "gain", "phase", "delay", "fastest mode",
                  title=f"Sampled at {found.step:g} s, {found.algorithm}")  # fmt: skip
    rows: list[dict[str, Any]] = []
    for k, (t, each, growing) in enumerate(zip(found.times, found.margins, found.growing, strict=True)):
        for i, name in enumerate(found.names):
            modulus, gain, phase, delay = (float(column[i]) for column in each[:4])
            rows.append({"t": t, "opened_at": name, "modulus": modulus, "gain": gain, "phase": phase, "delay": delay,
                         "largest_pole": each.radius, "rate": found.rate(k), "stable": not growing})  # fmt: skip
            late = f"{delay:.3g} s" if delay >= 1.0 else f"{1e3 * delay:.3g} ms"
            numbers = (f"{modulus:.3f}", f"{gain:.3g}", f"{math.degrees(phase):.1f} deg", late)
            shown.add_row(
                f"{t:g} s" * (i == 0), name, *(numbers if not growing else ("unstable", "", "", "")),
                f"{found.rate(k):.3g} 1/s" * (i == 0), style="red" if growing else None,
            )  # fmt: skip
    if as_json:
        say_json({"step": found.step, "master": found.algorithm, "margins": rows})
    else:
        console.print(shown)
    say_notes(found.notes)
    if any(found.growing):
        worst = max(range(len(found.times)), key=found.rate)
        times = [f"{t:g} s" for t, growing in zip(found.times, found.growing, strict=True) if growing]
        where = f"all {len(times)} times" if len(times) == len(found.times) else ", ".join(times)
        say_error(
            f"Unstable at {where}: a mode grows with {found.rate(worst):.3g} 1/s, expected up to {found.growth:g} 1/s. "
            f"Largest part in it: {found.growing[worst]}, at {found.times[worst]:g} s. "
            "A run may pass such times without harm: its verdict has the growth over all of it."
        )
        raise typer.Exit(1)
