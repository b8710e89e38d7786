"""``vdfmu scenario list``, ``show`` and ``motion``."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

from vdfmu.base.extras import module_of_extra
from vdfmu.base.option import Option
from vdfmu.cli.app import LOOKS, RUNS, App, meets_code
from vdfmu.cli.options import JsonOption, OverwriteOption, Positional, RobotOption, known_scenarios, load, target_file
from vdfmu.cli.terminal import console, say, say_json, say_list, say_notes, say_written, table

app = App("scenario", no_args_is_help=True, help="List and show scenarios and motions.")


@app.command("list", example="vdfmu scenario list")
def list_scenarios(as_json: JsonOption = False) -> None:
    """List the scenarios that are shipped with vdfmu."""
    from vdfmu.system.scenario import load_scenario, scenario_names

    say_list("scenario", {name: load_scenario(name).description for name in scenario_names()}, as_json)


@app.command("show", example="vdfmu scenario show tracking")
@meets_code(LOOKS)
def show_scenario(name: Annotated[str, Positional("Scenario, or its TOML file.", names=known_scenarios)]) -> None:
    """Show the file of a scenario."""
    from vdfmu.base.errors import UsageError
    from vdfmu.base.files import read_text
    from vdfmu.base.toml_file import locate, read_toml

    if name == "reach":
        raise UsageError(
            "reach: has no file, because it is generated for a robot. 'vdfmu robot reach ROBOT' writes one."
        )
    read_toml(path := locate(name, "scenarios"))
    say(read_text(path))


@app.command("motion", example="vdfmu scenario motion path.toml --robot planar_2dof -o path.png")
@meets_code(RUNS)
def motion(
    file: Annotated[str, Positional("Scenario, TOML file with a motion, or CSV samples.", names=known_scenarios)],
    robot: RobotOption = None,
    out: Annotated[Path | None, Option("Picture to write.")] = None,
    overwrite: OverwriteOption = False,
    as_json: JsonOption = False,
) -> None:
    """Print peak speed, acceleration and torque of a motion.

    The torques are those of the rigid links.
    """
    import numpy as np

    from vdfmu.arm.dynamics import inverse_dynamics
    from vdfmu.arm.motion import load_motion
    from vdfmu.arm.robot import load_robot
    from vdfmu.base.errors import UsageError
    from vdfmu.base.toml_file import locate, read_toml

    place: str | Path | None = robot
    made = file == "reach" and not Path(file).exists()
    path = Path(file) if made or file.lower().endswith(".csv") else locate(file, "scenarios")
    content = read_toml(path) if path.suffix.lower() == ".toml" else {}
    if robot is None and isinstance(named := content.get("robot"), str):
        place = locate(named, "robots", path.parent)
    if place is None and not made:
        raise UsageError(f"{file}: expected a robot, named in the file or by --robot.")
    target = None if out is None else target_file(out, out.name, overwrite)
    scenario = load(file, robot) if made or ("stop" in content and "motion" not in content) else None
    arm = load_robot(place or "") if scenario is None else scenario.arm
    pieces, closed = "at 1001 times", False
    if scenario is not None:
        from vdfmu.study.analysis.modes import desired_motion

        names = ["q_d", *(f"q_d_{'d' * k}ot" for k in range(1, 5))]
        t, q = desired_motion(scenario, names, 1001)
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
        cells = [[f"{round(value, 9) + 0.0:.4g}" for value in row] for row in rows]
        by_joint = ((label, *row) for label, row in zip(arm.joint_labels, cells, strict=True))
        console.print(table("joint", *headings, rows=by_joint))
        ends = ", and ends where it starts" if closed else ""
        say(f"{t[-1]:.6g} s {pieces}{ends}. Units: rad or m, s, N.m or N on the link side.")
    if target is not None:
        module_of_extra("motion_picture", "pictures", "-o").write_motion(arm, t, q, target)
        if not as_json:
            say_written(target)
