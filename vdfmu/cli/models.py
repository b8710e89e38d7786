"""``vdfmu models list`` and ``show``."""

from __future__ import annotations

from typing import Annotated, Any

import typer
from rich.markup import escape
from rich.table import Table

from vdfmu.cli.terminal import console
from vdfmu.model import load_robot, load_scenario, robot_names, scenario_names

app = typer.Typer(no_args_is_help=True, help="List and show robots and scenarios.")


@app.command("list", epilog="Example: [bold]vdfmu models list[/bold]")
def list_models() -> None:
    """List the robots and scenarios that travel with the package."""
    for title, names, load in (
        ("Robots", robot_names(), load_robot),
        ("Scenarios", scenario_names(), load_scenario),
    ):
        table = Table(title=title, title_justify="left", show_header=False, box=None)
        for name in names:
            table.add_row(name, load(name).description)
        console.print(table)


@app.command("show", epilog="Example: [bold]vdfmu models show manipulator_6dof[/bold]")
def show_model(
    name: Annotated[str, typer.Argument(help="Name of a robot or scenario, or path of a robot's TOML file.")],
) -> None:
    """Show a robot's parameters with their sources, or a scenario's file."""
    from vdfmu.data import data_path

    if name in scenario_names():
        console.print(
            (data_path("models") / "scenarios" / f"{name}.toml").read_text(encoding="utf-8"), markup=False
        )
        return
    robot = load_robot(name)
    console.print(f"[bold]{escape(robot.name)}[/bold]: {escape(robot.description)}")
    table = Table(show_edge=False)
    for heading in ("parameter", *(f"joint {i + 1}" for i in range(robot.n)), "source"):
        table.add_column(heading)
    table.add_row("type", *robot.joint_types, "")
    for section, keys in _SHOWN.items():
        for key in keys:
            cells = [_number(getattr(robot, key)[i]) for i in range(robot.n)]
            table.add_row(key, *cells, escape(robot.source_of(f"joints[1].{section}{key}") or ""))
    console.print(table)


_SHOWN = {
    "": ("offset",),
    "link.": ("mass", "centroid", "inertia"),
    "drive.": ("ell", "I_m", "K_f0", "c_f", "K_w0", "c_w", "theta_err_amplitude", "theta_err_phase"),
    "friction.": ("f_c", "f_s", "f_v", "v_s", "f_ck", "eps"),
}


def _number(value: Any) -> str:
    if getattr(value, "ndim", 0) == 2:
        diagonal = [value[k, k] for k in range(3)]
        return _number(diagonal[0]) if len(set(diagonal)) == 1 else " ".join(_number(v) for v in diagonal)
    return " ".join(_number(v) for v in value) if getattr(value, "ndim", 0) == 1 else f"{value:g}"
