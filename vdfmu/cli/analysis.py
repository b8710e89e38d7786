"""``vdfmu modes``, ``vdfmu margins`` and ``vdfmu motion``."""

from __future__ import annotations

import math
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Unpack

from vdfmu.base.option import Option
from vdfmu.cli.parameters import Positional
from vdfmu.cli.terminal import (
    JsonOption,
    OverwriteOption,
    RobotArgument,
    RobotOption,
    console,
    known_scenarios,
    load,
    say,
    say_error,
    say_json,
    say_notes,
    say_written,
    table,
    target_file,
)
from vdfmu.engine.options import master_option, settings_option
from vdfmu.study.options import LoopOptions

if TYPE_CHECKING:
    from vdfmu.arm.robot import Robot
    from vdfmu.study.analysis.modes import Modes


def modes(
    robot: RobotArgument,
    pose: Annotated[str | None, Option("Positions of the joints in rad or m (default 0).", metavar="'Q1 Q2 ...'",
        more="If end stops exclude 0, the middle between them.")] = None,
    scenario: Annotated[str | None, Option("Modes over its motion, with a picture.", metavar="SCENARIO",
        names=known_scenarios)] = None,
    bode: Annotated[int | None, Option("Draw the frequency response of a joint.", metavar="JOINT",
        more="Its rotor and link answer to its motor torque.")] = None,
    dry: Annotated[bool, Option("Keep Coulomb and Stribeck friction, at rest.", flag="--dry-friction")] = False,
    out: Annotated[Path | None, Option("Picture of --scenario or --bode.",
        more="Default: SCENARIO_modes.png or ROBOT_bode.png in this folder.")] = None,
    overwrite: OverwriteOption = False,
    as_json: JsonOption = False,
) -> None:  # fmt: skip
    """Print the modes of an arm at rest. Natural frequencies, damping and shapes, with motors free and held."""
    from vdfmu.base.errors import UsageError

    if scenario is not None:
        if pose is not None or bode is not None:
            raise UsageError("modes: expected --pose or --scenario, got both." if pose is not None else
                             "modes: --bode is for one pose, not for --scenario.")  # fmt: skip
        _over_path(robot, scenario, dry, out, overwrite, as_json)
        return
    if out is not None and bode is None:
        raise UsageError("modes: --out is for the picture of --scenario SCENARIO or --bode JOINT; neither is given.")
    from vdfmu.arm.robot import load_robot
    from vdfmu.study.analysis.modes import MOTORS, middle_pose, natural_modes

    arm = load_robot(robot)
    if bode is not None and not 1 <= bode <= arm.n:
        raise UsageError(f"--bode {bode}: expected a joint, 1 to {arm.n}.")
    target = None if bode is None else target_file(out, f"{arm.name}_bode.png", overwrite)
    q = middle_pose(arm) if pose is None else read_pose("--pose", pose)
    by_motors = {motors: natural_modes(arm, q, motors=motors, dry=dry) for motors in MOTORS}
    if as_json:
        say_json({"pose": q} | {f"motors_{motors}": _numbers(each) for motors, each in by_motors.items()})
    else:
        for motors, each in by_motors.items():
            _print(motors, q, each)
    if bode is not None and target is not None:
        _draw_bode(arm, q, bode, dry, target, as_json)


def read_pose(option: str, text: str) -> list[float]:
    """Return the numbers of an option; UsageError for other words."""
    from vdfmu.base.errors import UsageError

    try:
        return [float(number) for number in text.replace(",", " ").split()]
    except ValueError:
        raise UsageError(f"{option} {text}: expected numbers, such as '0.3 -0.5'.") from None


def _numbers(modes: Modes) -> dict[str, Any]:
    """Return modes for JSON: Hz, damping ratio, shapes of the sides that move."""
    return {
        "frequency": modes.frequency.tolist(), "damping": modes.damping.tolist(), "rates": modes.rates.tolist(),
        "joint": (modes.joint + 1).tolist(), "links": modes.links.real.tolist(), "rotors": modes.rotors.real.tolist(),
    }  # fmt: skip


def _print(motors: str, q: list[float], modes: Modes) -> None:
    where = " ".join(f"{number:g}" for number in q)
    heads = ("Hz", "damping", "spring", "", "displacement of joints 1, 2, ...")
    shown = table(*heads, title=f"Motors {motors} at {where}")
    for i, (frequency, damping) in enumerate(zip(modes.frequency, modes.damping, strict=True)):
        joint = modes.joint[i]
        shapes = {"links": modes.links[i]} | ({"rotors": modes.rotors[i]} if motors == "free" else {})
        shown.add_row(
            f"{frequency:.2f}",
            f"{round(damping, 4) + 0.0:.4f}",  # no minus before what rounds to 0
            f"{joint + 1} ({100.0 * modes.share[i, joint]:.0f} %)",
            "\n".join(shapes),
            "\n".join(" ".join(f"{round(v, 2) + 0.0:5.2f}" for v in shape.real) for shape in shapes.values()),
        )
    console.print(shown)
    if len(modes.rates):
        say("Not oscillating, 1/s: " + " ".join(f"{round(rate, 3) + 0.0:.4g}" for rate in modes.rates))
    console.print()


