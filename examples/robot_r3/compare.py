"""The robot r3 compared with its published reference trajectories: numbers per joint and a figure.

    python examples/robot_r3/compare.py FullRobot.csv

FullRobot.csv is in the repository MAP-LIB_ReferenceResults of the Modelica Association, under
Modelica/Mechanics/MultiBody/Examples/Systems/RobotR3/FullRobot.
"""

import csv
import sys
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np

import vdfmu

ROTATION = (-1, 1, 1, -1, 1, -1)
"""Directions in which the motors turn: signs of the library's gear ratios."""


def published(path):
    """Return time and signals of the library's file: position, current, deflection of the gears 1 to 3 (m, n)."""
    with open(path, newline="") as file:
        heads, *rows = csv.reader(file)
    table = dict(zip(heads, np.array(rows, dtype=float).T, strict=True))

    def columns(pattern, joints):
        return np.column_stack([table[pattern.format(i)] for i in joints])

    return (
        table["time"],
        columns("mechanics.r{}.phi", range(1, 7)),
        columns("axis{}.motor.La.i", range(1, 7)),
        columns("axis{}.gear.spring.phi_rel", range(1, 4)),
    )


def simulated(**options):
    """Run the scenario; return time and the same signals, with the library's signs."""
    results = vdfmu.run(Path(__file__).with_name("scenario.toml"), overwrite=True, **options)
    ell = vdfmu.load_robot(Path(__file__).with_name("robot.toml")).ell
    q = results["plant.q"]
    deflection = ROTATION * ell * (q - results["plant.kappa"])
    return results.time, q, ROTATION * results["axis.i"], deflection[:, :3]


def main(path):
    """Print the differences and draw positions, currents and differences."""
    time, *theirs = published(path)
    t, *ours = simulated(out="results/robot_r3", reference=False)
    inside = t <= time[-1]
    t = t[inside]
    names = ("position [rad]", "motor current [A]", "gear deflection, motor-side [rad]")
    figure, axes = plt.subplots(3, 2, figsize=(11, 9), sharex=True)
    for name, here, there, row in zip(names, ours, theirs, axes, strict=True):
        here = here[inside]
        reference = np.column_stack([np.interp(t, time, signal) for signal in there.T])
        difference = here - reference
        print(f"{name:36}{'largest':>10}{'difference':>12}{'rms':>10}")
        for i in range(here.shape[1]):
            largest, rms = np.abs(difference[:, i]).max(), np.sqrt(np.mean(difference[:, i] ** 2))
            print(f"  joint {i + 1:<28}{np.abs(reference[:, i]).max():10.4g}{largest:12.2e}{rms:10.1e}")
        for i, (one, other, d) in enumerate(zip(here.T, reference.T, difference.T, strict=True)):
            (line,) = row[0].plot(t, other, lw=2.5, alpha=0.35)
            row[0].plot(t, one, lw=0.9, color=line.get_color(), label=f"joint {i + 1}")
            row[1].plot(t, d, lw=0.9, color=line.get_color())
        row[0].set_ylabel(name)
        row[1].set_ylabel("difference")
    axes[0, 0].set_title("wide: published; thin: this scenario", fontsize=10)
    axes[0, 0].legend(ncols=3, fontsize=8)
    for axis in axes[-1]:
        axis.set_xlabel("time [s]")
    figure.tight_layout()
    figure.savefig("results/robot_r3/comparison.png", dpi=110)
    print("Written to results/robot_r3: comparison.png")


if __name__ == "__main__":
    main(sys.argv[1])
