"""``vdfmu linear``."""

from __future__ import annotations

import math
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Unpack

from vdfmu.base.measure import unit_of
from vdfmu.base.option import Option
from vdfmu.cli.app import RUNS, meets_code
from vdfmu.cli.options import (
    JsonOption,
    OverwriteOption,
    Positional,
    RobotOption,
    known_scenarios,
    load,
    read_numbers,
    refuse,
    target_file,
)
from vdfmu.cli.terminal import console, say, say_error, say_json, say_notes, say_written, table
from vdfmu.study.options import LoopOptions, known_robots

if TYPE_CHECKING:
    from vdfmu.arm.robot import Robot
    from vdfmu.study.analysis.modes import Modes


_MODES, _MARGINS = "Modes", "Margins"


@meets_code(RUNS)
def linear(
    system: Annotated[
        str,
        Positional(
            "Robot, scenario or system package.",
            metavar="[ROBOT|SCENARIO|FILE.ssp]",
            names=lambda: [*known_scenarios(), *known_robots()],
        ),
    ] = "tracking",
    robot: RobotOption = None,
    at: Annotated[
        list[float] | None,
        Option(
            "Time of the run in s. Repeatable.",
            group=_MARGINS,
            more="The default is the times with the smallest margins.",
        ),
    ] = None,
    opened: Annotated[
        list[str] | None,
        Option("Input to open a loop at (default tau). Repeatable.", flag="--loop", group=_MARGINS, metavar="INPUT"),
    ] = None,
    along: Annotated[
        bool, Option("Modes over a scenario's motion, with a picture.", flag="--modes", group=_MODES)
    ] = False,
    pose: Annotated[
        str | None,
        Option(
            "Positions of the joints in rad or m (default 0).",
            metavar="'Q1 Q2 ...'",
            group=_MODES,
            more="If the end stops exclude 0, the default is the middle between them.",
        ),
    ] = None,
    bode: Annotated[
        int | None,
        Option(
            "Draw a joint's frequency response.",
            metavar="JOINT",
            group=_MODES,
            more="It is the response of rotor and link to the motor torque.",
        ),
    ] = None,
    dry: Annotated[
        bool, Option("Include Coulomb and Stribeck friction at rest.", flag="--dry-friction", group=_MODES)
    ] = False,
    out: Annotated[
        Path | None,
        Option("Picture of --modes or --bode.", more="Default: SCENARIO_modes.png or ROBOT_bode.png in this folder."),
    ] = None,
    overwrite: OverwriteOption = False,
    as_json: JsonOption = False,
    **options: Unpack[LoopOptions],
) -> None:
    """Print the modes of a robot at rest, or the margins of a scenario.

    Modes are natural frequencies, damping and shapes, with motors free and held. Margins are the smallest of each loop
    over a run, including the delays of the master. The exit code is 1 if the run is unstable.
    """
    of_robot = {"--pose": pose, "--bode": bode}
    of_picture = {"--dry-friction": dry, "--out": out, "--overwrite": overwrite}
    of_run = {
        "--at": at,
        "--loop": opened,
        "--set": options["parameters"],
        "--backend": options["backend"],
        "--algorithm": options["algorithm"],
        "--adaptive": options["adaptive"],
        "--step": options["step"],
    }
    if _is_robot(system):
        refuse(of_run | {"--robot": robot, "--modes": along}, f"is only for a scenario, but {system} is a robot")
        if bode is None:
            refuse({"--out": out}, "is the picture of --modes or --bode")
        _modes(system, pose, bode, dry, out, overwrite, as_json)
    elif along:
        refuse(of_robot, "is for a robot at a pose")
        refuse(of_run, "is for margins, without --modes")
        _modes_along(system, robot, dry, out, overwrite, as_json)
    else:
        refuse(of_robot, "is for a robot at a pose")
        refuse(of_picture, "needs --modes or a robot")
        _margins(system, robot, at or (), opened or (), as_json, options)


def _is_robot(system: str) -> bool:
    """Return whether a name or a file is a robot."""
    from vdfmu.base.errors import UsageError
    from vdfmu.base.text import nearest
    from vdfmu.base.toml_file import kind_of, read_toml, toml_names

    robots, scenarios, path = toml_names("robots"), [*toml_names("scenarios"), "reach"], Path(system)
    if path.suffix.lower() == ".toml":
        return kind_of(read_toml(path)) == "robot"
    if not path.exists() and system not in (*robots, *scenarios):
        raise UsageError(f"no robot or scenario {system!r}. {nearest(system, [*robots, *scenarios])}")
    return system in robots


