"""``vdfmu sweep`` and its subcommands."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any, Unpack

from vdfmu.base.errors import UsageError
from vdfmu.base.extras import module_of_extra
from vdfmu.base.files import replacing_foreign, require_ours
from vdfmu.base.option import Option
from vdfmu.base.text import amount
from vdfmu.cli.app import RUNS, App, meets_code
from vdfmu.cli.options import (
    AnywayOption,
    ForeignOption,
    Positional,
    TrustOption,
    UnpackOption,
    known_scenarios,
    refuse,
)
from vdfmu.cli.runs import FMUS, package_of, reading_fmus
from vdfmu.cli.terminal import console, say, say_notes, say_written, tell
from vdfmu.study.options import SweepOptions


class _SweepGroup(App):
    """``vdfmu sweep SCENARIO`` is ``vdfmu sweep run SCENARIO``."""

    def resolve_command(self, ctx: Any, args: list[str]) -> Any:
        return super().resolve_command(ctx, args if args[0] in self.commands else ["run", *args])


app = _SweepGroup(
    "sweep",
    no_args_is_help=True,
    help="Run a scenario at many points. The word run is optional: vdfmu sweep SCENARIO --vary ..",
    context_settings={"ignore_unknown_options": True},
)


@app.command(
    example="vdfmu sweep tracking --vary 'controller.K_p[2]=*lin(0.5, 2, 20)' "
    "--measure 'error=rms(trajectory.q_d - plant.q)'"
)
@meets_code(RUNS)
def run(
    system: Annotated[list[str] | None, Positional(
        "Scenario [tracking], x.ssp, x.fmu, a=A.fmu b=B.fmu.", names=known_scenarios)] = None,
    vary: Annotated[list[str] | None, Option("Axis: 'controller.K_p=lin(1, 2, 9)'. Repeatable.", metavar="TARGET=FORM",
        more="TARGET is a parameter, or robot, algorithm, step, stop, unit:COMPONENT. FORM is lin(a, b, n), "
        "log(a, b, n), normal(mean, deviation), lognormal(median, deviation), or values, 1, 2, 5. A star before FORM "
        "makes the values factors: *lin(0.9, 1.1).")] = None,
    unpack_limit: UnpackOption = None, run_anyway: AnywayOption = False,
    **options: Unpack[SweepOptions],
) -> None:  # fmt: skip
    """Run a scenario or FMUs at many points, and keep a row for each.

    After Ctrl-C or a kill, repeat the command to resume. The exit code is 1 if no point has a value.
    """
    from vdfmu.engine.results.verdict import FAILED
    from vdfmu.study.report.sheets import sheet_table
    from vdfmu.study.sweeps.sweep import sweep

    parts, joined = system or ["tracking"], None
    fmus = any(map(FMUS.fullmatch, parts))
    if not fmus:
        refuse({"--unpack-limit": unpack_limit, "--run-anyway": run_anyway}, "is for FMUs, got a scenario")
        if len(parts) > 1:
            raise UsageError(f"{' '.join(parts)}: expected one scenario, got {len(parts)}. Study each by itself.")
    with reading_fmus(unpack_limit, run_anyway):
        if fmus:
            _, _, joined = package_of(parts, options)
        if joined is None:
            study = sweep(parts[0], vary or (), **options)
        else:
            study = joined.sweep(vary or (), **{**options, "connections": None})  # they are in the study's package
    say_answer(study)
    say_notes(study.notes)
    tell(sheet_table(study.sheet()))
    page, points = study.report(), f"; {amount(len(study), 'point')}"
    if study.unchanged:
        say(f"Nothing has changed in {study.folder}: {study.path.name}, {page.name}{points}")
    else:
        say_written(study.path, page, more=points)
    if study.answer.state == FAILED:
        raise SystemExit(1)


StudyArgument = Annotated[Path, Positional("Table of a study, or its folder.")]


@app.command(example="vdfmu sweep report results/sweep_tracking")
@meets_code(RUNS)
def report(
    study: StudyArgument,
    out: Annotated[Path | None, Option("Page, folder, or FILE.tex (default report.html).",
        more="FILE.tex has the measures.")] = None,
    simulate: Annotated[bool, Option("Let the page run any point.")] = True,
    overwrite: ForeignOption = False,
    trust: TrustOption = False,
) -> None:  # fmt: skip
    """Write the page of a study. It has linked figures of the points and measures, and the failures by cause."""
    from vdfmu.study.report.sheets import LATEX
    from vdfmu.study.report.shown_run import NAME
    from vdfmu.study.sweeps.sweep import Sweep

    sweep = Sweep(study)
    with replacing_foreign(overwrite):
        require_ours(out or sweep.folder / NAME)
    if out is not None and out.suffix == LATEX:
        write_tables = module_of_extra("latex", "compare", "A file of tables").write_tables
        say_written(write_tables([("", sweep.sheet())], out))
        return
    page = sweep.report(out, simulate=simulate, trust=trust)
    say_notes(sweep.notes)
    say_written(page)


def say_answer(study: Any) -> None:
    """Print the verdict on a study, then the sentences of its answer."""
    from vdfmu.study.report.sheets import verdict_text

    console.print(verdict_text({"verdict": study.answer.verdict}), soft_wrap=True)
    tell(*study.answer.sentences)
