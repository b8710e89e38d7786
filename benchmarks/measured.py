"""vdfmu beside what others published: ``python -m benchmarks.measured --modelica A --panda B --ur10e C --tx40 D``.

The folders are checkouts of public repositories, named in docs/measured.md; nothing of them is shipped. The results of
Modelica tools are compared here with runs of vdfmu, the logs of robots in `benchmarks.measured_logs`.
"""

from __future__ import annotations

import argparse
import csv
import tempfile
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from rich.console import Console

import vdfmu
from benchmarks.measured_logs import panda, tx40, ur10e
from benchmarks.report import Report, Table
from vdfmu.arm.robot import Robot, robot_from_dict
from vdfmu.base.arrays import Floats
from vdfmu.base.toml_file import toml_text

EXAMPLE = Path(__file__).parents[1] / "examples" / "robot_r3"
"""The units of a robot of the Modelica Standard Library, with dampers parallel to the springs."""
STEP = 5e-4
"""Communication step of the gears [s]: their torques change by 0.3 % of their size in it, on lines."""
EPS = 1e-6
"""Width of the sign of friction [rad/s]: the slowest motion to be compared has 1e-3 rad/s."""


def one_joint(*, ell: float, J: float, inertia: float, K: float, dry: float, viscous: float, **load_loss: Any) -> Robot:
    """Return an arm of one joint without gravity, as a drive train of the Modelica library.

    Parameters
    ----------
    ell, J : ratio [-], and inertia before it [kg m2]
    inertia : behind the gear [kg m2]
    K : stiffness of the gear, link-side [N m/rad], shared by the two springs
    dry, viscous : friction before the gear [N m], [N m s/rad]
    """
    joint = {
        "type": "revolute", "rotation": np.eye(3).tolist(), "offset": [0.0] * 3,
        "link": {"mass": 1.0, "centroid": [0.0] * 3, "inertia": [inertia] * 3},
        "drive": {"ell": ell, "I_m": J * ell, "K_f0": 2 * K, "c_f": 1e-9, "K_w0": 2 * K / ell**2, "c_w": 1e-9},
        "friction": {"f_c": dry * ell, "f_s": dry * ell, "f_v": viscous * ell**2, "v_s": 0.1, "f_ck": 0.0, "eps": EPS},
    }  # fmt: skip
    whole = {"name": "one_joint", "description": "A drive train", "rotor_coupling": False, "gravity": [0.0] * 3}
    return robot_from_dict({**whole, "tool_offset": [0.0] * 3, "joints": [{**joint, **load_loss}]}, "one_joint")


def simulated(robot: Robot, sections: Mapping[str, Any], stop: float, step: float, inputs: Any = None) -> Any:
    """Run the units of the example, those that `sections` names, with their parameters."""
    with tempfile.TemporaryDirectory() as folder:
        system = EXAMPLE / "system.toml"
        if set(sections) == {"plant"}:
            system = Path(folder, "system.toml")
            plant = str(EXAMPLE / "damped.py")
            system.write_text(toml_text({"name": "gear", "description": "A gear", "components": {"plant": plant}}))
        head = {"name": "measured", "description": "One joint", "system": str(system), "stop": stop, "step": step}
        scenario = Path(folder, "scenario.toml")
        scenario.write_text(toml_text({**head, "algorithm": "extrapolated", "tolerance": 1e-8, **sections}))
        return vdfmu.run(scenario, robot=robot, inputs=inputs, out=Path(folder, "out"), reference=False)


def published(folder: Path, model: str) -> dict[str, Floats]:
    """Return the signals of a model of the Modelica library by name, from a checkout of MAP-LIB_ReferenceResults."""
    path = folder.joinpath("Modelica", "Mechanics", *model.split("."))
    with open(path / f"{path.name}.csv", newline="", encoding="utf-8") as file:
        heads, *rows = csv.reader(file)
    return dict(zip(heads, np.array(rows, dtype=float).T, strict=True))


def difference(t: Floats, ours: Floats, times: Floats, theirs: Floats) -> tuple[float, float, float, float]:
    """Return the range of their signal, the largest difference and its root mean square in % of it, and where [s]."""
    theirs = np.interp(t, times, theirs)
    size, error = float(np.ptp(theirs)), np.abs(ours - theirs)
    rms = float(np.sqrt(np.mean(error**2)))
    return size, 100.0 * float(error.max()) / size, 100.0 * rms / size, float(t[error.argmax()])


DIFFERENCE = (("range", ".3g"), ("largest difference [%]", ".2g"), ("rms [%]", ".2g"), ("largest at [s]", ".3f"))


