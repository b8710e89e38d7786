"""``vdfmu run``, ``report`` and ``judge``."""

# Types are not quoted, because the options of both forms of a run are read from them.
import logging
import re
from collections.abc import Generator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Annotated, Any

import click
from click.core import ParameterSource

from vdfmu.base.bars import errors
from vdfmu.base.errors import LOG, CosimError, SspError, UsageError
from vdfmu.base.files import replacing_foreign
from vdfmu.base.measure import number, per_cent
from vdfmu.base.option import Option, option_of, pick
from vdfmu.cli.app import LOOKS, RUNS, meets_code
from vdfmu.cli.options import (
    AnywayOption,
    ForeignOption,
    JsonOption,
    OpenOption,
    Positional,
    RobotOption,
    TrustOption,
    UnpackOption,
    known_scenarios,
    load,
    refuse,
)
from vdfmu.cli.terminal import (
    console,
    say,
    say_error,
    say_json,
    say_notes,
    say_page,
    say_written,
    table,
    tell,
    unit_messages,
)
from vdfmu.engine.options import SystemOptions, algorithm_option, parameters_option
from vdfmu.study.options import ExpectOptions, JudgeOptions, ScenarioOptions, ScenarioRunOptions

FMUS = re.compile(r".*\.(ssp|fmu)|\w+=.+(?<!\.toml)", re.IGNORECASE)
"""A package, an FMU, or a component with its FMU or unit."""


class ScenarioForm(ScenarioRunOptions, total=False):
    """Options of the run of a scenario."""

    opened: OpenOption
    study: Annotated[
        Path | None, Option("Run a point of this study: its folder or table.", flag="--from", metavar="SWEEP")
    ]
    row: Annotated[str | None, Option("Point: worst, best or a number (default worst).", metavar="POINT")]
    by: Annotated[str | None, Option("Measure that ranks the points (default the first).", metavar="NAME")]
    trust: Annotated[bool, Option("Allow running code that a study's file names.",
        more="It runs with your permissions.", default=False)]  # fmt: skip


class FmusForm(SystemOptions, JudgeOptions, ExpectOptions, total=False):
    """Options of the run of FMUs."""

    connections: Annotated[Sequence[tuple[str, str]] | None, option_of(ScenarioOptions, "connections")]
    unpack_limit: UnpackOption
    run_anyway: AnywayOption
    opened: OpenOption


@meets_code(RUNS)
def run(
    system: Annotated[list[str] | None, Positional(
        "Scenario [tracking], x.ssp, x.fmu, a=A.fmu b=B.fmu.", names=known_scenarios)] = None,
    **options: Any,
) -> None:  # fmt: skip
    """Run a scenario, a system package or FMUs, and judge the run.

    SYSTEM is a scenario (name, TOML file, or reach), a package, an FMU, or components that --connect joins, each an FMU
    or a unit such as my_unit.py. A failed run has exit code 1.
    """
    parts = system or []
    fmus = any(map(FMUS.fullmatch, parts))
    if fmus:
        _refuse_others(FmusForm, f"is only for a scenario, got {' '.join(parts)}")
    else:
        _refuse_others(ScenarioForm, f"is only for FMUs, got the scenario {' '.join(parts) or 'tracking'}")
    try:
        with unit_messages() as options["log"]:
            results, outputs = (_run_fmus if fmus else _run_scenario)(parts, options)
    except (CosimError, KeyboardInterrupt) as error:
        if getattr(error, "results", None) is not None:
            _say_failed(error, options)
        raise
    from vdfmu.engine.results.folder import written
    from vdfmu.engine.results.verdict import FAILED, state_of
    from vdfmu.study.report.sheets import events_lines, run_panel, sheet_table, sheets, verdict_table

    summary = results.summary
    folder, failed, verbose = _folder(options, summary), state_of(summary) == FAILED, LOG.isEnabledFor(logging.INFO)
    _say_verdict(summary)
    if fmus or verbose:
        tell(run_panel(summary))
    else:
        tell(*events_lines(summary))
    tell(*map(sheet_table, sheets(summary) if verbose else ()))
    if not fmus:
        (console.print if failed else tell)(verdict_table(summary, verbose))
    say_written(*(folder / name for name in written(folder, outputs)))
    if (page := folder / outputs[-1]).exists():
        say_page(page, options["opened"])
    if failed:
        raise SystemExit(1)


run.forms = {"Scenarios only": ScenarioForm, "FMUs only": FmusForm}  # type: ignore[attr-defined]


def _refuse_others(form: type[Any], why: str) -> None:
    """Raise UsageError for command-line options that belong to the other form of a run."""
    context = click.get_current_context()
    names = {"system", "compiler", "quiet", "verbose", *form.__annotations__}
    further = [each for each in context.command.params if each.name not in names]
    typed = [each for each in further if context.get_parameter_source(each.name or "") is ParameterSource.COMMANDLINE]
    refuse({"/".join([each.opts[-1], *each.secondary_opts]): True for each in typed}, why)


