"""``vdfmu identify``."""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

from vdfmu.base.measure import unit_of
from vdfmu.base.option import Option, option_of, read_settings
from vdfmu.cli.app import RUNS, meets_code
from vdfmu.cli.options import OverwriteOption, Positional, read_numbers, refuse, target_file
from vdfmu.cli.terminal import console, say, say_notes, say_written, table
from vdfmu.engine.options import TEXTS
from vdfmu.study.options import RobotOptions

if TYPE_CHECKING:
    from vdfmu.base.arrays import Floats
    from vdfmu.extras.identify.fit import Identified, LogScore


_DESIGN = "Instead of a log"
_CLOSE = 0.5
"""Smallest correlation that is mentioned in a note."""


@meets_code(RUNS)
def identify(
    log: Annotated[Path | None, Positional("Log of a motion.",
        more="Results of a run, CSV of any tool, Parquet, a MATLAB file, or a file that a plugin reads.")] = None,
    robot: Annotated[str | None, option_of(RobotOptions, "robot",
        "Robot to start from: kinematics, ratios, guesses.")] = None,
    column: Annotated[dict[str, str] | None, Option("Column of the log: 'tau=I{} [-1.81 N.m]'.", flag="--column",
        metavar="WHAT=NAME", typed=TEXTS,
        read=partial(read_settings, option="--column", form="WHAT=NAME, such as q=q_{}"),
        more="WHAT is kappa, theta, tau, tau_link or q; q[2] is that of joint 2 only. In NAME, {} is replaced "
        "by the number of the joint. A unit, with a factor if needed, may follow in brackets.")] = None,
    time: Annotated[str, Option("Column of the times.", metavar="NAME",
        more="s, ms, us or ns may follow in brackets.")] = "",
    band: Annotated[float | None, Option("Cutoff frequency of the fit in Hz.", more="All signals are "
        "low-pass filtered to it. The default depends on the motion.")] = None,
    prior: Annotated[float, Option("Uncertainty of the robot file's links.", metavar="SHARE",
        more="It is a fraction: of masses and moments of inertia, and, for centres of mass, of the radius of gyration. "
            "With inf the file's values have no influence.")] = 0.2,
    other: Annotated[Path | None, Option("Another log to validate the model on.", flag="--score",
        metavar="LOG")] = None,
    plot: Annotated[Path | None, Option("Picture of torques and residuals to draw.")] = None,
    residuals: Annotated[Path | None, Option("Picture of the residuals to draw.",
        more="It shows them over speed, load, position and time, for the validation log if there is one.")] = None,
    out: Annotated[Path | None, Option("Robot file to write; with --design the motion.")] = None,
    purpose: Annotated[str | None, Option("stiffness: springs from motor-side logs.", flag="--for",
        metavar="WHAT", choices=("stiffness",), more="The log needs periodic motor torques, but "
            "no signals of link-side encoders. With --design the torques are chosen.")] = None,
    excitation: Annotated[Path | None, Option("Excitation torques, as written by --design.", metavar="CSV",
        more="For --for stiffness.")] = None,
    margins: Annotated[str | None, Option("Scenario whose modulus margin to compute.", metavar="SCENARIO",
        more="For --for stiffness: the smallest margin for any stiffness that fits the log.")] = None,
    page: Annotated[Path | None, Option("Page to write, with --for stiffness.", metavar="HTML",
        more="Verdict, table and frequency responses in one file.")] = None,
    overwrite: OverwriteOption = False,
    design: Annotated[str | None, Option("Choose the best motion to log for this robot.", group=_DESIGN,
        metavar="ROBOT", more="It is the motion that determines the parameters best. The widths of their confidence "
            "intervals are predicted.")] = None,
    duration: Annotated[float | None, Option("Duration of the motion in s (default 60).", group=_DESIGN)] = None,
    pose: Annotated[str | None, Option("Pose about which joints move (default several).", group=_DESIGN,
        metavar="'Q1 Q2 ...'", more="The default is several poses about the middle of the range.")] = None,
    step: Annotated[float | None, Option("Step of the log in s (default 0.002).", group=_DESIGN)] = None,
    bits: Annotated[int | None, Option("Bits of the encoders (default 17).", group=_DESIGN)] = None,
    noise: Annotated[float | None, Option("Torque noise / peak torque (default 0.005).", group=_DESIGN,
        metavar="SHARE")] = None,
    no_links: Annotated[bool, Option("Assume no link-side encoders.", group=_DESIGN)] = False,
) -> None:  # fmt: skip
    """Estimate the parameters of an arm from a log of its motion.

    The parameters are those of drives, friction and springs, and the base parameters of the links. If the verdict is
    failed, the exit code is 1 and no robot file is written.
    """
    from vdfmu.arm.robot import load_robot
    from vdfmu.base.errors import UsageError
    from vdfmu.base.files import read_regular, write_whole
    from vdfmu.engine.results.verdict import FAILED, state_of
    from vdfmu.extras.identify.fit import identify as estimate
    from vdfmu.extras.identify.fit import score
    from vdfmu.extras.identify.log import read_log
    from vdfmu.extras.identify.verdict import verdict
    from vdfmu.study.report.sheets import verdict_table, verdict_text

    if purpose not in (None, "stiffness"):
        raise UsageError(f"--for must be stiffness, got {purpose}. Without it, all parameters are identified.")
    of_log = {"--robot": robot, "--column": column, "--time": time, "--score": other, "--plot": plot,
              "--residuals": residuals, "--excitation": excitation, "--page": page,
              "--margins": margins}  # fmt: skip
    of_design = {"--duration": duration, "--pose": pose, "--step": step, "--bits": bits, "--noise": noise,
                 "--no-links": no_links}  # fmt: skip
    if (log is None) == (design is None):
        got = "neither" if log is None else "both"
        raise UsageError(f"identify: expected a log, or --design ROBOT for a motion to log, got {got}.")
    unfit = of_design if design is None else of_log
    refuse(unfit, "goes with --design" if design is None else "goes with a log")
    if purpose is not None:
        refuse({"--band": band, "--score": other, "--residuals": residuals, "--duration": duration, "--bits": bits,
                "--noise": noise, "--no-links": no_links}, "does not go with --for stiffness")  # fmt: skip
    if log is not None and robot is None:
        raise UsageError("identify: expected --robot ROBOT, the robot to start from.")
    if purpose is not None:
        from vdfmu.extras.identify.stiffness_commands import design_stiffness, show_stiffness

        if design is not None:
            start = None if pose is None else read_numbers("--pose", pose)
            return design_stiffness(design, start, step, out, overwrite)
        assert log is not None and robot is not None
        files = {"plot": plot, "page": page, "out": out}
        return show_stiffness(log, robot, column or {}, time, excitation, files, overwrite, margins)
    refuse({"--excitation": excitation, "--page": page, "--margins": margins}, "goes with --for stiffness")
    if design is not None:
        sensors = {"step": step, "bits": bits, "noise": noise, "links": not no_links}
        _design(design, duration, pose, sensors, band, prior, out, overwrite)
        return
    assert log is not None and robot is not None
    arm = load_robot(robot)
    wanted = [path for path in (plot, residuals, out) if path is not None]
    targets = {path: target_file(path, "", overwrite) for path in wanted}
    if len(targets) < len(wanted):
        raise UsageError(f"identify: expected files of different names, got {', '.join(map(str, wanted))}.")
    columns = column or {}
    rows = read_log(log, arm, columns, time=time)
    say_notes(rows.notes)
    beside = {} if out is None else {out.with_name(name): text.encode() for name, text in arm.files.items()}
    beside = {path: text for path, text in beside.items() if not path.is_file() or read_regular(path) != text}
    for path in beside:
        target_file(path, "", overwrite)
    second = None
    if other is not None:
        second = read_log(other, arm, columns, time=time)
        say_notes([f"{other.name}: {note}" for note in second.notes])
    fit = estimate(rows, arm, band=band, prior=prior)
    scored = score(fit, arm, rows, rows if second is None else second)
    judged = {"verdict": verdict(fit, (*rows.checks, *(() if second is None else second.checks)), arm, scored)}
    console.print(verdict_text(judged), soft_wrap=True)
    console.print(verdict_table(judged))
    _print(fit, arm.joint_labels)
    units = tuple(unit_of("torque", kind) for kind in arm.joint_types)
    if other is not None:
        _print_score(other.name, scored, arm.joint_labels, units)
    written: list[Path] = []
    if plot is not None:
        from vdfmu.extras.identify.drawings import draw_torques
        from vdfmu.extras.pictures.style import save

        save(draw_torques(fit.t, fit.torque, fit.torque_error, units), targets[plot])
        written.append(plot)
    if residuals is not None:
        from vdfmu.extras.identify.drawings import draw_residuals
        from vdfmu.extras.pictures.style import save

        title = f"Residuals of {arm.name}, identified from {log.name}, on {(other or log).name}"
        save(draw_residuals(title, scored, arm), targets[residuals])
        written.append(residuals)
    failed = state_of(judged) == FAILED
    if out is not None and failed:
        say_notes([f"{out} was not written, because the verdict is failed"])
    elif out is not None:
        from vdfmu.extras.identify.fit import identified_robot, robot_text

        made, notes = identified_robot(fit, arm, log.name)
        say_notes(notes)
        head = f"{arm.name}, identified from {log.name} by vdfmu identify."
        for path, content in ({targets[out]: robot_text(made, head).encode()} | beside).items():
            write_whole(path, [content])
            written.append(path)
    if written:
        say_written(*written)
    if failed:
        raise SystemExit(1)


