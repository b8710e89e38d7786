"""``vdfmu scenario list`` and ``show``, and ``vdfmu schema``."""

from __future__ import annotations

from typing import Annotated

from vdfmu.base.option import Option
from vdfmu.cli.app import App
from vdfmu.cli.parameters import Positional
from vdfmu.cli.terminal import JsonOption, known_scenarios, say, say_json, say_list

app = App("scenario", no_args_is_help=True, help="List and show scenarios.")


@app.command("list", example="vdfmu scenario list")
def list_scenarios(as_json: JsonOption = False) -> None:
    """List the scenarios that travel with the package."""
    from vdfmu.system.scenario import load_scenario, scenario_names

    say_list("scenario", {name: load_scenario(name).description for name in scenario_names()}, as_json)


@app.command("show", example="vdfmu scenario show tracking")
def show_scenario(name: Annotated[str, Positional("Scenario, or its TOML file.", names=known_scenarios)]) -> None:
    """Show the file of a scenario."""
    from vdfmu.base.toml_file import locate, read_toml

    read_toml(path := locate(name, "scenarios"))
    say(path.read_text(encoding="utf-8"))


def schema(
    kind: Annotated[str, Positional("Kind of the file.", choices=("robot", "scenario", "system"))],
    system: Annotated[str, Option("System of the scenario.", more="Its components have sections.")] = "system",
) -> None:
    """Print the JSON schema of a TOML file.

    Editors read it if the first line of the file is "#:schema robot.schema.json".
    """
    from vdfmu.base.errors import UsageError
    from vdfmu.system.scenario import schema

    schemas = {
        "robot": schema.robot_schema,
        "scenario": lambda: schema.scenario_schema(system),
        "system": schema.system_schema,
    }
    if kind not in schemas:
        raise UsageError(f"schema: expected {', '.join(schemas)}, got {kind!r}.")
    say_json(schemas[kind]())
