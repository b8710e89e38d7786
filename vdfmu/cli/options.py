"""Options that commands share, and the reading of their values."""

from __future__ import annotations

import re
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import click

from vdfmu.base.errors import UsageError
from vdfmu.base.option import Option, option_of
from vdfmu.cli.parameters import Positional
from vdfmu.study.options import RobotOptions, ScenarioRunOptions, known_robots

if TYPE_CHECKING:
    from vdfmu.system.scenario import Scenario


def known_scenarios() -> list[str]:
    """Return the names of scenarios."""
    from vdfmu.system.scenario import scenario_names

    return [*scenario_names(), "reach"]


def _bytes(text: str) -> int:
    """Read a size such as ``500M`` or ``4G``."""
    match = re.fullmatch(r"([1-9]\d{0,11})([KMGT]?)(i?B)?", text.strip(), re.IGNORECASE)
    if not match:
        raise click.BadParameter(f"expected a size such as 500M or 4G, got {text!r}")
    return int(match[1]) * 1024 ** " KMGT".index(match[2].upper() or " ")


ScenarioArgument = Annotated[str, Positional("Name of a scenario, TOML file, or reach.", names=known_scenarios)]
RobotArgument = Annotated[str, Positional("Name of a robot, or a TOML file.", names=known_robots)]
RobotOption = Annotated[str | None, option_of(RobotOptions, "robot")]
BackendOption = Annotated[str | None, option_of(RobotOptions, "backend")]
TrustOption = Annotated[bool, Option("Run the code that the file names.",
    more="It runs with your permissions.")]  # fmt: skip
OverwriteOption = Annotated[bool, Option("Replace a file of this name.")]
ForeignOption = Annotated[bool, Option("Also overwrite files not written by vdfmu.")]
OpenOption = Annotated[bool, Option("Open the page in a browser.", default=False, flag="--open")]
JsonOption = Annotated[bool, Option("Print JSON instead of tables.", flag="--json")]
FmiOption = Annotated[str, option_of(ScenarioRunOptions, "fmi_version")]
SetOption = Annotated[dict[str, str] | None, option_of(RobotOptions, "parameters")]
UnpackOption = Annotated[int | None, Option("Largest unpacked size, such as 4G (default 2G).", metavar="SIZE",
    typed=str, read=_bytes)]  # fmt: skip


def target_file(out: Path | None, name: str, overwrite: bool) -> Path:
    """Return the file to write; UsageError if it exists and may not be replaced."""
    target = out if out is not None else Path(name)
    if target.exists() and not overwrite:
        raise UsageError(f"{target}: expected no file of this name. --overwrite replaces it, -o names another.")
    return target


def refuse(options: Mapping[str, Any], why: str) -> None:
    """Raise UsageError for the options that have a value: they do not fit, and `why`."""
    if unfit := [name for name, value in options.items() if value not in (None, "", [], {}) and value is not False]:
        raise UsageError("\n".join(f"{name} {why}." for name in unfit))


def load(scenario: str, robot: str | None, parameters: Mapping[str, str] | None = None) -> Scenario:
    """Load a scenario for parameters; missing files are named before slow imports."""
    from vdfmu.base.toml_file import locate

    if scenario != "reach" or Path(scenario).exists():
        locate(scenario, "scenarios")
    if robot is not None:
        locate(robot, "robots")
    from vdfmu.study.analysis.reach import scenario_of

    return scenario_of(scenario, robot, parameters or ())
