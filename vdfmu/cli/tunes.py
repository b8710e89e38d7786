"""``vdfmu tune``."""

from __future__ import annotations

from typing import Annotated, Unpack

import typer

from vdfmu.cli.terminal import ScenarioArgument, say, say_notes, say_written, table, tell
from vdfmu.study.options import TuneOptions


def tune(
    scenario: ScenarioArgument = "tracking",
    *,
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
            help="Cost to make smallest, such as 'worst(rms(trajectory.q_d - plant.q))'; of several elements the mean "
            "of their ratios to those of the start, none beyond 1.",
        ),
    ],
    **options: Unpack[TuneOptions],
) -> None:
    """Search the values of parameters that make a cost smallest, over a spread of robots and within limits.

    Every run is kept: after Ctrl-C or a kill the same command continues where it stopped.
    """
    from vdfmu.study.sweeps.study import Sweep
    from vdfmu.study.tuning.tune import tune as run_tune

    found = run_tune(scenario, vary, cost, **options)
    say_notes(found.notes)
    units = Sweep(found.folder).facts["units"] | {"phase": "rad", "delay": "s"}
    shown = table("", "before", "after", "")
    for name, before, after in found.table():
        shown.add_row(name, f"{before:.4g}", f"{after:.4g}", units.get(name.partition("[")[0], ""))
    tell(shown, (found.folder / "tuned.toml").read_text().rstrip())
    say(
        f"{found.evaluations} evaluations, {found.failed} runs failed, {found.missed} values missed the margin and "
        "were not run."
    )
    say_written(*(found.folder / name for name in ("tuned.toml", "tune.json", "sweep.parquet", "tuning.png")))