def lossy_gears(report: Report, folder: Path) -> None:
    """LossyGearDemo1 and 2: two inertias and a gear of efficiency 0.5 both ways, driven by the same torques."""
    table = Table(
        "lossy_gear", "Load-dependent loss beside Modelica's LossyGear, efficiencies 0.5 and 0.5",
        [("model", "s"), ("mu_l", ".1f"), ("stretch", "s"), ("from [s]", ".4f"), ("to [s]", ".4f"), ("signal", "s"),
         *DIFFERENCE],
    )  # fmt: skip
    for model, dry, viscous in (("LossyGearDemo1", 0.0, 0.0), ("LossyGearDemo2", 0.5, 0.5)):
        theirs = published(folder, f"Rotational.Examples.{model}")
        t = theirs["time"]
        back = np.diff((theirs["gear.mode"] < 0.0).astype(int))
        first, last = t[1:][back < 0][0], t[1:][back > 0][-1]
        first, last = np.ceil(first / STEP) * STEP, np.floor(last / STEP) * STEP
        stretches = [(1.0, "all", 0.0, t[-1]), (0.5, "all", 0.0, t[-1]), (0.5, "driven back", 0.0, first),
                     (1.0, "stuck, driving, stuck", first, last), (0.5, "driven back", last, t[-1])]  # fmt: skip
        for mu, stretch, begin, end in stretches:
            report.say(f"{model}, mu_l {mu:g}, {begin:.4f} s to {end:.4f} s")
            loss = {"load_loss": {"mu_l": mu}}
            robot = one_joint(ell=2.0, J=1.0, inertia=1.5, K=1e7, dry=dry, viscous=viscous, **loss)
            t_run = np.arange(round((end - begin) / STEP) + 1) * STEP
            drive, load = 10.0 * np.sin(2.0 * np.pi * (begin + t_run)), -10.0 + 2.5 * (begin + t_run)
            inputs = {"plant.tau": (t_run, drive[:, None]), "plant.F_e": (t_run, np.outer(-load, np.eye(6)[5]))}
            start = [float(np.interp(begin, t, theirs["Inertia2.phi"]))]
            results = simulated(robot, {"plant": {"q_0": start, "d": 3e3}}, float(t_run[-1]), STEP, inputs)
            for signal, name in (("plant.q", "Inertia2.phi"), ("plant.q_dot", "Inertia2.w")):
                there = difference(begin + results.time, results[signal][:, 0], t, theirs[name])
                table.add(model, mu, stretch, begin, end, name, *there)
    report.show(table)


def one_axis(report: Report, folder: Path) -> None:
    """RobotR3.OneAxis: path, cascaded controller, motor with its circuit, elastic gear with friction, inertia."""
    theirs = published(folder, "MultiBody.Examples.Systems.RobotR3.OneAxis")
    ell = 210.0
    robot = one_joint(ell=ell, J=0.0013, inertia=1.14**2 * 15.0, K=8.0 * ell**2, dry=0.5, viscous=0.1 / 130.0)
    sections = {
        "path": {"q_start": [0.0], "q_end": [2.0 * np.pi / 3.0], "speed": [3.0], "acceleration": [10.0]},
        "axis": {"k_p": 5.0, "k_s": 0.5, "T_s": 0.05, "k": [1.1616], "w": [5500.0], "D": [0.6]},
        "plant": {"d": [0.01 * ell**2]},
    }
    results = simulated(robot, sections, 1.5, 1e-4)
    inside = results.time <= theirs["time"][-1]
    title = "One axis of a robot beside Modelica's RobotR3.OneAxis"
    table = Table("one_axis", title, [("signal", "s"), ("unit", "s"), *DIFFERENCE])
    for ours, unit, name in (
        (results["plant.q"], "rad", "axis.initializeFlange.phi_flange"),
        (results["plant.q_dot"], "rad/s", "axis.initializeFlange.w_flange"),
        (results["axis.i"], "A", "axis.motor.La.i"),
        (ell * (results["plant.q"] - results["plant.kappa"]), "rad", "axis.gear.spring.phi_rel"),
    ):
        table.add(name, unit, *difference(results.time[inside], ours[inside, 0], theirs["time"], theirs[name]))
    report.show(table)


def main(arguments: Sequence[str] | None = None) -> int:
    """Compare with what is in the folders; return the exit code."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.measured", description=__doc__)
    kinds = {"modelica": (lossy_gears, one_axis), "panda": (panda,), "ur10e": (ur10e,), "tx40": (tx40,)}
    for name in kinds:
        parser.add_argument(f"--{name}", type=Path, metavar="FOLDER", help="see docs/measured.md")
    parser.add_argument("--out", type=Path, default=Path("results/measured"), help="default %(default)s")
    options = vars(parser.parse_args(arguments))
    if not any(options[name] for name in kinds):
        parser.error("name at least one folder")
    options["out"].mkdir(parents=True, exist_ok=True)
    report = Report("measured", "What others measured", options["out"], Console())
    for name, steps in kinds.items():
        for step in steps if options[name] else ():
            step(report, options[name])
    report.write()
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
