"""``vdfmu robot import`` and ``vdfmu robot export``."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

from vdfmu.base.option import Option
from vdfmu.cli.app import LOOKS, meets_code
from vdfmu.cli.options import OverwriteOption, Positional, RobotArgument, TrustOption, target_file
from vdfmu.cli.robots import app, looked_at
from vdfmu.cli.terminal import say_notes, say_written


def _read_tool(text: str) -> list[float]:
    """Return the numbers of --tool; UsageError for a wrong count, as a shell without quotes passes only the first."""
    from vdfmu.cli.options import read_numbers
    from vdfmu.extras.robots.tool import read_placement

    numbers = read_numbers("--tool", text)
    read_placement(numbers)
    return numbers


@app.command("import", example="vdfmu robot import panda.urdf --tip panda_hand -o panda.toml")
def import_file(
    file: Annotated[Path, Positional("URDF, or MuJoCo file (MJCF).")],
    base: Annotated[str | None, Option("Fixed link (default the root).", metavar="LINK")] = None,
    tip: Annotated[str | None, Option("Last link of the arm, if there are several.", metavar="LINK")] = None,
    tool: Annotated[
        list[float] | None,
        Option(
            "Tool in the tip's frame, in m and rad.",
            metavar="'X Y Z [R P Y]'",
            typed=str,
            read=_read_tool,
            more="The default is the tip if it is fixed to a link, else the end of the last link.",
        ),
    ] = None,
    tool_frame: Annotated[str | None, Option("Link or site that is the tool.", metavar="LINK")] = None,
    drives: Annotated[
        Path | None, Option("TOML file with the drive of each joint, by name.", more="Missing values are assumed.")
    ] = None,
    density: Annotated[
        float | None, Option("Density in kg/m3 of bodies without a mass.", more="For boxes, cylinders and spheres.")
    ] = None,
    out: Annotated[Path | None, Option("Robot file to write (default FILE.toml).")] = None,
    overwrite: OverwriteOption = False,
) -> None:
    """Write a robot file from a URDF or a MuJoCo file.

    The file names the source of each number.
    """
    from vdfmu.arm.robot import joint_free
    from vdfmu.base.files import write_whole
    from vdfmu.extras.robots.imported import import_robot

    target = target_file(out, f"{file.stem}.toml", overwrite)
    robot, text, notes = import_robot(file, base, tip, drives, density, tool=tool, tool_frame=tool_frame, out=target)
    write_whole(target, [text.encode()])
    say_notes(notes)
    assumed = [joint_free(key) for key, source in robot.sources.items() if source.startswith("Assumed")]
    if assumed:
        names = ", ".join(key.removeprefix("joints.") for key in dict.fromkeys(assumed))
        say_notes([f"assumed: {names}. Give known values by --drives."])
    say_written(target, more=f", {robot.n} joint{'s' * (robot.n > 1)}")


@app.command("export", example="vdfmu robot export ur5e_6dof --to mjcf")
@meets_code(LOOKS)
def export_file(
    robot: RobotArgument,
    to: Annotated[
        str | None, Option("Format (default by the suffix of -o, else mjcf).", choices=("mjcf", "urdf"))
    ] = None,
    out: Annotated[Path | None, Option("File to write (default ROBOT.xml or ROBOT.urdf).")] = None,
    rigid: Annotated[bool, Option("MJCF without springs; rotors are armature.")] = False,
    overwrite: OverwriteOption = False,
    trust: TrustOption = False,
) -> None:
    """Write a robot as MJCF or URDF.

    Notes list the numbers that the file cannot represent.
    """
    from vdfmu.base.toml_file import locate
    from vdfmu.extras.robots.export import export_robot

    suffix = ".urdf" if to == "urdf" else ".xml"
    target = target_file(out, f"{locate(robot, 'robots').stem}{suffix}", overwrite)
    arm = looked_at(robot, "springs and friction are those of an arm without it")
    notes = export_robot(arm, target, to, rigid=rigid)
    say_notes([f"not in {target.name}: {note}" for note in notes])
    say_written(target)
