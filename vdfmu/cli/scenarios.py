"""``vdfmu scenario list`` and ``show``, and ``vdfmu schema``."""

from __future__ import annotations

from typing import Annotated

import typer

from vdfmu.cli.app import App
from vdfmu.cli.terminal import JsonOption, choice, complete_scenario, say, say_json, say_list

app = App(name="scenario", no_args_is_help=True, help="List and show scenarios.")


@app.command("list", epilog="Example: [bold]vdfmu scenario list[/bold]")
def list_scenarios(as_json: JsonOption = False) -> None:
    """List the scenarios that travel with the package."""
    from vdfmu.system.scenario import load_scenario, scenario_names

    say_list("scenario", {name: load_scenario(name).description for name in scenario_names()}, as_json)


@app.command("show", epilog="Example: [bold]vdfmu scenario show tracking[/bold]")
def show_scenario(
    name: Annotated[
        str, typer.Argument(help="Name of a scenario, or path of its TOML file.", autocompletion=complete_scenario)
    ],
) -> None:
    """Show the file of a scenario."""
    from vdfmu.base.toml_file import locate, read_toml

    read_toml(path := locate(name, "scenarios"))
    say(path.read_text(encoding="utf-8"))


def schema(
    kind: Annotated[str, typer.Argument(**choice("robot", "scenario", "system"), help="Kind of the file.")],
    system: Annotated[str, typer.Option(help="Whose components the sections of a scenario are for.")] = "system",
) -> None:
    """Print the JSON schema of a TOML file, for editors: "#:schema robot.schema.json" in its first line."""
    from vdfmu.base.errors import UsageError
    from vdfmu.system.scenario import schema

    known = {
        "robot": schema.robot_schema,
        "scenario": lambda: schema.scenario_schema(system),
        "system": schema.system_schema,
    }
    if kind not in known:
        raise UsageError(f"schema: expected {', '.join(known)}, got {kind!r}.")
    say_json(known[kind]())
