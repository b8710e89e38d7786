"""``vdfmu modes``."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from vdfmu.cli.robots import OverwriteOption, target_file
from vdfmu.cli.terminal import console, load, say

if TYPE_CHECKING:
    from vdfmu.arm.robot import Robot
    from vdfmu.study.analysis.modes import Modes


def modes(
    robot: Annotated[str, typer.Argument(help="Name of a shipped robot, or path of a robot file.")],
    pose: Annotated[
        str | None,
        typer.Option(
            metavar="'Q1 Q2 ...'",
            help="Positions of the joints in rad or m; default 0, or the middle between end stops that exclude 0.",
        ),
    ] = None,
    path: Annotated[
        str | None,
        typer.Option(
            metavar="SCENARIO", help="Over the desired motion of a scenario, instead of one pose, with a picture."
        ),
    ] = None,
    bode: Annotated[
        int | None,
        typer.Option(metavar="JOINT", help="Draw the response of a joint's rotor and link to its motor torque, too."),
    ] = None,
    dry: Annotated[
        bool, typer.Option("--dry-friction", help="Keep Coulomb and Stribeck friction, with its slope at rest.")
    ] = False,
    out: Annotated[
        Path | None,
        typer.Option("--out", "-o", help="Picture of --path or --bode; default SCENARIO_modes.png or ROBOT_bode.png."),
    ] = None,
    overwrite: OverwriteOption = False,
) -> None:
    """Print natural frequencies, damping and shapes of the modes of an arm at rest, with motors free and held."""
    from vdfmu.base.errors import UsageError

    if path is not None:
        if pose is not None or bode is not None:
            raise UsageError("modes: expected --pose or --path, got both." if pose is not None else
                             "modes: --bode is for one pose, not for --path.")  # fmt: skip
        _over_path(robot, path, dry, out, overwrite)
        return
    if out is not None and bode is None:
        raise UsageError("modes: --out is for the picture of --path SCENARIO or --bode JOINT; neither is given.")
    from vdfmu.arm.robot import load_robot
    from vdfmu.study.analysis.modes import MOTORS, natural_modes

    arm = load_robot(robot)
    if bode is not None and not 1 <= bode <= arm.n:
        raise UsageError(f"--bode {bode}: expected a joint, 1 to {arm.n}.")
    target = None if bode is None else target_file(out, f"{arm.name}_bode.png", overwrite)
    q = _pose(arm, pose)
    for motors in MOTORS:
        _print(motors, q, natural_modes(arm, q, motors=motors, dry=dry))
    if bode is not None and target is not None:
        _draw_bode(arm, q, bode, dry, target)


def _pose(robot: Robot, text: str | None) -> list[float]:
    if text is None:
        from vdfmu.study.analysis.modes import middle_pose

        return middle_pose(robot)
    return read_pose("--pose", text)


def read_pose(option: str, text: str) -> list[float]:
    """Return the numbers of an option; UsageError for other words."""
    from vdfmu.base.errors import UsageError

    try:
        return [float(number) for number in text.replace(",", " ").split()]
    except ValueError:
        raise UsageError(f"{option} {text}: expected numbers, such as '0.3 -0.5'.") from None


def _print(motors: str, q: list[float], found: Modes) -> None:
    from rich.table import Table

    where = " ".join(f"{number:g}" for number in q)
    table = Table("Hz", "damping", "spring", "", "displacement of joints 1, 2, ...", box=None)
    table.title, table.title_justify = f"Motors {motors}, at {where}", "left"
    for i, (frequency, damping) in enumerate(zip(found.frequency, found.damping, strict=True)):
        joint = found.joint[i]
        shapes = {"links": found.links[i]} | ({"rotors": found.rotors[i]} if motors == "free" else {})
        table.add_row(
            f"{frequency:.2f}",
            f"{round(damping, 4) + 0.0:.4f}",  # no minus before what rounds to 0
            f"{joint + 1} ({100.0 * found.share[i, joint]:.0f} %)",
            "\n".join(shapes),
            "\n".join(" ".join(f"{round(v, 2) + 0.0:5.2f}" for v in shape.real) for shape in shapes.values()),
        )
    console.print(table)
    if len(found.rates):
        say("Not oscillating, 1/s: " + " ".join(f"{round(rate, 3) + 0.0:.4g}" for rate in found.rates))
    console.print()


def _draw_bode(robot: Robot, q: list[float], joint: int, dry: bool, target: Path) -> None:
    from vdfmu.base.style import save
    from vdfmu.study.analysis.arm_space import linearize
    from vdfmu.study.analysis.bode import joint_bode
    from vdfmu.study.report.drawings import draw_bode

    system = linearize(robot, q, dry=dry)
    found = joint_bode(system, joint)
    unit = system.output_units[system.outputs.index(f"q_dot[{joint}]")]
    where = " ".join(f"{number:g}" for number in q)
    curves: dict[str, Any] = dict(zip(("rotor", "link"), found.response, strict=True))
    title = f"Motor torque of joint {joint} to velocities: {robot.name} at {where}"
    save(draw_bode(title, found.frequency, curves, f"({unit})/(N.m)", found.resonance, found.antiresonance[0]), target)
    for what, each in (("resonances", found.resonance), ("anti-resonances at the motor", found.antiresonance[0])):
        say(f"Joint {joint}, {what}: {', '.join(f'{one:.2f}' for one in each) or 'none'} Hz")
    say(f"{target}: rotor and link, by the motor torque")


def _over_path(robot: str, path: str, dry: bool, out: Path | None, overwrite: bool) -> None:
    from rich.table import Table

    scenario = load(path, robot)
    target = target_file(out, f"{scenario.name}_modes.png", overwrite)
    from vdfmu.base.style import save
    from vdfmu.study.analysis.modes import MOTORS, modes_along, ranges
    from vdfmu.study.report.drawings import draw_modes

    times, along = modes_along(scenario, dry=dry)
    n = scenario.arm.n
    table = Table("mode", *(f"motors {motors}, Hz" for motors in MOTORS), box=None)
    columns = [
        [f"{pair[0]:.2f} to {pair[1]:.2f}" if pair else "does not oscillate" for pair in ranges(along[motors], n)]
        for motors in MOTORS
    ]  # fmt: skip
    for i, cells in enumerate(zip(*columns, strict=True)):
        table.add_row(str(i + 1), *cells)
    console.print(table)
    pairs = {motors: [(each.frequency[-n:], each.joint[-n:]) for each in found] for motors, found in along.items()}
    save(draw_modes(f"Natural frequencies: {scenario.arm.name}, {scenario.name}", times, pairs), target)
    say(f"{target}: natural frequencies over the motion, at rest at {len(times)} poses")
