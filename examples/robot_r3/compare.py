"""The robot r3 compared with its published reference trajectories: numbers per joint and a figure.

    python examples/robot_r3/compare.py FullRobot.csv

FullRobot.csv is in the repository MAP-LIB_ReferenceResults of the Modelica Association, under
Modelica/Mechanics/MultiBody/Examples/Systems/RobotR3/FullRobot.
"""

import csv
from argparse import ArgumentParser, RawDescriptionHelpFormatter
from pathlib import Path

import numpy as np

import vdfmu
from vdfmu.extras.pictures import style

NAMES = {"position": "rad", "motor current": "A", "gear deflection, motor-side": "rad"}
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


@style.styled
def draw(t, signals):
    """Draw name, unit, ours and theirs over each other (m, n) of each signal, and their difference."""
    words = (
        "Wide: the library's published trajectories; thin and dashed: this scenario. Right: this scenario minus those."
    )
    figure = style.new_figure("The robot r3 of the Modelica Standard Library", words, width=11.0, height=8.0)
    panels = figure.subplots(len(signals), 2).ravel().tolist()
    for k, (name, unit, here, there) in enumerate(signals):
        left, right = panels[2 * k : 2 * k + 2]
        for i in range(here.shape[1]):
            look = style.joint_look(i)
            style.curve(left, t, there[:, i], **look, linewidth=3.0, alpha=0.5)
            style.curve(left, t, here[:, i], **{**look, "linestyle": (0, (5, 3))}, linewidth=1.1)
            style.curve(right, t, here[:, i] - there[:, i], **look)
        style.dress(left, name.capitalize(), "", unit, t)
        style.dress(right, "Difference", "", unit, t)
    style.label_time(panels, 2)
    style.legend_beside(panels[1], style.joint_handles(range(6)))
    return figure


def main(path):
    """Print the differences and draw positions, currents and differences."""
    time, *theirs = published(path)
    t, *ours = simulated(out="results/robot_r3", reference=False)
    inside = t <= time[-1]
    t = t[inside]
    signals = []
    for (name, unit), here, there in zip(NAMES.items(), ours, theirs, strict=True):
        here = here[inside]
        reference = np.column_stack([np.interp(t, time, signal) for signal in there.T])
        difference = here - reference
        signals.append((name, unit, here, reference))
        print(f"{f'{name} [{unit}]':36}{'largest':>10}{'difference':>12}{'rms':>10}")
        for i in range(here.shape[1]):
            largest, rms = np.abs(difference[:, i]).max(), np.sqrt(np.mean(difference[:, i] ** 2))
            print(f"  joint {i + 1:<28}{np.abs(reference[:, i]).max():10.4g}{largest:12.2e}{rms:10.1e}")
    style.save(draw(t, signals), Path("results/robot_r3/comparison.png"))
    print("Written to results/robot_r3: comparison.png")


if __name__ == "__main__":
    parser = ArgumentParser(description=__doc__, formatter_class=RawDescriptionHelpFormatter)
    parser.add_argument("file")
    main(parser.parse_args().file)