def _draw_bode(robot: Robot, q: list[float], joint: int, dry: bool, target: Path, as_json: bool) -> None:
    from vdfmu.base.style import save
    from vdfmu.study.analysis.bode import joint_bode
    from vdfmu.study.report.drawings import draw_bode

    bode = joint_bode(robot, q, joint, dry)
    unit = "m/s" if robot.joint_types[joint - 1] == "prismatic" else "rad/s"
    where = " ".join(f"{number:g}" for number in q)
    curves: dict[str, Any] = dict(zip(("rotor", "link"), bode.response, strict=True))
    title = f"Motor torque of joint {joint} to velocities: {robot.name} at {where}"
    save(draw_bode(title, bode.frequency, curves, f"({unit})/(N.m)", bode.resonance, bode.antiresonance[0]), target)
    if as_json:
        return
    for label, each in (("resonances", bode.resonance), ("anti-resonances at the motor", bode.antiresonance[0])):
        say(f"Joint {joint}, {label}: {', '.join(f'{frequency:.2f}' for frequency in each) or 'none'} Hz")
    say_written(target)


def _over_path(robot: str, path: str, dry: bool, out: Path | None, overwrite: bool, as_json: bool) -> None:
    scenario = load(path, robot)
    target = target_file(out, f"{scenario.name}_modes.png", overwrite)
    from vdfmu.base.style import save
    from vdfmu.study.analysis.modes import MOTORS, modes_along, ranges
    from vdfmu.study.report.drawings import draw_modes

    times, along = modes_along(scenario, dry=dry)
    n = scenario.arm.n
    pairs = {motors: [(each.frequency[-n:], each.joint[-n:]) for each in poses] for motors, poses in along.items()}
    save(draw_modes(f"Natural frequencies: {scenario.arm.name}, {scenario.name}", times, pairs), target)
    if as_json:
        say_json({"t": list(times)} | {f"motors_{name}": list(map(_numbers, each)) for name, each in along.items()})
        return
    shown = table("mode", *(f"motors {motors}, Hz" for motors in MOTORS))
    columns = [
        [f"{pair[0]:.2f} to {pair[1]:.2f}" if pair else "does not oscillate" for pair in ranges(along[motors], n)]
        for motors in MOTORS
    ]  # fmt: skip
    for i, cells in enumerate(zip(*columns, strict=True)):
        shown.add_row(str(i + 1), *cells)
    console.print(shown)
    say_written(target, more=f": natural frequencies over the motion, at rest at {len(times)} poses")


def margins(
    system: Annotated[str, Positional("Scenario, or a system package.", metavar="[SCENARIO|FILE.ssp]")] = "tracking",
    robot: RobotOption = None,
    at: Annotated[list[float] | None, Option("Time of the run in s. Repeatable.",
        more="Default: the times with the smallest margins.")] = None,
    opened: Annotated[list[str] | None, Option("Input to open a loop at (default tau). Repeatable.", flag="--loop",
        metavar="INPUT")] = None,
    as_json: JsonOption = False,
    **options: Unpack[LoopOptions],
) -> None:  # fmt: skip
    """Print the smallest stability margins of each loop over a run.

    They include the delays of the master. The exit code is 1 if the run is unstable.
    """
    from vdfmu.base.errors import UsageError
    from vdfmu.study.analysis.loops import margins_along

    package = system.lower().endswith(".ssp")
    if package and robot is not None:
        raise UsageError(f"margins: --robot is for a scenario; {system} has its own.")
    loops = margins_along(system if package else load(system, robot), opened or (), at or (), **options)
    shown = table("opened at", "t", "modulus", "gain", "phase", "delay", "growth",
                  title=f"Stepped by {loops.step:g} s, {loops.algorithm}")  # fmt: skip
    chosen = [(i, k) for i in range(len(loops.names)) for k in (range(len(loops.times)) if at else [loops.least(i)])]
    smallest = min(float(loops.margins[k].modulus[i]) for i, k in chosen)
    rows: list[dict[str, Any]] = []
    for i, k in chosen:
        name, t, each = loops.names[i], loops.times[k], loops.margins[k]
        modulus, gain, phase, delay = (float(column[i]) for column in each[:4])
        rows.append({"opened_at": name, "t": t, "modulus": modulus, "gain": gain, "phase": phase, "delay": delay,
                     "rate": each.rate})  # fmt: skip
        late = f"{delay:.3g} s" if delay >= 1.0 else f"{1e3 * delay:.3g} ms"
        mark = " smallest" if modulus == smallest else ""
        numbers = (f"{modulus:.3f}{mark}", f"{gain:.3g}", f"{math.degrees(phase):.1f} deg", late)
        style = ("bold" if mark else None) if modulus else "red"
        cells = numbers if modulus else ("none", "", "", "")
        shown.add_row(name, f"{t:.4g} s", *cells, f"{each.rate:.3g} 1/s", style=style)
    state, words = loops.judged.words
    if as_json:
        say_json({"step": loops.step, "master": loops.algorithm, "state": state, "text": words, "margins": rows})
    else:
        console.print(shown)
    say_notes(loops.notes)
    if state == "failed":
        say_error(f"{words[:1].upper()}{words[1:]}.")
        raise SystemExit(1)
    if not as_json:
        say(f"{words[:1].upper()}{words[1:]}.")


