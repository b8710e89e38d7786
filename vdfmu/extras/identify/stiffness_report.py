"""Reports the springs identified from a motor-side log: verdict, tables, picture and page."""

from __future__ import annotations

import base64
from collections.abc import Sequence
from dataclasses import replace
from html import escape
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.figure import Figure as Picture
from scipy.signal import periodogram

from vdfmu.arm.robot import Robot
from vdfmu.base.files import temporary_folder
from vdfmu.base.measure import quantity, unit_of
from vdfmu.base.page import page, table
from vdfmu.engine.results.verdict import DOUBTFUL, FAILED, GOOD, SIGNS, Check, checks_of, headline_of, verdict_of
from vdfmu.extras.identify.fit import NORMAL_95
from vdfmu.extras.identify.log import Log
from vdfmu.extras.identify.motor_side import effective_stiffness
from vdfmu.extras.identify.stiffness import Stiffness
from vdfmu.extras.identify.stiffness_design import LEAST, StiffnessExperiment, missing
from vdfmu.extras.pictures import style

_AROUND = 2.0
"""A log without the excitation is judged in the band from the antiresonance divided by this to the product with it."""
HEADS = (
    "joint", "motor torque\nN.m RMS", "spring torque\nRMS", "stiffness", "95 %", "absolute\n95 %", "damping",
    "antires.\nHz",
)  # fmt: skip


def stiffness_verdict(fit: Stiffness, more: Sequence[Check] = ()) -> dict[str, Any]:
    """Return the entry ``verdict``: a check for each joint, failed if no joint is identifiable, and some `more`."""
    robot, checks = fit.side.robot, list[Check]()
    for i in range(robot.n):
        best = fit.best(i)
        level, place = fit.levels[best], f"joint {i + 1}"
        if level.identifiable[i]:
            unit = unit_of("stiffness", robot.joint_types[i])
            text = f"stiffness of {place}: {quantity(level.stiffness[i], unit)} +- {_per_cent(level.deviation[i])}"
            checks.append(Check("stiffness", "Stiffness", GOOD, text))
        else:
            lacks = missing(level.antiresonance, level.f[-1], level.swing, np.array(robot.f_s) / robot.ell)[i]
            text = f"the stiffness of {place} is not identifiable"
            if lacks:
                advice = f"log {lacks}"
            elif level.explained[i]:
                advice = f"+- {_per_cent(level.deviation[i])}: log more periods, or larger torques"
            else:
                advice = (
                    f"the fit explains {100.0 * max(level.share[i], 0.0):.0f} % of the link's torque, with "
                    f"{level.rotor[i]:.2g} times the file's rotor inertia: check the order, signs and units of the "
                    "columns, and the robot file"
                )
            checks.append(Check("stiffness", "Stiffness", DOUBTFUL, text, advice))
    count = int(fit.identifiable.sum())
    if not count:
        checks = [check._replace(state=FAILED) for check in checks]
    return verdict_of([*checks, *more], [f"stiffness of {count} of {robot.n} joints identified"])


def unexcited_verdict(log: Log, robot: Robot, plan: StiffnessExperiment) -> dict[str, Any]:
    """Return the verdict on a log with torques other than the excitation: how well they excite each spring.

    They are compared with Coulomb friction in the octaves around the antiresonance, below half of the log's rate.
    Faults of the log come first.
    """
    checks = list(log.checks)
    rate = 1.0 / log.step
    lacks = missing(plan.antiresonance, 0.5 * rate, None, plan.breakaway)
    for i, f in enumerate(plan.antiresonance):
        band = f / _AROUND, min(f * _AROUND, 0.5 * rate)
        size = _band_rms(log.tau[:, i], log.step, band)
        dry = float(robot.f_c[i] / robot.ell[i])
        if size >= LEAST * dry:
            text = f"joint {i + 1} is excited, but not by periodic torques: its stiffness is not identifiable"
            advice = "apply the torques of --design, and name their file with --excitation"
            checks.append(Check("stiffness", "Stiffness", FAILED, text, advice))
            continue
        if band[0] < band[1]:
            share = 100.0 * size / max(dry, 1e-300)
            text = f"excitation of joint {i + 1} at {band[0]:.3g} to {band[1]:.3g} Hz is {share:.0f} % of its friction"
            more = (
                f"torques of {size:.2g} N.m there, Coulomb friction of {dry:.2g} N.m: its stiffness is not identifiable"
            )
        else:
            text = f"the antiresonance of joint {i + 1} at {f:.3g} Hz is above the band of the log"
            more = "its stiffness is not identifiable"
        checks.append(Check("stiffness", "Stiffness", FAILED, text, f"{more}; the log needs {lacks[i]}"))
    return verdict_of(checks)


def _band_rms(signal: Any, step: float, band: tuple[float, float]) -> float:
    """Return the RMS of a signal about its linear trend in a band, with a Hann window."""
    f, density = periodogram(signal, 1.0 / step, "hann", detrend="linear")
    return float(np.sqrt(density[(f >= band[0]) & (f <= band[1])].sum() * f[1]))


def stiffness_rows(fit: Stiffness) -> list[list[str]]:
    """Return the cells of a table with the headings `HEADS`, a row per joint and level."""
    robot, rows = fit.side.robot, list[list[str]]()
    for i in range(robot.n):
        for level in fit.levels:
            called, damping = level.identifiable[i], level.drives.damping[i]
            rows.append([
                f"{i + 1}", f"{level.swing[i]:.3g}", f"{level.spring[i]:.3g}",
                quantity(level.stiffness[i], unit_of("stiffness", robot.joint_types[i])) if called else "-",
                _per_cent(level.deviation[i]) if called else "", _per_cent(level.absolute[i]) if called else "",
                f"{damping:.3g}" if called and damping > 0.0 else "-", f"{level.antiresonance[i]:.3g}",
            ])  # fmt: skip
    return rows


