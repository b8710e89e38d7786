"""``vdfmu robot import``, ``export``, ``reach`` and ``drives``."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Annotated

from vdfmu.base.option import Option
from vdfmu.cli.app import LOOKS, RUNS, meets_code
from vdfmu.cli.options import JsonOption, OverwriteOption, Positional, RobotArgument, TrustOption, target_file
from vdfmu.cli.robots import app, looked_at
from vdfmu.cli.terminal import console, say_json, say_notes, say_written, table


def _read_tool(text: str) -> list[float]:
    """Return the numbers of --tool; UsageError for a wrong count: without quotes, only the first arrives."""
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
    rigid: Annotated[bool, Option("MJCF without springs; rotor inertia as armature.")] = False,
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


@app.command("reach", example="vdfmu robot reach ./panda.toml -o reach.toml")
@meets_code(RUNS)
def reach(
    robot: RobotArgument,
    out: Annotated[Path | None, Option("Scenario to write (default ROBOT_reach.toml).")] = None,
    overwrite: OverwriteOption = False,
) -> None:
    """Write the scenario of a first motion, with gains.

    The gains follow from a rule, and the margins of the loops are printed.
    """
    from vdfmu.arm.robot import load_robot
    from vdfmu.base.toml_file import locate
    from vdfmu.extras.robots.reach_file import write_reach
    from vdfmu.system.scenario import load_scenario

    target = target_file(out, f"{locate(robot, 'robots').stem}_reach.toml", overwrite)
    written = write_reach(robot, target)
    step = load_scenario(target).step
    shown = table("joint", "K_p", "K_v", "modulus margin", "gain margin", "phase margin deg", "delay margin samples")
    labels = load_robot(robot).joint_labels
    for i, (K_p, K_v) in enumerate(zip(written.gains.K_p, written.gains.K_v, strict=True)):
        numbers = ()
        if written.margins is not None:
            modulus, gain, phase, delay = (float(margin[i]) for margin in written.margins[:4])
            numbers = f"{modulus:.2f}", f"{gain:.2f}", f"{math.degrees(phase):.0f}", f"{delay / step:.2f}"
        shown.add_row(labels[i], f"{K_p:.4g}", f"{K_v:.4g}", *numbers)
    console.print(shown)
    say_notes(written.notes)
    say_written(
        target,
        more=f", with a step of {1e3 * step:g} ms. Run it with 'vdfmu run {target}'; margins are the smallest along it",
    )


@app.command("drives", example="vdfmu robot drives CSG-25-100")
def list_drives(
    name: Annotated[str | None, Positional("Gear or motor to show, with all numbers.")] = None,
    as_json: JsonOption = False,
) -> None:
    """List the gears and motors that a robot file can name."""
    from vdfmu.arm.robot.catalogue import catalogue, spring_residual
    from vdfmu.base.errors import UsageError
    from vdfmu.base.text import nearest

    gears, motors, texts = (catalogue()[key] for key in ("gears", "motors", "sources"))
    if name is not None:
        entry = gears.get(name) or motors.get(name)
        if entry is None:
            raise UsageError(f"no gear or motor {name!r}. {nearest(name, [*gears, *motors])}")
        of_gear = entry.get("sources", {entry.get("source"): ["all numbers"]})
        for key, value in entry.items():
            if key not in ("sources", "source"):
                tables = ", ".join(f"{k} {v:g}" for k, v in value.items()) if isinstance(value, dict) else f"{value:g}"
                console.print(f"{key} {tables}", markup=False, soft_wrap=True)
        for source, keys in of_gear.items():
            console.print(f"{', '.join(keys)}: {texts[source]}", markup=False, soft_wrap=True)
        return
    if as_json:
        return say_json({"gears": gears, "motors": motors})
    shown = table("gear", "rated\nN.m", "repeated\nN.m", "K1\nN.m/rad", "K3\nN.m/rad", "fit off by")
    for key, gear in gears.items():
        residual, share = spring_residual(gear)
        numbers = (f"{gear[number]:g}" for number in ("rated", "repeated", "K1", "K3"))
        shown.add_row(key, *numbers, f"{math.degrees(residual) * 60.0:.2f} arcmin, {share:.1%}")
    console.print(shown)
    rows = ((key, f"{motor['inertia']:g}", "yes" if "winding" in motor else "no") for key, motor in motors.items())
    console.print(table("motor", "inertia\nkg.m2", "winding", title=" ", rows=rows))