def _folder(options: Mapping[str, Any], summary: Mapping[str, Any]) -> Path:
    return Path(options["out"] or Path("results", summary["scenario"]))


def _run_scenario(parts: Sequence[str], options: Mapping[str, Any]) -> tuple[Any, Sequence[str]]:
    """Run a scenario; return its results and the names of its files, the page last."""
    study = options["study"]
    settings: dict[str, Any] = {**pick(ScenarioRunOptions, options), "simulate": options["simulate"] is not False}
    if len(parts) > 1:
        raise UsageError(f"{' '.join(parts)}: expected one scenario, got {len(parts)}. Run each by itself.")
    if study is None:
        refuse({f"--{name}": options[name] for name in ("row", "by", "trust")}, "goes with --from")
        scenario = parts[0] if parts else "tracking"
        if scenario.lower().endswith(".py"):
            way = "'vdfmu build' makes its FMU, and --unit COMPONENT=FILE puts it into a scenario"
            raise UsageError(f"{scenario}: must be a scenario, got a unit. {way}.")
        settings["scenario"] = load(scenario, settings.pop("robot"))
    elif parts:
        raise UsageError(f"{parts[0]}: expected no scenario with --from: {study} has its own.")
    else:
        from vdfmu.engine.package.system import ends_of
        from vdfmu.study.sweeps.sweep import Sweep

        sweep = Sweep(study)
        point = sweep.options(options["row"] or "worst", options["by"], trust=options["trust"])
        say_notes(sweep.notes)
        changed = pick(ScenarioOptions, options)
        settings |= point | {name: value for name, value in changed.items() if value not in (None, {}, [])}
        for name in ("units", "parameters"):
            settings[name] = point.get(name, {}) | (options[name] or {})
        typed = options["connections"] or ()
        kept = [pair for pair in ends_of(point.get("connections", ())) if pair[1] not in {end for _, end in typed}]
        settings["connections"] = [*kept, *typed]
    from vdfmu.engine.results.folder import RUN_OUTPUTS
    from vdfmu.study.runs import run as run_study

    return run_study(**settings), RUN_OUTPUTS


def _say_failed(error: Any, options: Mapping[str, Any]) -> None:
    """Print the verdict on a failed or stopped run, the reason of a failure, and the page of its rows."""
    from vdfmu.engine.results.folder import PAGE, PARTIAL

    summary = error.results.summary
    page = _folder(options, summary) / PARTIAL / PAGE
    if not len(error.results) or not page.exists():
        return
    stopped = isinstance(error, KeyboardInterrupt)
    _say_verdict(summary)
    if not stopped:
        say_error(error)
    say_page(page, options["opened"])
    if not stopped:
        raise SystemExit(1)


def _run_fmus(parts: Sequence[str], options: dict[str, Any]) -> tuple[Any, Sequence[str]]:
    """Run FMUs; return their results and the names of the files, the page last."""
    wanted, sampled = options["judge"], options["sampled"]
    if wanted is not None or sampled is not None:
        from vdfmu.study.judgement import check_wanted  # takes long to import

        check_wanted(wanted, sampled, options["adaptive"])
    from vdfmu.engine.package_run import default_folder
    from vdfmu.engine.results.folder import RUN_OUTPUTS
    from vdfmu.study.expected import read_expected
    from vdfmu.study.joined import run_joined

    expected = read_expected(options["expect"], options["within"])
    with reading_fmus(options["unpack_limit"], options["run_anyway"]):
        package, source, kept = package_of(parts, options)
        folder = Path(options["out"] or (Path("results", package.stem) if kept else default_folder(package)))
        options["out"] = folder  # reports a failed run together with its page
        settings = pick(SystemOptions, options)
        return run_joined(package, source, folder, wanted, sampled, expected, **settings), RUN_OUTPUTS


@contextmanager
def reading_fmus(unpack_limit: int | None, anyway: bool) -> Generator[None]:
    """Read FMUs within the block with these options; an error that ``--run-anyway`` avoids names this option."""
    from vdfmu.engine.package.archive import package_limit
    from vdfmu.engine.rules import can_run, run_anyway

    with package_limit(unpack_limit), run_anyway(anyway):
        try:
            yield
        except SspError as error:
            if all(map(can_run, error.problems)):
                error.add_note("The FMUs can run despite this: --run-anyway.")
            raise


