"""``vdfmu unit list``, ``show``, ``new`` and ``examples``."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any

from rich.markup import escape

from vdfmu.base.option import Option
from vdfmu.cli.app import RUNS, App, meets_code
from vdfmu.cli.options import JsonOption, Positional
from vdfmu.cli.terminal import console, say, say_json, say_written, table

app = App("unit", no_args_is_help=True, help="List and show units, and write your own.")


@app.command("list", example="vdfmu unit list")
def list_units(as_json: JsonOption = False) -> None:
    """List all units, with the names for systems and --unit."""
    from vdfmu.arm.units import known_units

    units = [(name, _kind(unit)[0] or "system", unit.description()) for name, unit in known_units().items()]
    if as_json:
        say_json({name: {"kind": kind, "description": text} for name, kind, text in units})
    else:
        console.print(table("unit", "kind", "what it is", rows=sorted(units, key=lambda row: row[1])))


@app.command("show", example="vdfmu unit show controller")
@meets_code(RUNS)
def show_unit(name: Annotated[str, Positional("Name of a unit, my_unit.py or my_units.py:Name.")]) -> None:
    """Show the variables of a unit: kind, unit of measurement, meaning."""
    from vdfmu.arm.units import find_unit

    unit_class = find_unit(name)
    console.print(f"[bold]{escape(name)}[/bold]: {escape(unit_class.description())}")
    shown = table("variable", "kind", "unit of measurement", "what it is")
    for variable in unit_class.declared.values():
        unit, text = (each if isinstance(each, str) else ", ".join(each) for each in (variable.unit, variable.text))
        shown.add_row(variable.name, type(variable).__name__.lower(), unit, escape(text))
    console.print(shown)


def _kind(unit: Any) -> tuple[str, ...]:
    """Return the folders of units: "" for those of the shipped systems, the package for those of another package."""
    package, *path = unit.__module__.split(".")
    return tuple(path[2:-1] or ("",)) if package == "vdfmu" else (package,)


@app.command("new", example="vdfmu unit new MyFilter")
def new(
    name: Annotated[str, Positional("Name of the unit, MyFilter or my_filter.")],
    out: Annotated[Path | None, Option("File to write (default my_filter.py).")] = None,
) -> None:
    """Write a template of a unit and its test."""
    from vdfmu.compiler.unit.new import new_unit

    path, test = new_unit(name, out)
    say_written(path, test)
    say(f"Build it with 'vdfmu build {path}', test it with 'python -m pytest {test}'.")


@app.command("examples", example="vdfmu unit examples")
def examples(folder: Annotated[Path, Positional("Folder to write them to.")] = Path("units")) -> None:
    """Write the example units, and a system and scenario that use them."""
    from vdfmu.compiler.unit.new import copy_examples

    say_written(*copy_examples(folder))
    say(f"Run them with 'vdfmu run {folder / 'scenario.toml'}'.")
