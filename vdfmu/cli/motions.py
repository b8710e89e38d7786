"""``vdfmu motion``."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from vdfmu.cli.terminal import (
    JsonOption,
    OverwriteOption,
    RobotOption,
    complete_scenario,
    console,
    load,
    out_option,
    say,
    say_json,
    say_notes,
    say_written,
    table,
    target_file,
)


def motion(
    file: Annotated[
        str,
        typer.Argument(
            help="A scenario, a TOML file with a table motion, or a CSV file of samples.",
            autocompletion=complete_scenario,
        ),
    ],
    robot: RobotOption = None,
    out: Annotated[Path | None, out_option("Picture to write.")] = None,
    overwrite: OverwriteOption = False,
    as_json: JsonOption = False,
) -> None:
    """Work a motion out and print what it takes of each joint: speed, acceleration, torque of the rigid links."""
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
        found = load_motion(path, arm)
        t = np.linspace(0.0, found.duration, 1001)
        q, peaks, closed = found.at(t), found.peaks, found.closed
        pieces = f"in {len(found.knots) - 1} pieces"
        say_notes(found.notes)
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
        say(f"{t[-1]:.6g} s {pieces}{ends}; rad or m, s, N.m or N, link-side")
    if target is not None:
        from vdfmu.base.style import save
        from vdfmu.study.report.drawings import draw_motion

        save(draw_motion(f"Motion: {path.stem}, {arm.name}", arm, t, q), target)
        if not as_json:
            say_written(target)
