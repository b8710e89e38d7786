"""``vdfmu motion``."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from vdfmu.cli.terminal import (
    JsonOption,
    OverwriteOption,
    RobotOption,
    console,
    say,
    say_json,
    say_notes,
    say_written,
    table,
    target_file,
)


def motion(
    file: Annotated[str, typer.Argument(help="Scenario or TOML file with a table motion, or CSV file of samples.")],
    robot: RobotOption = None,
    out: Annotated[Path | None, typer.Option("--out", "-o", help="Picture to write.")] = None,
    overwrite: OverwriteOption = False,
    as_json: JsonOption = False,
) -> None:
    """Work a motion out and print what it takes of each joint: speed, acceleration, torque of the rigid links."""
    import numpy as np

    from vdfmu.arm.dynamics import inverse_dynamics
    from vdfmu.arm.motion import load_motion
    from vdfmu.arm.robot import load_robot
    from vdfmu.arm.robot.load import locate
    from vdfmu.base.errors import UsageError
    from vdfmu.base.toml_file import read_toml

    place: str | Path | None = robot
    path = Path(file) if file.lower().endswith(".csv") else locate(file, "scenarios")
    if robot is None and path.suffix.lower() == ".toml" and isinstance(named := read_toml(path).get("robot"), str):
        place = locate(named, "robots", path.parent)
    if place is None:
        raise UsageError(f"{file}: expected a robot, named in the file or by --robot.")
    target = None if out is None else target_file(out, out.name, overwrite)
    arm = load_robot(place)
    found = load_motion(path, arm)
    t = np.linspace(0.0, found.duration, 1001)
    q = found.at(t)
    tau = np.abs(inverse_dynamics(arm, q[0], q[1], q[2])).max(axis=0)
    headings = ("from", "to", "speed", "acceleration", "jerk", "snap", "torque")
    rows = [(found.start[j], found.end[j], *found.peaks[:, j], tau[j]) for j in range(arm.n)]
    say_notes(found.notes)
    if as_json:
        joints = [dict(zip(headings, map(float, row), strict=True)) for row in rows]
        say_json({"duration": float(found.duration), "closed": bool(found.closed), "joints": joints})
    else:
        shown = table("joint", *headings)
        for label, row in zip(arm.joint_labels, rows, strict=True):
            shown.add_row(label, *(f"{round(value, 9) + 0.0:.4g}" for value in row))
        console.print(shown)
        closed = ", and ends where it starts" if found.closed else ""
        say(f"{found.duration:.6g} s in {len(found.knots) - 1} pieces{closed}; rad or m, s, N.m or N, link-side")
    if target is not None:
        from vdfmu.base.style import save
        from vdfmu.study.report.drawings import draw_motion

        save(draw_motion(f"Motion: {path.stem}, {arm.name}", arm, t, q), target)
        if not as_json:
            say_written(target)
