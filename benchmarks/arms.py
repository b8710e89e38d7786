"""The shipped arms: what they are, and how the first motion of each goes."""

from __future__ import annotations

import numpy as np

from benchmarks.report import Report, Table
from benchmarks.system import packed
from vdfmu.arm.robot import load_robot, robot_names
from vdfmu.engine.run import simulate
from vdfmu.study.analysis.loops import margins_along
from vdfmu.study.analysis.modes import natural_modes

TITLE = "The shipped arms"


def run(report: Report, quick: bool = False) -> None:
    """Describe each arm, and run `reach` with it."""
    from vdfmu.extras.robots.reach import reach_scenario

    table = Table(
        "arms", TITLE,
        [("robot", "s"), ("joints", "d"), ("mass [kg]", ".3g"), ("lowest mode [Hz]", ".3g"), ("step [ms]", "g"),
         ("margin", ".2f"), ("delay margin [samples]", ".2f"), ("margin, one sample late", ".2f"),
         ("motion [s]", ".3g"), ("largest error", ".1e")],
        notes=["Modes with held motors where the motion starts; errors in rad or m."],
    )  # fmt: skip
    for name in ("planar_2dof", "scara_4dof") if quick else robot_names():
        report.say(name)
        robot, scenario = load_robot(name), reach_scenario(name)
        motion = scenario.sections["trajectory"]
        with packed(scenario, "native") as package:
            results = simulate(package, stop=scenario.stop, step=scenario.step)
        loops, late = (margins_along(scenario, algorithm=m).judged.loops for m in ("gauss-seidel", "jacobi"))
        delay = loops.delay()
        table.add(
            name, robot.n, float(robot.mass.sum()),
            natural_modes(robot, motion["q_start"], motors="held").frequency[0],
            1e3 * scenario.step, float(loops.modulus.min()), delay.samples if delay else np.inf,
            float(late.modulus.min()), float(motion["T"]),
            float(np.abs(results["trajectory.q_d"] - results["plant.q"]).max()),
        )  # fmt: skip
    report.show(table)