def _design(
    robot: str, duration: float | None, pose: str | None, sensors: dict[str, Any], band: float | None, prior: float,
    out: Path | None, overwrite: bool,
) -> None:  # fmt: skip
    """Choose a motion, write it, and print the predicted intervals."""
    from vdfmu.arm.robot import load_robot
    from vdfmu.base.files import write_whole
    from vdfmu.extras.identify.motion_choice import SensorNoise, design

    arm = load_robot(robot)
    target = None if out is None else target_file(out, "", overwrite)
    noise = SensorNoise(**{name: value for name, value in sensors.items() if value is not None})
    length = {} if duration is None else {"duration": duration}
    start = None if pose is None else read_numbers("--pose", pose)
    plan = design(arm, **length, start=start, sensors=noise, band=band, prior=prior)
    say_notes(plan.notes)
    _print(plan.expected, arm.joint_labels)
    text = plan.text(f"Motion to identify {arm.name}, {plan.motion.duration:g} s, chosen by vdfmu identify --design.")
    if target is None:
        say(f"\n{text}")
    else:
        write_whole(target, [text.encode()])
        say_written(target, more=f": the motion, {plan.motion.duration:g} s")


def _print(fit: Identified, labels: list[str]) -> None:
    shown = table("parameter", "value", "95 %", "unit", "robot file")
    shown.columns[1].no_wrap = True
    late = 1.96 * fit.deviation[fit.names.index("delay_tau")]
    shown.title = (
        f"{len(fit.t)} rows, band {fit.band:.3g} Hz, torques {1e3 * fit.delay:.2f} +- {1e3 * late:.2g} ms late"
    )
    rows = zip(fit.names, fit.values, fit.deviation, fit.units, fit.nominal, strict=True)
    for name, value, deviation, unit, nominal in rows:
        width = "kept" if name in fit.held else f"+- {1.96 * deviation:.2g}"
        shown.add_row(name, f"{value:.5g}", f"{width} weak" if name in fit.weak else width, unit, f"{nominal:.5g}")
    console.print(shown)
    drives = table("joint", "residual", "torque RMS", "%", "deformation residual", "stiffness", "95 %", title=" ")
    for i in range(fit.torque.shape[1]):
        left, whole = (float((each[:, i] ** 2).mean() ** 0.5) for each in (fit.torque_error, fit.torque))
        bent = fit.deformation_error if fit.seen[i] else None
        drives.add_row(
            labels[i], f"{left:.3g}", f"{whole:.3g}", f"{100 * left / whole:.1f}",
            "" if bent is None else f"{float((bent[:, i] ** 2).mean() ** 0.5):.3g}",
            "" if bent is None else f"{fit.stiffness[i]:.6g}",
            "" if bent is None else f"+- {1.96 * fit.stiffness_deviation[i]:.2g}",
        )  # fmt: skip
    console.print(drives)
    say_notes([
        f"not identified, kept: {', '.join(k for k, v in fit.held.items() if v == why)}: {why}"
        for why in dict.fromkeys(fit.held.values())
    ])  # fmt: skip
    say_notes(_weak(fit))
    say_notes(fit.advice)