def stiffness_notes(fit: Stiffness) -> list[str]:
    """Return remarks on a result."""
    late = [f"{1e3 * x.delay:.3f} +- {1e3 * NORMAL_95 * x.delay_deviation:.2g} ms" for x in fit.levels]
    pose = ", ".join(f"{x:.3g}" for x in fit.side.pose)
    return [
        f"positions lag the torques by {' and '.join(late)} at the two levels",
        f"stiffness holds for the spring's torque in the table (RMS), about gravity at the pose {pose}: the spring "
        f"is nonlinear, so its stiffness depends on the torque",
        "95 %: links, position of the payload and torque constants as in the robot file; absolute: links within 6 %, "
        "torque constants within 5 %",
        "damping [N.m.s/rad or N.s/m] has no interval, and is - where the log does not determine it",
    ]


def scaled_robot(fit: Stiffness) -> tuple[Robot, list[str]]:
    """Return the robot whose identifiable springs have the identified stiffness at their torque, and remarks."""
    robot, scale, texts = fit.side.robot, np.ones(fit.side.robot.n), list[str]()
    sources = dict(robot.sources)
    for i in range(robot.n):
        level = fit.levels[fit.best(i)]
        if level.identifiable[i]:
            scale[i] = level.stiffness[i] / effective_stiffness(robot, fit.side.weight, level.spring)[i]
            width = f"+- {_per_cent(level.deviation[i])} (95 %)"
            for name in ("K_f0", "K_w0"):
                sources[f"joints[{i + 1}].drive.{name}"] = (
                    f"scaled to {level.stiffness[i]:.4g} with motor-side logs, {width}"
                )
        else:
            texts.append(f"joint {i + 1} keeps the robot file's spring")
    made = robot.with_parameters(K_f0=robot.K_f0 * scale, K_w0=robot.K_w0 * scale)
    return replace(made, sources=sources), texts


@style.styled
def draw_responses(fit: Stiffness, title: str) -> Picture:
    """Draw the measured and fitted response of each rotor to its own torque, with others held, at the higher level."""
    level, n = fit.levels[-1], fit.side.robot.n
    columns = min(n, 3)
    words = (
        "Response of a rotor to its own torque, other rotors held. Points: measured, without the fitted friction and "
        "the motion of other joints. Line: the fit. Minima are antiresonances; the dashed line is that of the joint."
    )
    figure = style.new_figure(title, words, height=1.0 + 2.4 * -(-n // columns), width=10.0)
    for i, kind in enumerate(fit.side.robot.joint_types):
        axes = figure.add_subplot(-(-n // columns), columns, i + 1)
        colour = style.joint_look(i)["color"]
        axes.loglog(level.f, np.abs(level.measured[:, i]), ".", color=colour, markersize=3.0, alpha=0.6)
        axes.loglog(level.f, np.abs(level.fitted[:, i]), color="black", linewidth=0.9)
        called = level.identifiable[i]
        more = quantity(level.stiffness[i], unit_of("stiffness", kind)) if called else "not identifiable"
        axes.set_title(f"Joint {i + 1}: {more}", fontsize=9.0)
        if level.antiresonance[i] <= level.f[-1]:
            axes.axvline(level.antiresonance[i], color="#888888", linewidth=0.7, linestyle="--")
        axes.set_ylabel("rad/(N.m)" if kind == "revolute" else "m/N")
        if i >= n - columns:
            axes.set_xlabel("frequency [Hz]")
    return figure


def stiffness_page(
    title: str, judged: dict[str, Any], rows: Sequence[Sequence[str]], notes: Sequence[str], pictures: Sequence[Picture]
) -> bytes:
    """Return a page without other files: the verdict, the table, remarks and pictures."""
    checks = [[f"{SIGNS[each.state]} {each.state}", escape(each.text)] for each in checks_of(judged)]
    body = [table(["", ""], checks, ["name", ""])]
    if rows:
        heads = [escape(each).replace("\n", "<br>") for each in HEADS]
        body.append(
            f'<div class="wide">{table(heads, [[*map(escape, row)] for row in rows], ["value"] * len(HEADS))}</div>'
        )
    body += [f"<p>{escape(note)}.</p>" for note in notes]
    for picture in pictures:
        with temporary_folder("vdfmu_") as folder:
            data = base64.b64encode(style.save(picture, Path(folder) / "picture.png").read_bytes()).decode()
        body.append(f'<img alt="Frequency responses" src="data:image/png;base64,{data}">')
    return page(title, headline_of(judged), "\n".join(body), 62)


def _per_cent(deviation: float) -> str:
    return f"{100.0 * NORMAL_95 * deviation:.2g} %"


def design_rows(plan: StiffnessExperiment) -> list[list[str]]:
    """Return the cells of an experiment's table, a row per joint."""
    return [
        [f"{i + 1}", f"{plan.antiresonance[i]:.3g}", f"{plan.rate[i]:.4g}", f"{plan.breakaway[i]:.3g}",
         f"{plan.torque[i]:.3g}", f"{plan.speed[i]:.2g}", f"{plan.travel[i]:.2g}"]
        for i in range(len(plan.pose))
    ]  # fmt: skip


DESIGN_HEADS = (
    "joint",
    "antiresonance\nHz",
    "min. rate\nHz",
    "breakaway\nN.m",
    "torque, RMS\nN.m",
    "peak speed",
    "travel",
)
