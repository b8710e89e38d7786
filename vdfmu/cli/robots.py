"""``vdfmu robot list`` and ``show``."""

from __future__ import annotations

from itertools import groupby
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

from rich.markup import escape

from vdfmu.base.extras import module_of_extra
from vdfmu.base.files import replacing_foreign
from vdfmu.base.option import Option
from vdfmu.base.trust import CodeNotRunError
from vdfmu.cli.app import LOOKS, App, meets_code
from vdfmu.cli.options import ForeignOption, JsonOption, OpenOption, RobotArgument, TrustOption, refuse
from vdfmu.cli.terminal import console, say_list, say_notes, say_page, say_written, table

if TYPE_CHECKING:
    from vdfmu.arm.robot import Robot

app = App("robot", no_args_is_help=True, help="List and show robots, and write their first scenario.")


@app.command("list", example="vdfmu robot list")
def list_robots(as_json: JsonOption = False) -> None:
    """List the robots that are shipped with vdfmu."""
    from vdfmu.arm.robot import load_robot, robot_names

    say_list("robot", {name: load_robot(name).description for name in robot_names()}, as_json)


@app.command("show", example="vdfmu robot show panda_7dof --page -o panda.html")
@meets_code(LOOKS)
def show_robot(
    name: RobotArgument,
    page: Annotated[
        bool,
        Option(
            "Write a page with sliders of the joints.",
            more="It shows the end effector, frames, masses and modes in a browser, without a network.",
        ),
    ] = False,
    pose: Annotated[str | None, Option("Start pose of the page, rad or m (default 0).", metavar="'Q1 Q2 ...'")] = None,
    out: Annotated[Path | None, Option("Page to write (default NAME.html).")] = None,
    opened: OpenOption = False,
    overwrite: ForeignOption = False,
    trust: TrustOption = False,
) -> None:
    """Show the parameters of a robot, or write its page.

    Each parameter is shown with its source.
    """
    robot = looked_at(name, "the page shows the arm without it" if page else "its tables are not shown")
    if page:
        from vdfmu.base.toml_file import locate
        from vdfmu.cli.options import read_numbers

        write_robot_page = module_of_extra("robot_page", "robots", "--page").write_robot_page
        target, start = out or Path(f"{robot.name}.html"), None if pose is None else read_numbers("--pose", pose)
        with replacing_foreign(overwrite):
            say_notes(write_robot_page(robot, target, pose=start, folder=locate(name, "robots").parent))
        say_written(target)
        say_page(target, opened)
    else:
        refuse({"--pose": pose, "-o": out, "--open": opened, "--overwrite": overwrite}, "goes with --page")
        _show_parameters(robot)


def _show_parameters(robot: Robot) -> None:
    """Print the parameters of a robot, with their sources."""
    import numpy as np

    from vdfmu.arm.robot.parameters import OPTIONAL, section

    console.print(f"[bold]{escape(robot.name)}[/bold]: {escape(robot.description)}")
    for row in section("robot"):
        source, array = robot.source_of(row.path), getattr(robot, row.name)
        if source or row.default is None or (array != np.full(row.shape, row.default)).any():
            number = " ".join(filter(None, (row.name, _number(array), row.unit())))
            console.print(f"{number}: {source or 'no source'}", markup=False)
    console.print(f"friction {robot.friction}, rotor_coupling {str(robot.rotor_coupling).lower()}")
    if robot.payload:
        load = [f"{row.name} {_number(getattr(robot, row.name))} {row.unit()}".rstrip() for row in section("payload")]
        console.print(", ".join(load))
    per_joint = [row for row in robot.rows.values() if row.per_joint and row.fold != "always"]
    for part, group in groupby(per_joint, lambda row: row.section):
        if part in OPTIONAL and not getattr(robot, part):
            continue
        rows = list(group)
        units = [" or ".join(dict.fromkeys(map(row.unit, robot.joint_types))) for row in rows]
        shown = table(
            "joint",
            *(f"{row.name}\n{unit}" for row, unit in zip(rows, units, strict=True)),
            title=f"\n{part.capitalize()}",
        )
        for i, kind in enumerate(robot.joint_types):
            shown.add_row(f"{robot.joint_labels[i]} {kind}", *(_number(getattr(robot, row.name)[i]) for row in rows))
        console.print(shown)
        sources: dict[str, list[str]] = {}
        for row in rows:
            source = robot.source_of(row.path.replace("joints", "joints[1]")) or "no source"
            sources.setdefault(source, []).append(row.name)
        for source, names in sources.items():
            console.print(f"{', '.join(names)}: {source}", markup=False)


def looked_at(name: str, missing: str) -> Robot:
    """Return a robot. Its own drive is omitted if its code may not run, with a note on what is missing."""
    from vdfmu.arm.robot import load_robot

    try:
        return load_robot(name)
    except CodeNotRunError as error:
        robot = load_robot(name, own_drive=False)
        say_notes([f"drive {error.code} was not run, so {missing}; --trust runs it."])
        return robot


def _number(value: Any) -> str:
    if getattr(value, "ndim", 0) == 2:
        diagonal = [value[k, k] for k in range(3)]
        return _number(diagonal[0]) if len(set(diagonal)) == 1 else " ".join(_number(v) for v in diagonal)
    return " ".join(_number(v) for v in value) if getattr(value, "ndim", 0) == 1 else f"{value:g}"