def _modes(
    robot: str, pose: str | None, bode: int | None, dry: bool, out: Path | None, overwrite: bool, as_json: bool
) -> None:
    """Print the modes of a robot at a pose, and draw a frequency response."""
    from vdfmu.arm.robot import load_robot
    from vdfmu.base.errors import UsageError
    from vdfmu.study.analysis.modes import MOTORS, middle_pose, natural_modes

    arm = load_robot(robot)
    if bode is not None and not 1 <= bode <= arm.n:
        raise UsageError(f"--bode {bode}: expected a joint, 1 to {arm.n}.")
    target = None if bode is None else target_file(out, f"{arm.name}_bode.png", overwrite)
    q = middle_pose(arm) if pose is None else read_numbers("--pose", pose)
    by_motors = {motors: natural_modes(arm, q, motors=motors, dry=dry) for motors in MOTORS}
    if as_json:
        say_json({"pose": q} | {f"motors_{motors}": _numbers(each) for motors, each in by_motors.items()})
    else:
        for motors, each in by_motors.items():
            _print(motors, q, each)
    if bode is not None and target is not None:
        _draw_bode(arm, q, bode, dry, target, as_json)


def _numbers(modes: Modes) -> dict[str, Any]:
    """Return modes for JSON: Hz, damping ratios, and shapes of the moving sides."""
    return {
        "frequency": modes.frequency.tolist(),
        "damping": modes.damping.tolist(),
        "rates": modes.rates.tolist(),
        "joint": (modes.joint + 1).tolist(),
        "links": modes.links.real.tolist(),
        "rotors": modes.rotors.real.tolist(),
    }


def _print(motors: str, q: list[float], modes: Modes) -> None:
    where = " ".join(f"{number:g}" for number in q)
    heads = ("Hz", "damping", "spring", "", "displacement of joints 1, 2, ...")
    shown = table(*heads, title=f"Motors {motors} at {where}")
    for i, (frequency, damping) in enumerate(zip(modes.frequency, modes.damping, strict=True)):
        joint = modes.joint[i]
        shapes = {"links": modes.links[i]} | ({"rotors": modes.rotors[i]} if motors == "free" else {})
        shown.add_row(
            f"{frequency:.2f}",
            f"{round(damping, 4) + 0.0:.4f}",  # no minus sign before a number that rounds to 0
            f"{joint + 1} ({100.0 * modes.share[i, joint]:.0f} %)",
            "\n".join(shapes),
            "\n".join(" ".join(f"{round(v, 2) + 0.0:5.2f}" for v in shape.real) for shape in shapes.values()),
        )
    console.print(shown)
    if len(modes.rates):
        say("Not oscillating, 1/s: " + " ".join(f"{round(rate, 3) + 0.0:.4g}" for rate in modes.rates))
    console.print()


def _draw_bode(robot: Robot, q: list[float], joint: int, dry: bool, target: Path, as_json: bool) -> None:
    from vdfmu.extras.linear.drawings import draw_bode
    from vdfmu.extras.linear.responses import joint_bode
    from vdfmu.extras.pictures.style import save

    bode = joint_bode(robot, q, joint, dry)
    unit = unit_of("velocity", robot.joint_types[joint - 1])
    where = " ".join(f"{number:g}" for number in q)
    curves: dict[str, Any] = dict(zip(("rotor", "link"), bode.response, strict=True))
    title = f"Motor torque of joint {joint} to velocities: {robot.name} at {where}"
    save(draw_bode(title, bode.frequency, curves, f"({unit})/(N.m)", bode.resonance, bode.antiresonance[0]), target)
    if as_json:
        return
    for label, each in (("resonances", bode.resonance), ("anti-resonances at the motor", bode.antiresonance[0])):
        say(f"Joint {joint}, {label}: {', '.join(f'{frequency:.2f}' for frequency in each) or 'none'} Hz")
    say_written(target)