def package_of(parts: Sequence[str], options: Mapping[str, Any]) -> tuple[Path, str | None, Any]:
    """Return the package of FMUs; if made for the run, also its name for results and the object to keep alive."""
    connections, first, unnamed = options["connections"], parts[0], [part for part in parts if "=" not in part]
    if parts == unnamed and len(parts) == 1 and first.lower().endswith(".ssp"):
        refuse({"--connect": connections}, f"is for a scenario or FMUs; {first} has its own connections")
        return Path(first), None, None
    if len(parts) > 1 and (packages := [part for part in parts if part.lower().endswith(".ssp")]):
        raise UsageError(f"{packages[0]}: expected FMUs and units, got a package. Run each package by itself.")
    if unnamed and len(parts) > 1:
        wrong = unnamed[0]
        raise UsageError(f"{wrong}: must be NAME=FILE if there are several. Write {Path(wrong).stem}={wrong}.")
    from vdfmu.study.connected import connect, load_fmu

    named = [part.split("=", 1) for part in parts if part not in unnamed]
    names = [name for name, _ in named]
    if twice := [name for name in names if names.count(name) > 1]:
        raise UsageError(f"{twice[0]}: expected one FMU or unit of this name, got {names.count(twice[0])}. Rename one.")
    connections, algorithm = connections or (), options["algorithm"]
    if named:
        system = connect(dict(named), connections, algorithm=algorithm)
    else:
        system = load_fmu(first, connections, algorithm)
    return system.path, " ".join(parts), system


@meets_code(LOOKS)
def report(
    folders: Annotated[list[Path] | None, Positional(
        "Folders of runs (default the newest in results).", metavar="[DIR]...",
        more="Several runs are compared on one page. For a folder of runs it is index.html, with their links and "
            "verdicts.")] = None,
    out: Annotated[Path | None, Option(
        "Page, folder, or FILE.tex (default report.html).",
        more="The page of several runs is comparison.html. FILE.tex has the tables of the runs.")] = None,
    simulate: Annotated[bool, Option("Add sliders that repeat the run in the page.")] = True,
    opened: OpenOption = False, overwrite: ForeignOption = False, trust: TrustOption = False,
) -> None:  # fmt: skip
    """Write the page of a run, or compare several runs on one page."""
    from vdfmu.study.report.page import report_of
    from vdfmu.study.report.sheets import LATEX

    with replacing_foreign(overwrite):
        page = report_of(folders or (), out, simulate=simulate)
    say_written(page)
    if page.suffix != LATEX:
        say_page(page, opened)


@meets_code(RUNS)
def judge(
    system: Annotated[
        str, Positional("System package, FMU, or scenario.", metavar="FILE.ssp|SCENARIO", names=known_scenarios)
    ],
    robot: RobotOption = None,
    wanted: Annotated[
        float | None, option_of(JudgeOptions, "judge", "Allowed error in % of a signal's range (default 1).")
    ] = None,
    step: Annotated[float | None, Option("Communication step in s (default the system's).")] = None,
    stop: Annotated[float | None, Option("Stop time in s (default the system's).")] = None,
    algorithm: Annotated[str | None, algorithm_option] = None,
    parameters: Annotated[dict[str, str] | None, parameters_option] = None,
    sampled: Annotated[bool | None, option_of(JudgeOptions, "sampled")] = None,
    as_json: JsonOption = False,
) -> None:
    """Estimate the error that the communication step causes in a system.

    Runs with the step, its half and its quarter give the error of each real output, as a fraction of its range. The
    exit code is 0 if the system is right, 1 if it is not, 3 if this cannot be decided, and 2 for wrong usage.
    """
    from vdfmu.study.connected import load as load_system

    if system.lower().endswith((".ssp", ".fmu")):
        refuse({"--robot": robot}, "is for a scenario")
        judging = load_system(system)
    else:
        judging = load_system(load(system, robot, parameters))
    judged = judging.judge(
        0.01 if wanted is None else wanted,
        stop=stop,
        step=step,
        parameters=parameters,
        algorithm=algorithm,
        sampled=sampled,
    )
    if as_json:
        say_json(judged.to_dict())
    else:
        shown = table("signal", "error", "half / whole", "at", title=f"Step {judged.step:g} s, {judged.algorithm}")
        for signal in judged.signals[:_MOST_SIGNALS]:
            shown.add_row(signal.name, per_cent(signal.error), number(signal.q, 2), f"{number(signal.time, 4)} s")
        if judged.signals:
            tell(shown)
        (say if judged.right else say_error)(str(judged))
    if not judged.right:
        raise SystemExit(3 if judged.right is None else 1)


_MOST_SIGNALS = 8


def _say_verdict(summary: Mapping[str, Any]) -> None:
    """Print the verdict on a run; with ``--quiet`` only its headline."""
    from vdfmu.study.report.sheets import outcome_text, verdict_text

    if text := outcome_text(summary) if errors.quiet else verdict_text(summary):
        console.print(text, soft_wrap=True)