def _weak(fit: Identified) -> list[str]:
    """Return notes on weak parameters, grouped by fix."""
    by_advice: dict[str, list[str]] = {}
    links = [name for name in fit.weak if name in fit.base.names]
    for name, why in fit.weak.items():
        if name not in links:
            more = f" (correlation with {why.partner} {why.correlation:+.2f})" if abs(why.correlation) > _CLOSE else ""
            by_advice.setdefault(why.advice, []).append(name + more)
    if links:
        by_advice.setdefault(fit.weak[links[0]].advice, []).append(
            f"{len(links)} of {len(fit.base.names)} base parameters of the links"
        )
    return [
        f"weak estimates, which stay near the robot file's values because the log does not excite these parameters: "
        f"{', '.join(names)}; {advice}"
        for advice, names in by_advice.items()
    ]


def _print_score(name: str, score: LogScore, labels: list[str], units: tuple[str, ...]) -> None:
    import numpy as np

    unit = " or ".join(dict.fromkeys(units))
    angle = " or ".join(dict.fromkeys("m" if each == "N" else "rad" for each in units))
    shown = table(
        "joint", f"torque\n{unit}", f"residual\n{unit}", "resid.\n%", f"max.\n{unit}", "links held\n%", "5 terms\n%",
        f"deform.\n{angle}", f"residual\n{angle}", "resid.\n%", f"max.\n{angle}",
        title=f"\n{name}, link-side: RMS values and largest residuals; in % also with the robot file's links, and "
            f"for a rigid model with five terms per joint",
    )  # fmt: skip

    def cells(values: Sequence[Floats], i: int) -> list[str]:
        return ["" if np.isnan(each[i]) else f"{each[i]:.4g}" if each[i] > 1.0 else f"{each[i]:.3g}" for each in values]

    for i, label in enumerate(labels):
        share, held, rigid = (
            100.0 * each[i] / score.torque[i] for each in (score.torque_left, score.held_left, score.rigid_left)
        )
        bent = 100.0 * score.deformation_left[i] / score.deformation[i]
        shown.add_row(
            label, *cells([score.torque, score.torque_left], i), f"{share:.1f}", *cells([score.torque_most], i),
            f"{held:.1f}", f"{rigid:.1f}", *cells([score.deformation, score.deformation_left], i),
            "" if np.isnan(bent) else f"{bent:.0f}", *cells([score.deformation_most], i),
        )  # fmt: skip
    console.print(shown)


COMMANDS = {
    "Analyse": [(identify, "vdfmu identify results/tracking/results.csv --robot manipulator_6dof -o identified.toml")]
}
"""By group: commands and their examples."""
