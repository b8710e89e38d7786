"""``vdfmu unit list``, ``new``, ``from`` and ``examples``."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any

import typer

from vdfmu.cli.app import App
from vdfmu.cli.terminal import console, say

app = App(name="unit", no_args_is_help=True, help="List units, and write your own.")


@app.callback()
def _group() -> None:
    """List units, and write your own."""


@app.command("list", epilog="Example: [bold]vdfmu unit list[/bold]")
def list_units() -> None:
    """List all units, by the name that systems and ``--unit`` take."""
    from rich.table import Table

    from vdfmu.arm.units import known_units

    table = Table("unit", "kind", "what it is", box=None)
    for name, unit in sorted(known_units().items(), key=lambda item: _kind(item[1])):
        table.add_row(name, _kind(unit)[0] or "system", unit.description())
    console.print(table)


def _kind(unit: Any) -> tuple[str, ...]:
    """Return the folders of a unit: "" for one of the shipped systems, the package for one of another package."""
    package, *path = unit.__module__.split(".")
    return tuple(path[2:-1] or ("",)) if package == "vdfmu" else (package,)


@app.command("new", epilog="Example: [bold]vdfmu unit new MyFilter[/bold]")
def new(
    name: Annotated[str, typer.Argument(help="Name of the unit, MyFilter or my_filter.")],
    out: Annotated[Path | None, typer.Option(help="File to write; default my_filter.py.")] = None,
) -> None:
    """Write a first file of a unit, which builds, and a test beside it, which passes."""
    from vdfmu.compiler.unit.new import new_unit

    path, test = new_unit(name, out)
    say(f"{path}: build it with 'vdfmu build {path}'")
    say(f"{test}: run it with 'python -m pytest {test}'")


@app.command("from", epilog="Example: [bold]vdfmu unit from design.py:plant --name Plant[/bold]")
def from_(
    source: Annotated[
        str,
        typer.Argument(
            help="model.mat or model.npz with A, B, C, D; function.casadi; table.csv; or design.py:NAME, an object: a "
            "system of python-control or scipy.signal, or a CasADi function."
        ),
    ],
    name: Annotated[str | None, typer.Option(help="Name of the unit; default that of the source.")] = None,
    out: Annotated[Path | None, typer.Option(help="File to write; default after the name.")] = None,
) -> None:
    """Write the file of a unit of what is there: a linear system, a CasADi function, a table of data."""
    from vdfmu.compiler.unit.wrap import unit_from

    path, *beside = unit_from(source, name, out)
    for file in beside:
        say(str(file))
    say(f"{path}: build it with 'vdfmu build {path}'")


@app.command("examples", epilog="Example: [bold]vdfmu unit examples[/bold]")
def examples(folder: Annotated[Path, typer.Argument(help="Folder to write them to.")] = Path("units")) -> None:
    """Write the example units, with a system and a scenario of them."""
    from vdfmu.compiler.unit.new import copy_examples

    for file in copy_examples(folder):
        say(f"{file}: run it with 'vdfmu run {file}'" if file.name == "scenario.toml" else str(file))
