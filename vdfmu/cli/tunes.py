"""``vdfmu tune``."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from vdfmu.cli.runs import HoldOption, InputOption, MasterOption, StepOption, StopOption, UnitOption
from vdfmu.cli.terminal import (
    BackendOption,
    RobotOption,
    ScenarioArgument,
    SetOption,
    parse_settings,
    say,
    say_notes,
    tell,
)


def tune(
    scenario: ScenarioArgument,
    vary: Annotated[
        list[str],
        typer.Option(
            metavar="TARGET[=FORM]",
            help="Parameter that varies, element by element: lin(a, b), log(a, b), after a star factors; default "
            "*log(0.1, 10). Repeatable.",
        ),
    ],
    cost: Annotated[
        str,
        typer.Option(
            metavar="EXPRESSION",
            help="What is made smallest, such as 'worst(rms(trajectory.q_d - plant.q))'; of several elements the mean "
            "of their ratios to those of the start, none beyond 1.",
        ),
    ],
    limit: Annotated[
        list[str] | None,
        typer.Option(
            metavar="EXPRESSION<NUMBER",
            help="What must hold, such as 'peak(controller.tau) < 2.5'. Repeatable.",
        ),
    ] = None,
    spread: Annotated[
        list[str] | None,
        typer.Option(
            metavar="TARGET=FORM",
            help="What is uncertain, as in a sweep: 'plant.mass[3]=*normal(1, 0.1)'. Repeatable.",
        ),
    ] = None,
    spread_n: Annotated[int, typer.Option(help="Number of robots of the spread.")] = 8,
    over: Annotated[str, typer.Option(help="mean or worst of the robots' costs.")] = "mean",
    margin: Annotated[
        str | None,
        typer.Option(
            help="Modulus margin that every joint's loop has at least with one sample of delay, or same: that of the "
            "start."
        ),
    ] = None,
    growth: Annotated[
        float, typer.Option(help="Rate [1/s] up to which what grows counts as stable for the margin.")
    ] = 0.0,
    method: Annotated[str, typer.Option(help="both, global or local.")] = "both",
    budget: Annotated[int, typer.Option(help="Evaluations; each runs all robots.")] = 300,
    seed: Annotated[int, typer.Option(help="Of the robots and of the search.")] = 0,
    settings: SetOption = None,
    robot: RobotOption = None,
    unit: UnitOption = None,
    step: StepOption = None,
    stop: StopOption = None,
    master: MasterOption = None,
    inputs: InputOption = None,
    input_hold: HoldOption = False,
    backend: BackendOption = None,
    engine: Annotated[str, typer.Option(help="fmu, or batch: several runs at once.")] = "fmu",
    workers: Annotated[int | None, typer.Option(help="Processes; default one a processor.")] = None,
    time_limit: Annotated[float | None, typer.Option(help="Seconds that a run has; default 600.")] = None,
    out: Annotated[Path | None, typer.Option(help="Folder; default results/tune_SCENARIO.")] = None,
    overwrite: Annotated[
        bool, typer.Option("--overwrite", help="Replace another search in the folder.")
    ] = False,
) -> None:
    """Search the values of parameters that make a cost smallest, over a spread of robots and within limits.

    Every run is kept: after Ctrl-C or a kill the same command goes on where it was.
    """
    from rich.table import Table

    from vdfmu.study.sweeps.study import Sweep
    from vdfmu.study.tuning.tune import tune as run_tune

    found = run_tune(
            scenario, vary, cost, limit=limit or (), spread=spread or (), spread_n=spread_n, over=over,
            margin=margin, growth=growth,
            method=method, budget=budget, seed=seed, settings=parse_settings(settings), robot=robot,
            units=parse_settings(unit, "--unit", "COMPONENT=UNIT, such as controller=my_unit.py") or None,
            step=step, stop=stop, master=master, inputs=inputs, input_hold=input_hold or None, backend=backend,
            engine=engine, workers=workers, time_limit=time_limit, out=out, overwrite=overwrite,
    )  # fmt: skip
    say_notes(found.notes)
    units = Sweep(found.folder).facts["units"] | {"phase": "rad", "delay": "s"}
    table = Table("", "before", "after", "", box=None)
    for name, before, after in found.table():
        table.add_row(name, f"{before:.4g}", f"{after:.4g}", units.get(name.partition("[")[0], ""))
    tell(table, (found.folder / "tuned.toml").read_text().rstrip())
    say(
        f"{found.evaluations} evaluations, {found.failed} runs failed, {found.missed} values missed the margin and "
        f"were not run. Written to {found.folder}: tuned.toml, tune.json, sweep.parquet, tuning.png"
    )
