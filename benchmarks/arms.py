"""The shipped arms: what they are, and how the first motion of each goes, from an empty cache."""

from __future__ import annotations

import json
import os
import subprocess
import sys
import tempfile
from typing import Any

import numpy as np

from benchmarks.report import Report, Table
from benchmarks.system import packed
from benchmarks.timing import processor_time
from vdfmu.arm.robot import Robot, load_robot, robot_names
from vdfmu.base.cache import COMPILER, cache_folder
from vdfmu.engine.run import simulate
from vdfmu.study.analysis.loops import margins_along
from vdfmu.study.analysis.modes import natural_modes
from vdfmu.study.analysis.reach import reach_scenario

TITLE = "The shipped arms"


def run(report: Report, quick: bool = False) -> None:
    """Describe each arm, and run `reach` with it in a separate process whose cache is empty."""
    table = Table(
        "arms", TITLE,
        [("robot", "s"), ("joints", "d"), ("mass [kg]", ".3g"), ("length [m]", ".3g"), ("lowest mode [Hz]", ".3g"),
         ("step [ms]", "g"), ("margin", ".2f"), ("delay margin [samples]", ".2f"), ("margin, one sample late", ".2f"),
         ("motion [s]", ".3g"), ("largest error", ".1e"), ("final error", ".1e"), ("build [s]", ".0f"),
         ("processor [s/s]", ".2g")],
    )  # fmt: skip
    for name in ("planar_2dof", "scara_4dof") if quick else robot_names():
        report.say(name)
        robot, scenario = load_robot(name), reach_scenario(name)
        motion = scenario.sections["trajectory"]
        ran = _child(name)
        loops, late = (margins_along(scenario, algorithm=m).judged.loops for m in ("gauss-seidel", "jacobi"))
        delay = loops.delay()
        table.add(
            name, robot.n, float(robot.mass.sum()), _length(robot),
            natural_modes(robot, motion["q_start"], motors="held").frequency[0],
            1e3 * scenario.step, float(loops.modulus.min()), delay.samples if delay else np.inf,
            float(late.modulus.min()), float(motion["T"]), ran["largest"], ran["final"], ran["build"], ran["second"],
        )  # fmt: skip
    table.notes.append("Modes with held motors where the motion starts; errors in rad or m; times are processor times.")
    report.show(table)


def _length(robot: Robot) -> float:
    """Length of the arm from its first axis to the end effector, along the links, at q = 0 [m]."""
    return float(np.linalg.norm(robot.offset[1:], axis=1).sum() + np.linalg.norm(robot.tool_offset))


def _child(name: str) -> Any:
    """Return what :func:`_ran` finds in a separate process with an empty cache."""
    support = os.environ.get("ZIG_GLOBAL_CACHE_DIR", str(cache_folder() / COMPILER))
    with tempfile.TemporaryDirectory() as cache:
        variables = os.environ | {"ZIG_GLOBAL_CACHE_DIR": support, "VDFMU_CACHE_DIR": cache}
        command = [sys.executable, "-m", "benchmarks.arms", name]
        return json.loads(subprocess.run(command, env=variables, check=True, stdout=subprocess.PIPE).stdout)


def _ran(name: str) -> dict[str, float]:
    """Build and run the first motion: processor times [s] of the build and of a simulated second, and errors."""
    scenario, began = reach_scenario(name), processor_time()
    with packed(scenario, "native") as package:
        built = processor_time()
        results = simulate(package, stop=scenario.stop, step=scenario.step)
        ended = processor_time()
    error = np.abs(results["trajectory.q_d"] - results["plant.q"])
    return {
        "build": built - began, "second": (ended - built) / float(results.time[-1]),
        "largest": float(error.max()), "final": float(error[-1].max()),
    }  # fmt: skip


if __name__ == "__main__":
    print(json.dumps(_ran(sys.argv[1])))
