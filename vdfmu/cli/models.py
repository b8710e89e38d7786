"""``vdfmu models list``, ``show`` and ``schema``."""

from __future__ import annotations

from itertools import groupby
from typing import Annotated, Any

import typer
from rich.markup import escape

from vdfmu.cli.app import App
from vdfmu.cli.terminal import console, say

app = App(name="models", no_args_is_help=True, help="List and show robots and scenarios.")


@app.command("list", epilog="Example: [bold]vdfmu models list[/bold]")
def list_models() -> None:
    """List the robots and scenarios that travel with the package."""
    from rich.table import Table

    from vdfmu.arm.robot import load_robot, robot_names
    from vdfmu.system.scenario import load_scenario, scenario_names

    for title, names, load in (("Robots", robot_names(), load_robot), ("Scenarios", scenario_names(), load_scenario)):
        table = Table(title=title, title_justify="left", show_header=False, box=None)
        for name in names:
            table.add_row(name, load(name).description)
        console.print(table)


@app.command("show", epilog="Example: [bold]vdfmu models show manipulator_6dof[/bold]")
def show_model(
    name: Annotated[str, typer.Argument(help="Name of a robot or scenario, or path of a robot's TOML file.")],
) -> None:
    """Show a robot's parameters with their sources, or a scenario's file."""
    import numpy as np

    from vdfmu.arm.robot import load_robot
    from vdfmu.arm.robot.parameters import OPTIONAL, PARAMETERS, section
    from vdfmu.base.data import data_path
    from vdfmu.system.scenario import scenario_names

    if name in scenario_names():
        say((data_path("models") / "scenarios" / f"{name}.toml").read_text(encoding="utf-8"))
        return
    from rich.table import Table

    robot = load_robot(name)
    console.print(f"[bold]{escape(robot.name)}[/bold]: {escape(robot.description)}")
    for row in section("robot"):
        source, array = robot.source_of(row.path), getattr(robot, row.name)
        if source or row.default is None or (array != np.full(row.shape, row.default)).any():
            console.print(f"{row.name} {_number(array)}: {source or 'no source'}", markup=False)
    console.print(f"friction {robot.friction}, rotor_coupling {str(robot.rotor_coupling).lower()}")
    if robot.payload:
        load = [f"{row.name} {_number(getattr(robot, row.name))}" for row in section("payload")]
        console.print(", ".join(load))
    shown = [row for row in PARAMETERS.values() if row.per_joint and row.fold != "always"]
    for part, group in groupby(shown, lambda row: row.section):
        if part in OPTIONAL and not getattr(robot, part):
            continue
        rows = list(group)
        table = Table(title=part.capitalize(), title_justify="left", show_edge=False)
        for heading in ("joint", *(row.name for row in rows)):
            table.add_column(heading, overflow="fold")
        for i, kind in enumerate(robot.joint_types):
            table.add_row(f"{robot.joint_labels[i]} {kind}", *(_number(getattr(robot, row.name)[i]) for row in rows))
        console.print()
        console.print(table)
        sources: dict[str, list[str]] = {}
        for row in rows:
            source = robot.source_of(row.path.replace("joints", "joints[1]")) or "no source"
            sources.setdefault(source, []).append(row.name)
        for source, those in sources.items():
            console.print(f"{', '.join(those)}: {source}", markup=False)


@app.command("schema", epilog="Example: [bold]vdfmu models schema robot > robot.schema.json[/bold]")
def show_schema(
    kind: Annotated[str, typer.Argument(help="robot, scenario or system.")],
    system: Annotated[str, typer.Option(help="Whose components the sections of a scenario are for.")] = "system",
) -> None:
    """Print the JSON schema of a TOML file, for editors: "#:schema robot.schema.json" in its first line."""
    import json

    from vdfmu.base.errors import UsageError
    from vdfmu.system.scenario import schema

    known = {
        "robot": schema.robot_schema,
        "scenario": lambda: schema.scenario_schema(system),
        "system": schema.system_schema,
    }
    if kind not in known:
        raise UsageError(f"schema: expected {', '.join(known)}, got {kind!r}.")
    say(json.dumps(known[kind](), indent=1))


def _number(value: Any) -> str:
    if getattr(value, "ndim", 0) == 2:
        diagonal = [value[k, k] for k in range(3)]
        return _number(diagonal[0]) if len(set(diagonal)) == 1 else " ".join(_number(v) for v in diagonal)
    return " ".join(_number(v) for v in value) if getattr(value, "ndim", 0) == 1 else f"{value:g}"