def _modes_along(path: str, robot: str | None, dry: bool, out: Path | None, overwrite: bool, as_json: bool) -> None:
    """Print and draw the natural frequencies over the motion of a scenario."""
    scenario = load(path, robot)
    target = target_file(out, f"{scenario.name}_modes.png", overwrite)
    from vdfmu.extras.linear.along import modes_along, ranges
    from vdfmu.extras.linear.drawings import draw_modes
    from vdfmu.extras.pictures.style import save
    from vdfmu.study.analysis.modes import MOTORS

    times, along = modes_along(scenario, dry=dry)
    n = scenario.arm.n
    pairs = {motors: [(each.frequency[-n:], each.joint[-n:]) for each in poses] for motors, poses in along.items()}
    save(draw_modes(f"Natural frequencies: {scenario.arm.name}, {scenario.name}", times, pairs), target)
    if as_json:
        say_json({"t": list(times)} | {f"motors_{name}": list(map(_numbers, each)) for name, each in along.items()})
        return
    columns = [
        [f"{pair[0]:.2f} to {pair[1]:.2f}" if pair else "does not oscillate" for pair in ranges(along[motors], n)]
        for motors in MOTORS
    ]
    rows = zip([str(i + 1) for i in range(n)], *columns, strict=True)
    console.print(table("mode", *(f"motors {motors}, Hz" for motors in MOTORS), rows=rows))
    say_written(target, more=f": natural frequencies over the motion, at rest at {len(times)} poses")


def _margins(
    system: str, robot: str | None, at: Sequence[float], opened: Sequence[str], as_json: bool, options: LoopOptions
) -> None:
    """Print the smallest margins of each loop over a run, or those at some times."""
    from vdfmu.study.analysis.loops import margins_along
    from vdfmu.study.limits import OF_SCENARIO, read_limits
    from vdfmu.study.verdict import loop_sentences

    package = system.lower().endswith(".ssp")
    if package:
        refuse({"--robot": robot}, f"is only for a scenario; {system} has its own")
    scenario = None if package else load(system, robot, options["parameters"])
    limits = read_limits({} if scenario is None else scenario.limits, OF_SCENARIO)
    loops = margins_along(system if scenario is None else scenario, opened, at, **options)
    shown = table(
        "opened at",
        "t",
        "modulus",
        "gain",
        "phase",
        "delay",
        "growth",
        title=f"Step {loops.step:g} s, {loops.algorithm}",
    )
    chosen = [(i, k) for i in range(len(loops.names)) for k in (range(len(loops.times)) if at else [loops.least(i)])]
    smallest = min(float(loops.margins[k].modulus[i]) for i, k in chosen)
    rows: list[dict[str, Any]] = []
    for i, k in chosen:
        name, t, each = loops.names[i], loops.times[k], loops.margins[k]
        modulus, gain, phase, delay = (float(column[i]) for column in each[:4])
        rows.append(
            {
                "opened_at": name,
                "t": t,
                "modulus": modulus,
                "gain": gain,
                "phase": phase,
                "delay": delay,
                "rate": each.rate,
            }
        )
        late = f"{delay:.3g} s" if delay >= 1.0 else f"{1e3 * delay:.3g} ms"
        mark = " smallest" if modulus == smallest else ""
        numbers = (f"{modulus:.3f}{mark}", f"{gain:.3g}", f"{math.degrees(phase):.1f} deg", late)
        style = ("bold" if mark else None) if modulus else "red"
        cells = numbers if modulus else ("none", "", "", "")
        shown.add_row(name, f"{t:.4g} s", *cells, f"{each.rate:.3g} 1/s", style=style)
    state, sentences = loop_sentences(loops.judged.figures, limits)
    margin = loops.judged.figures.get("margin")
    words = "; ".join(sentences) or (f"stable with a modulus margin of {margin['value']:.2g}" if margin else "stable")
    if as_json:
        say_json({"step": loops.step, "algorithm": loops.algorithm, "state": state, "text": words, "margins": rows})
    else:
        console.print(shown)
    say_notes(loops.notes)
    if state == "failed":
        say_error(f"{words[:1].upper()}{words[1:]}.")
        raise SystemExit(1)
    if not as_json:
        say(f"{words[:1].upper()}{words[1:]}.")


COMMANDS = {"Analyse": [(linear, "vdfmu linear tracking --algorithm jacobi --at 2.5")]}
"""By group: commands and their examples."""
