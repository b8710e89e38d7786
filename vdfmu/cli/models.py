"""``vdfmu models list`` and ``show``."""

from __future__ import annotations

from typing import Annotated, Any

import typer
from rich.markup import escape
from rich.table import Table

from vdfmu.cli.terminal import console, say

app = typer.Typer(no_args_is_help=True, help="List and show robots and scenarios.")


@app.command("list", epilog="Example: [bold]vdfmu models list[/bold]")
def list_models() -> None:
    """List the robots and scenarios that travel with the package."""
    from vdfmu.model import load_robot, load_scenario, robot_names, scenario_names

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
    from vdfmu.model import load_robot, scenario_names
    from vdfmu.model.robot import LIMIT_KEYS

    if name in scenario_names():
        say((data_path("models") / "scenarios" / f"{name}.toml").read_text(encoding="utf-8"))
        return
    robot = load_robot(name)
    console.print(f"[bold]{escape(robot.name)}[/bold]: {escape(robot.description)}")
    for name in ("gravity", "tool_offset"):
        console.print(
            f"{name} {_number(getattr(robot, name))}: {robot.source_of(name) or 'no source'}", markup=False
        )
    console.print(f"friction {robot.friction}, rotor_coupling {str(robot.rotor_coupling).lower()}")
    if robot.payload:
        load = ("payload_mass", "payload_centroid", "payload_inertia")
        console.print(", ".join(f"{name} {_number(getattr(robot, name))}" for name in load))
    shown = _SHOWN | ({"Limits": tuple(f"limits.{key}" for key in LIMIT_KEYS)} if robot.limits else {})
    for title, keys in shown.items():
        names = [key.rpartition(".")[2] for key in keys]
        table = Table(title=title, title_justify="left", show_edge=False)
        for heading in ("joint", *names):
            table.add_column(heading, overflow="fold")
        for i, kind in enumerate(robot.joint_types):
            table.add_row(f"{i + 1} {kind}", *(_number(getattr(robot, name)[i]) for name in names))
        console.print()
        console.print(table)
        sources: dict[str, list[str]] = {}
        for key, name in zip(keys, names, strict=True):
            sources.setdefault(robot.source_of(f"joints[1].{key}") or "no source", []).append(name)
        for source, those in sources.items():
            console.print(f"{', '.join(those)}: {source}", markup=False)


_SHOWN = {
    "Links": ("offset", "link.mass", "link.centroid", "link.inertia"),
    "Drives": ("drive.ell", "drive.I_m", "drive.K_f0", "drive.c_f", "drive.K_w0", "drive.c_w"),
    "Kinematic error": ("drive.theta_err_amplitude", "drive.theta_err_phase"),
    "Friction": (
        "friction.f_c", "friction.f_s", "friction.f_v", "friction.v_s", "friction.f_ck", "friction.eps",
    ),
}  # fmt: skip
"""Title of a table to its columns: keys of the robot file."""


def _number(value: Any) -> str:
    if getattr(value, "ndim", 0) == 2:
        diagonal = [value[k, k] for k in range(3)]
        return _number(diagonal[0]) if len(set(diagonal)) == 1 else " ".join(_number(v) for v in diagonal)
    return " ".join(_number(v) for v in value) if getattr(value, "ndim", 0) == 1 else f"{value:g}"
