"""The commands, and how their errors end them."""

from __future__ import annotations

import io
import logging
import os
import sys
import warnings
from typing import Annotated

import typer

from vdfmu.base.errors import ModelError, SspError, UsageError, VdfmuError
from vdfmu.base.once import one_job
from vdfmu.base.version import __version__
from vdfmu.cli import (
    cache,
    compares,
    doctor,
    files,
    identify,
    margins,
    models,
    modes,
    motions,
    robots,
    runs,
    sweeps,
    tunes,
    units,
    view,
)
from vdfmu.cli.app import App, QuietOption, VerboseOption, look, look_anew
from vdfmu.cli.terminal import console, fail

app = App(
    no_args_is_help=True,
    pretty_exceptions_enable=False,
    rich_markup_mode="rich",
    help="Flexible-joint manipulators as co-simulation FMUs: build them, wire them, run them, check them.",
)
for function, example in (
    (runs.run, "vdfmu run tracking --set controller.K_p=1500 --out results/soft"),
    (runs.simulate, "vdfmu simulate tracking.ssp --master jacobi --out results/jacobi"),
    (runs.report, "vdfmu report results/tracking results/soft"),
    (runs.federate, "vdfmu federate tracking.ssp --split plant --split feedforward,controller"),
    (
        tunes.tune,
        "vdfmu tune tracking --vary controller.K_p --vary controller.K_v --cost 'rms(trajectory.q_d - plant.q)' "
        "--spread 'plant.mass=*normal(1, 0.05)' --margin same",
    ),
    (compares.compare, "vdfmu compare --arms ur5e_6dof --laws controller,pd_gravity --mismatch none,payload"),
    (motions.motion, "vdfmu motion path.toml --robot planar_2dof -o path.png"),
    (modes.modes, "vdfmu modes manipulator_6dof --pose '0 0.5 0.5 0 0 0'"),
    (view.view, "vdfmu view panda_7dof"),
    (margins.margins, "vdfmu margins tracking --master jacobi --at 2.5"),
    (identify.identify, "vdfmu identify results/tracking/results.csv --robot manipulator_6dof -o identified.toml"),
    (files.build, "vdfmu build tracking --backend native --fmi 3.0 --platform all --out fmus"),
    (files.container, "vdfmu container tracking --out tracking.fmu"),
    (files.ssp, "vdfmu ssp two_joint --format 2.0 --out two_joint.ssp"),
    (files.reference, "vdfmu reference two_joint --out reference"),
    (files.check, "vdfmu check fmus/Plant.fmu"),
    (files.verify, "vdfmu verify fmus/Plant.fmu"),
    (doctor.doctor, "vdfmu doctor"),
):
    app.command(epilog=f"Example: [bold]{example}[/bold]")(function)
for group in (sweeps.app, models.app, robots.app, cache.app, units.app):
    app.add_typer(group, name=group.info.name)


def _show_version(wanted: bool) -> None:
    if wanted:
        console.print(f"vdfmu {__version__}")
        raise typer.Exit


@app.callback()
def _options(
    version: Annotated[
        bool, typer.Option("--version", help="Show the version and exit.", is_eager=True, callback=_show_version)
    ] = False,
    quiet: QuietOption = False,
    verbose: VerboseOption = False,
) -> None:
    look_anew()
    look(quiet, verbose)


def command() -> None:
    """Run a command and turn errors into a message and an exit code."""
    # Units in this process say what they say through FMI; their own logger would say it again.
    for speaks in ("vdfmu.compiler.fmu", "matplotlib"):
        logging.getLogger(speaks).addHandler(logging.NullHandler())
        logging.getLogger(speaks).propagate = False
    if not sys.warnoptions:  # warnings of libraries are for their programmers
        warnings.simplefilter("ignore")
        os.environ["PYTHONWARNINGS"] = "ignore"  # in the processes of isolated components too
    for stream in (sys.stdout, sys.stderr):  # of any encoding, such as ASCII
        if isinstance(stream, io.TextIOWrapper):
            stream.reconfigure(errors="backslashreplace")
    try:
        with one_job():
            app()
    except (UsageError, ModelError, SspError) as error:
        fail(error, 2)
    except VdfmuError as error:
        fail(error, 1)
    except OSError as error:
        if isinstance(error.__context__, KeyboardInterrupt):
            raise
        if error.filename is not None:  # such as a name that is too long
            fail(f"{error.filename}: {error.strerror}", 2)
        # else of the output of a command
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        if not isinstance(error, BrokenPipeError):
            fail(f"the output cannot be written: {error.strerror or error}", 1)
        sys.exit(1)
