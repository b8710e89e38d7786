"""``vdfmu sweep`` and its subcommands, and ``vdfmu tune``."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any, Unpack

import typer

from vdfmu.base.files import replacing_foreign, require_ours
from vdfmu.cli.app import App, CommandGroup
from vdfmu.cli.terminal import (
    ForeignOption,
    JsonOption,
    ScenarioArgument,
    choice,
    complete_scenario,
    console,
    out_option,
    say,
    say_json,
    say_notes,
    say_written,
    table,
    tell,
)
from vdfmu.study.options import SweepOptions, TuneOptions

_SHOWN = 5
"""Failed points that are listed."""


class _SweepGroup(CommandGroup):
    """``vdfmu sweep SCENARIO`` is ``vdfmu sweep run SCENARIO``; options of all may come before either."""

    def resolve_command(self, ctx: Any, args: list[str]) -> Any:
        name = next((arg for arg in args if arg not in ("-q", "--quiet", "-v", "--verbose")), "")
        if name in self.commands:
            args.remove(name)
        return super().resolve_command(ctx, [name if name in self.commands else "run", *args])


app = App(
    name="sweep",
    cls=_SweepGroup,
    no_args_is_help=True,
    help="Run a scenario at many points: vdfmu sweep SCENARIO --vary ...",
    context_settings={"ignore_unknown_options": True},
)


@app.command(
    epilog="Example: [bold]vdfmu sweep tracking --vary 'controller.K_p[2]=*lin(0.5, 2, 20)' "
    "--measure 'error=rms(trajectory.q_d - plant.q)'[/bold]"
)
def run(
    scenario: Annotated[
        str,
        typer.Argument(
            help="Name of a shipped scenario, path of a TOML file, or a system package, .ssp.",
            autocompletion=complete_scenario,
        ),
    ] = "tracking",
    vary: Annotated[
        list[str] | None,
        typer.Option(
            metavar="TARGET=FORM",
            help="What varies: a parameter, or robot, master, step, stop, unit:COMPONENT. Forms: lin(a, b, n), "
            "log(a, b, n), normal(mean, deviation), lognormal(median, deviation), or values, 1, 2, 5; after a star "
            "factors, *lin(0.9, 1.1). Repeatable.",
        ),
    ] = None,
    **options: Unpack[SweepOptions],
) -> None:
    """Run a scenario at many points, and keep a row for each.

    What is done stays done: after Ctrl-C or a kill the same command continues where it stopped.
    """
    from vdfmu.study.sweeps.sweep import default_folder, sweep

    options["out"] = options["out"] or default_folder(scenario)
    try:
        found = sweep(scenario, vary or (), **options)
    except KeyboardInterrupt as error:
        error.add_note(f"What was done is in {options['out']}: give the same command again to go on.")
        raise
    say_notes(found.notes)
    _say_measures(found)
    say_written(found.path, more=f", {len(found)} points")


StudyArgument = Annotated[Path, typer.Argument(help="sweep.parquet of a study, or its folder.")]
ByOption = Annotated[
    str | None,
    typer.Option(
        metavar="NAME", help="A measure, of whose elements the largest counts, or a column; default the first."
    ),
]


@app.command(epilog="Example: [bold]vdfmu sweep plot results/sweep_tracking --by error[/bold]")
def plot(
    study: StudyArgument,
    by: ByOption = None,
    kind: Annotated[
        str | None, typer.Option(**choice("curve", "tornado", "indices"), help="Figure; default all that fit.")
    ] = None,
    out: Annotated[Path | None, out_option("Folder; default the study's.")] = None,
) -> None:
    """Draw a measure of a study over its axes."""
    from vdfmu.study.sweeps.sweep import Sweep

    say_written(*Sweep(study).plot(kind, by, out))


@app.command(epilog="Example: [bold]vdfmu sweep indices results/sweep_tracking --by error[/bold]")
def indices(study: StudyArgument, by: ByOption = None, as_json: JsonOption = False) -> None:
    """Print Sobol or Morris indices of a study with --sample saltelli or morris."""
    from vdfmu.study.sweeps.indices import CONFIDENCE
    from vdfmu.study.sweeps.sweep import Sweep

    found = Sweep(study).indices(by)
    if as_json:
        say_json({name: row for name, row in found.rows()})
        return
    shown = table("axis", *found.values)
    for name, row in found.rows():
        shown.add_row(name, *(row.get(index, "") for index in found.values))
    console.print(shown)
    say(f"± the half-width of the {100 * CONFIDENCE:.0f} % confidence interval, by bootstrap.")


@app.command(epilog="Example: [bold]vdfmu sweep report results/sweep_tracking[/bold]")
def report(
    study: StudyArgument,
    out: Annotated[
        Path | None, out_option("File; default report.html in the folder. FILE.tex has the measures as LaTeX.")
    ] = None,
    simulate: Annotated[bool, typer.Option(help="Let the page run any point, where the compiler is installed.")] = True,
    overwrite: ForeignOption = False,
) -> None:
    """Write a page of a study: its points in pictures that choose together, measures, and failures by cause."""
    from vdfmu.study.report.latex import SUFFIX, write_tables
    from vdfmu.study.report.page import NAME
    from vdfmu.study.sweeps.sweep import Sweep

    found = Sweep(study)
    with replacing_foreign(overwrite):
        require_ours(out or found.folder / NAME)
    if out is not None and out.suffix == SUFFIX:
        say_written(write_tables([found.sheet()], out))
        return
    say_written(found.report(out, simulate=simulate))


def _say_measures(found: Any) -> None:
    """Print the range of each measure, and the points that failed."""
    from vdfmu.study.report.tables import sheet_table

    tell(sheet_table(found.sheet()))
    failed = found.failed
    for point, words in list(failed.items())[:_SHOWN]:
        say(f"point {point} failed: {words}")
    if len(failed) > _SHOWN:
        say(f"and {len(failed) - _SHOWN} more points failed: column 'failed'")


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
    from vdfmu.study.sweeps.sweep import Sweep
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
