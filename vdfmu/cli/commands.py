"""The commands, and how errors end them."""

from __future__ import annotations

import io
import logging
import os
import sys
import warnings
from typing import Any

import click

from vdfmu.base.cache import one_job
from vdfmu.base.errors import ModelError, SspError, UsageError, VdfmuError
from vdfmu.base.extras import extra_modules
from vdfmu.base.version import __version__
from vdfmu.cli import doctor, files, robots, runs, scenarios, studies, units
from vdfmu.cli.app import COMPLETE, App
from vdfmu.cli.terminal import console, fail, folder_is_gone

COMMANDS: dict[str, tuple[tuple[Any, str], ...]] = {
    "Run": ((runs.run, "vdfmu run tracking --set controller.K_p=1500 --out results/soft"), (studies.app, "")),
    "Look": ((runs.report, "vdfmu report results/tracking results/soft"),),
    "Analyse": ((runs.judge, "vdfmu judge tracking.ssp --wanted 0.5 --stop 1"),),
    "Exchange": (
        (files.build, "vdfmu build tracking --backend native --fmi 3.0 --platform all --out fmus"),
        (files.ssp, "vdfmu ssp two_joint --ssp 2.0 --out two_joint.ssp"),
        (files.check, "vdfmu check fmus/Plant.fmu"),
    ),
    "Models": ((robots.app, ""), (scenarios.app, ""), (units.app, "")),
    "Installation": ((doctor.doctor, "vdfmu doctor"),),
}
"""The commands of the core in groups, each with an example; subcommands have their examples."""


def _show_version(context: click.Context, parameter: click.Parameter, wanted: bool) -> None:
    if wanted:
        console.print(f"vdfmu {__version__}")
        context.exit()


def _completion(context: click.Context, parameter: click.Parameter, shell: str | None) -> None:
    """Print the script with which a shell completes commands and options."""
    if shell is not None:
        from click.shell_completion import get_completion_class

        if (kind := get_completion_class(shell)) is None:
            raise click.BadParameter(f"expected bash, zsh or fish, got {shell}", context, parameter)
        print(kind(app, {}, "vdfmu", COMPLETE).source())
        context.exit()


def command() -> None:
    """Run a command and turn errors into a message and an exit code."""
    # Units in this process log through FMI; their own logger would repeat it.
    for speaks in ("vdfmu.compiler.fmu", "matplotlib"):
        logging.getLogger(speaks).addHandler(logging.NullHandler())
        logging.getLogger(speaks).propagate = False
    if not sys.warnoptions:  # libraries' warnings are for programmers
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
        if folder_is_gone():
            fail("", 2)
        # otherwise of the command's output
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        if not isinstance(error, BrokenPipeError):
            fail(f"the output cannot be written: {error.strerror or error}", 1)
        sys.exit(1)


app = App(
    "vdfmu",
    help="vdfmu models robot arms with elastic joints by virtual decomposition, as the paper 'Virtual Decomposition "
    "Based Modeling for Multi-DOF Manipulator With Flexible Joint' describes it: each link and each joint is a "
    "subsystem, so the cost grows linearly with the number of joints. The arm, its feedforward, its PD controller and "
    "its motion are separate FMUs; an SSP connects them, fmpy or compiled code steps them, and the run is compared "
    "with scipy's solution of the same equations.",
    declare=lambda: [
        click.Option(
            ["--version"],
            is_flag=True,
            is_eager=True,
            expose_value=False,
            callback=_show_version,
            help="Show the version.",
        ),
        click.Option(
            ["--completion"],
            metavar="SHELL",
            is_eager=True,
            expose_value=False,
            callback=_completion,
            help="Print the completion of bash, zsh or fish.",
        ),
    ],
)
for added in (COMMANDS, *(getattr(module, "COMMANDS", {}) for module in extra_modules("commands"))):
    for panel, listed in added.items():
        app.add(listed, panel)