def judge(
    system: Annotated[str, Positional("System package, FMU, or scenario.", metavar="FILE.ssp|SCENARIO")],
    wanted: Annotated[float, Option("Largest error wanted, in % of a signal's peak.", metavar="PERCENT",
        more="Default 1.")] = 1.0,
    step: Annotated[float | None, Option("Communication step in s (default the system's).")] = None,
    stop: Annotated[float | None, Option("Stop time in s (default the system's).")] = None,
    master: Annotated[str | None, master_option] = None,
    settings: Annotated[Mapping[str, Any] | None, settings_option] = None,
    meant: Annotated[str | None, Option("Meaning of discrete outputs without a period.",
        choices=("sampled", "continuous"),
        more="Sampled components keep the step as their period. By default both readings are printed.")] = None,
    as_json: JsonOption = False,
) -> None:  # fmt: skip
    """Judge the error by communication of a system of FMUs.

    Three runs with the step, its half and its quarter give the error of each signal behind a connection.
    The exit code is 0 if the system is right, 1 if not, 3 if this is not decided.
    """
    from vdfmu.study.connected import load as load_system

    judged = load_system(system).judge(
        wanted / 100.0, stop=stop, step=step, values=settings, algorithm=master, meant=meant
    )
    if as_json:
        say_json(judged.to_dict())
    else:
        shown = table("signal", "error", "half / whole", "at", title=f"Step {judged.step:g} s, {judged.algorithm}")
        for signal in judged.signals[:_MOST_SIGNALS]:
            shown.add_row(signal.name, f"{100.0 * signal.error:.2g} %", f"{signal.q:.2g}", f"{signal.time:.4g} s")
        if judged.signals:
            console.print(shown)
        (say if judged.right else say_error)(str(judged))
    if not judged.right:
        raise SystemExit(3 if judged.right is None else 1)


_MOST_SIGNALS = 8


def motion(
    file: Annotated[str, Positional("Scenario, TOML file with a motion, or CSV samples.", names=known_scenarios)],
    robot: RobotOption = None,
    out: Annotated[Path | None, Option("Picture to write.")] = None,
    overwrite: OverwriteOption = False,
    as_json: JsonOption = False,
) -> None:
    """Print peak speed, acceleration and torque of a motion. The torques are those of the rigid links."""
    import numpy as np

    from vdfmu.arm.dynamics import inverse_dynamics
    from vdfmu.arm.motion import load_motion
    from vdfmu.arm.robot import load_robot
    from vdfmu.base.errors import UsageError
    from vdfmu.base.toml_file import locate, read_toml

    place: str | Path | None = robot
    path = Path(file) if file.lower().endswith(".csv") else locate(file, "scenarios")
    content = read_toml(path) if path.suffix.lower() == ".toml" else {}
    if robot is None and isinstance(named := content.get("robot"), str):
        place = locate(named, "robots", path.parent)
    if place is None:
        raise UsageError(f"{file}: expected a robot, named in the file or by --robot.")
    target = None if out is None else target_file(out, out.name, overwrite)
    arm = load_robot(place)
    pieces, closed = "at 1001 times", False
    if "stop" in content and "motion" not in content:
        from vdfmu.study.analysis.modes import desired_motion

        names = ["q_d", *(f"q_d_{'d' * k}ot" for k in range(1, 5))]
        t, q = desired_motion(load(file, robot), names, 1001)
        peaks = np.abs(q[1:]).max(axis=1)
    else:
        course = load_motion(path, arm)
        t = np.linspace(0.0, course.duration, 1001)
        q, peaks, closed = course.at(t), course.peaks, course.closed
        pieces = f"in {len(course.knots) - 1} pieces"
        say_notes(course.notes)
    tau = np.abs(inverse_dynamics(arm, q[0], q[1], q[2])).max(axis=0)
    headings = ("from", "to", "speed", "acceleration", "jerk", "snap", "torque")
    rows = [(q[0, 0, j], q[0, -1, j], *peaks[:, j], tau[j]) for j in range(arm.n)]
    if as_json:
        joints = [dict(zip(headings, map(float, row), strict=True)) for row in rows]
        say_json({"duration": float(t[-1]), "closed": bool(closed), "joints": joints})
    else:
        shown = table("joint", *headings)
        for label, row in zip(arm.joint_labels, rows, strict=True):
            shown.add_row(label, *(f"{round(value, 9) + 0.0:.4g}" for value in row))
        console.print(shown)
        ends = ", and ends where it starts" if closed else ""
        say(f"{t[-1]:.6g} s {pieces}{ends}. Units: rad or m, s, N.m or N on the link side.")
    if target is not None:
        from vdfmu.base.style import save
        from vdfmu.study.report.drawings import draw_motion

        save(draw_motion(arm, t, q), target)
        if not as_json:
            say_written(target)
