"""``vdfmu identify --for stiffness``: the excitation torques, and the springs that a log of them determines."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure as Picture

from vdfmu.arm.robot import Robot, load_robot
from vdfmu.base.errors import UsageError
from vdfmu.base.files import write_whole
from vdfmu.base.measure import unit_of
from vdfmu.cli.options import target_file
from vdfmu.cli.terminal import console, say, say_notes, say_written, table
from vdfmu.engine.results.verdict import FAILED, state_of
from vdfmu.extras.identify.fit import robot_text
from vdfmu.extras.identify.log import read_columns, read_log
from vdfmu.extras.identify.margins import UNKNOWN, MarginInterval, spring_margins
from vdfmu.extras.identify.periodic import LEVELS, NYQUIST, REALISATIONS, SETTLING, USED, PeriodicTorques
from vdfmu.extras.identify.stiffness import Stiffness, identify_stiffness
from vdfmu.extras.identify.stiffness_design import STEP, StiffnessExperiment, stiffness_experiment
from vdfmu.extras.identify.stiffness_report import (
    DESIGN_HEADS,
    HEADS,
    design_rows,
    draw_responses,
    scaled_robot,
    stiffness_notes,
    stiffness_page,
    stiffness_rows,
    stiffness_verdict,
    unexcited_verdict,
)
from vdfmu.extras.pictures.style import save
from vdfmu.study.report.sheets import verdict_table, verdict_text

_COLUMN = "controller.tau_m[{}]"
"""Column of a torque, named like the feedforward input of the controllers in shipped scenarios."""


def design_stiffness(
    robot: str, pose: list[float] | None, step: float | None, out: Path | None, overwrite: bool
) -> None:
    """Choose the torques, print the amplitudes and the demands on the log, and write them."""
    arm = load_robot(robot)
    target = None if out is None else target_file(out, "", overwrite)
    plan = stiffness_experiment(arm, pose=pose, step=STEP if step is None else step)
    _print_design(arm, plan)
    if target is not None:
        write_whole(target, [excitation_text(plan.excitation).encode()])
        say_written(target, more=f": excitation torques of the motors, {plan.excitation.t[-1]:.4g} s")


def _print_design(arm: Robot, plan: StiffnessExperiment) -> None:
    lines = plan.excitation.lines
    shown = table(*DESIGN_HEADS)
    pose = " ".join(f"{x:.4g}" for x in plan.pose)
    shown.title = (
        f"{len(lines)} lines from {lines[0]:.3g} to {lines[-1]:.4g} Hz, {plan.excitation.t[-1]:.3g} s, at pose {pose}"
    )
    for row in design_rows(plan):
        shown.add_row(*row)
    console.print(shown)
    units = " or ".join(dict.fromkeys(unit_of("position", kind) for kind in arm.joint_types))
    say_notes([
        *(f"joint {i + 1} lacks {lacks}" for i, lacks in enumerate(plan.lacks) if lacks),
        f"torques are motor-side, at {LEVELS[0]:g} and {LEVELS[1]:g} times the breakaway friction or as large as the "
        f"limits allow; speed and travel [{units}] are predicted without friction, at the higher level",
        "apply them at this pose, together with a soft position controller of about 1 Hz, and log motor positions and "
        "motor torques",
        "collisions are not checked: check the travel before you apply the torques",
    ])  # fmt: skip
    if not arm.limits:
        say_notes(["the robot file has no limits, so torque, speed and travel are not limited: add [joints.limits]"])


def excitation_text(plan: PeriodicTorques) -> str:
    """Return the torques as CSV with a column for each motor [N.m]."""
    names = [f"{_COLUMN.format(i + 1)} [N.m]" for i in range(plan.torque.shape[1])]
    rows = (
        ",".join([f"{t:.9g}", *(f"{x:.6g}" for x in row)]) for t, row in zip(plan.t, plan.torque.tolist(), strict=True)
    )
    return "\n".join([",".join(["time", *names]), *rows, ""])


def read_excitation(path: Path, n: int) -> PeriodicTorques:
    """Return the torques of a file of :func:`excitation_text`."""
    columns = read_columns(path, "", [])
    names = [_COLUMN.format(i + 1) for i in range(n)]
    if lacking := [name for name in names if name not in columns]:
        raise UsageError(
            f"{path}: expected the columns {', '.join(names)}, as --design writes them; {lacking[0]} is missing."
        )
    t, torque = columns[names[0]].t, np.stack([columns[name].values for name in names], axis=1)
    count, each = len(LEVELS) * REALISATIONS, SETTLING + USED
    whole = len(t) > 0 and len(t) % (count * each) == 0 and torque.any()
    if whole:
        periods, steps = torque.reshape(count, each, -1, n), np.diff(t)
        whole = (periods == periods[:, :1]).all() and np.allclose(steps, steps.mean(), rtol=1e-3)
    if not whole:
        raise UsageError(
            f"{path}: expected torques in even rows, {count} times {each} equal periods, got {len(t)} rows with other "
            "ones. Write the file again by --design, and change nothing in it."
        )
    return PeriodicTorques(t, torque)


def show_stiffness(
    log: Path, robot: str, columns: Mapping[str, str], time: str, excitation: Path | None,
    files: Mapping[str, Path | None], overwrite: bool, scenario: str | None = None,
) -> None:  # fmt: skip
    """Identify the springs from a log, print and write the result; exit code 1 if no spring is identifiable.

    `files` are those to write: ``plot``, ``page`` and ``out``; `scenario` is the system whose margins are judged.
    """
    arm = load_robot(robot)
    targets = {name: target_file(path, "", overwrite) for name, path in files.items() if path is not None}
    rows = read_log(log, arm, columns, time=time)
    say_notes(rows.notes)
    interval: MarginInterval | None = None
    written: list[Path] = []
    title = f"Springs of {arm.name} from {log.name}, by its motors"
    if excitation is None:
        plan = stiffness_experiment(arm, pose=rows.kappa.mean(axis=0), step=rows.step)
        judged = {"verdict": unexcited_verdict(rows, arm, plan)}
        _print_verdict(judged)
        say("\nThe torques that identify them, by vdfmu identify --design ROBOT --for stiffness:")
        _print_design(arm, plan)
        pages = stiffness_page(title, judged, [], [_to_do(plan)], [])
    else:
        torques = read_excitation(excitation, arm.n)
        fit = identify_stiffness(rows, arm, torques)
        judged = {"verdict": stiffness_verdict(fit, rows.checks)}
        shows = state_of(judged) != FAILED
        if scenario is not None and shows:
            interval = spring_margins(fit, scenario)
            judged = {"verdict": stiffness_verdict(fit, [*rows.checks, interval.check])}
        _print_verdict(judged)
        shown = table(*HEADS)
        for row in stiffness_rows(fit):
            shown.add_row(*row)
        console.print(shown)
        notes = [*stiffness_notes(fit), *_on_margins(interval)]
        if NYQUIST / rows.step < torques.lines[-1]:
            least = torques.lines[-1] / NYQUIST
            notes.append(
                f"torques go up to {torques.lines[-1]:.4g} Hz, but the log's rate shows {NYQUIST / rows.step:.4g} Hz, "
                f"and higher ones distort it unless they are filtered before: log at {least:.4g} Hz or faster"
            )
        say_notes(notes)
        picture = draw_responses(fit, title)
        pages = stiffness_page(title, judged, stiffness_rows(fit), notes, [picture])
        written += _write_fit(fit, picture, targets, log.name, shows)
    if scenario is not None and interval is None:
        say_notes([f"margins of {scenario} were not computed, because the verdict is failed"])
    if "page" in targets:
        write_whole(targets["page"], [pages])
        written.append(targets["page"])
    if written:
        say_written(*written)
    say_notes([
        f"{path} was not written, because the verdict is failed" for path in targets.values() if path not in written
    ])  # fmt: skip
    if state_of(judged) == FAILED:
        raise SystemExit(1)


def _on_margins(interval: MarginInterval | None) -> list[str]:
    """Return remarks on the margins."""
    if interval is None:
        return []
    notes = [
        "margins: the plant has the identified springs within their absolute intervals; slopes of the margin by the "
        f"logarithm of each stiffness: {', '.join(f'{x:+.2g}' for x in interval.slopes)}"
    ]
    if interval.assumed:
        numbers = ", ".join(map(str, interval.assumed))
        notes.append(
            f"margins: the spring of joint {numbers} is the robot file's within {100 * UNKNOWN:.0f} %, one deviation"
        )
    return notes


def _write_fit(fit: Stiffness, picture: Picture, targets: Mapping[str, Path], log: str, shows: bool) -> list[Path]:
    """Write the picture, and the robot if springs are identified; return their paths."""
    written: list[Path] = []
    if "plot" in targets:
        written.append(save(picture, targets["plot"]))
    if "out" in targets and shows:
        made, notes = scaled_robot(fit)
        say_notes(notes)
        head = f"{made.name}, with springs identified from {log} by vdfmu identify."
        write_whole(targets["out"], [robot_text(made, head).encode()])
        written.append(targets["out"])
    return written


def _print_verdict(judged: dict[str, dict[str, object]]) -> None:
    console.print(verdict_text(judged), soft_wrap=True)
    console.print(verdict_table(judged))


def _to_do(plan: StiffnessExperiment) -> str:
    lines = plan.excitation.lines
    torques = ", ".join(f"{x:.3g}" for x in plan.torque)
    return (
        f"These torques identify them: multisines from {lines[0]:.3g} to {lines[-1]:.3g} Hz with {torques} N.m RMS "
        f"at the motors, for {plan.excitation.t[-1]:.3g} s at one pose. vdfmu identify --design ROBOT --for stiffness "
        "writes them"
    )
