"""Section IV-A of the paper: joint torques by virtual decomposition and by Newton-Euler, compared with its Table 3.

    python examples/contrast.py [FOLDER]

The two formulations share no line of code. The third column shows one explanation of Table 3: the difference that a
gravity constant of 9.80 instead of 9.81 m/s2 makes. The other explanation is a thousandth of the torques themselves.
"""

from argparse import ArgumentParser, RawDescriptionHelpFormatter
from pathlib import Path

import numpy as np
from matplotlib.lines import Line2D

import vdfmu
from vdfmu.arm.equations.trajectory import desired_motion
from vdfmu.arm.kernel import Kernel
from vdfmu.extras.pictures import style

Q_END = np.radians([90, 60, 60, 90, 60, 90])
T, STEP = 10.0, 1e-3
TABLE_3 = (0.2, 22.7, 8.9, 0.6, 2.3, 0.0)
"""RMS of the differences between the paper's two programs [N mm]."""
LOW_GRAVITY = 9.80 / 9.81


def torques():
    """Return time [s] and the joint torques along Eq. (57), each (m, 6) [N m].

    By virtual decomposition, Eq. (44)-(47); by Newton-Euler; by Newton-Euler with the lower gravity.
    """
    arm = vdfmu.load_robot("manipulator_6dof")
    time = STEP * np.arange(round(T / STEP) + 1)
    desired = [desired_motion(t, np.zeros(6), Q_END, T) for t in time]
    motion = (*(np.array([getattr(d, name) for d in desired]) for name in ("q_d", "q_d_dot", "q_d_ddot")), np.zeros(6))
    low = arm.with_parameters(gravity=LOW_GRAVITY * arm.gravity)
    cases = ((arm, "inverse_dynamics"), (arm, "newton_euler"), (low, "newton_euler"))
    return time, *(Kernel(robot).rows(name, motion, (6, 6, 6, 6)) for robot, name in cases)


def rms(values):
    """Return the RMS value over the motion for each joint."""
    return np.sqrt(np.mean(values**2, axis=0))


@style.styled
def figure_7(time, vd, newton_euler):
    """Draw the torques of both formulations in the same axes."""
    looks = {"virtual decomposition": style.BACK, "Newton-Euler": style.ON_TOP}
    handles = [Line2D([], [], label=label, **look) for label, look in looks.items()]
    words = "As figure 7 of the paper: the rigid arm along Eq. (57)."
    figure = style.new_figure("Torques by two formulations", words, width=10.5, height=5.4, legend=handles)
    panels = figure.subplots(2, 3).ravel().tolist()
    for i, axes in enumerate(panels):
        for values, look in zip((vd, newton_euler), looks.values(), strict=True):
            style.curve(axes, time, values[:, i], **look)
        style.dress(axes, f"Joint {i + 1}", "Torque" if i % 3 == 0 else "", "N.m", time)
    style.label_time(panels, 3)
    return figure


@style.styled
def figure_8(time, vd, newton_euler, low):
    """Draw the differences of both formulations, and of both gravity constants, next to the paper's Table 3."""
    figure = style.new_figure("Differences of two formulations", "As figure 8 of the paper.", height=8.2)
    rounding, gravity, bars = figure.subplots(3, 1)
    for i in range(6):
        look = {"color": style.joint_look(i)["color"]}
        rounding.semilogy(time, np.abs(vd - newton_euler)[:, i], ".", ms=2, **look)
        style.curve(gravity, time, (vd - low)[:, i], **look)
    style.dress(rounding, "Virtual decomposition minus Newton-Euler: rounding", "", "N.m", time)
    style.dress(gravity, "g = 9.81 minus g = 9.80", "", "N.m", time)
    style.label_time([rounding, gravity], 1)
    style.legend_beside(rounding, style.joint_handles(range(6)))
    shown = {"g = 9.81 minus 9.80": rms(vd - low), "Table 3": 1e-3 * np.array(TABLE_3), "torque / 1000": 1e-3 * rms(vd)}
    for k, (label, heights) in enumerate(shown.items()):
        bars.bar(np.arange(1, 7) + 0.27 * (k - 1), heights, width=0.25, label=label, color=style.COLORS[(5, 6, 4)[k]])
    style.dress(bars, "RMS, Table 3, and a thousandth of the RMS torque", "", "N.m")
    bars.set_xlabel("Joint")
    style.legend_beside(bars, bars.containers)
    return figure


def main(folder):
    """Print the RMS values next to Table 3 and draw the figures."""
    time, vd, newton_euler, low = torques()
    columns = (rms(vd), 1e3 * rms(vd - newton_euler), 1e3 * rms(vd - low), TABLE_3)
    print("joint  torque N.m  VD - NE N.mm  g 9.81 - 9.80 N.mm  Table 3 N.mm")
    for i, row in enumerate(zip(*columns, strict=True)):
        print("{:5}{:12.3g}{:14.2g}{:20.3g}{:14}".format(i + 1, *row))
    style.save(figure_7(time, vd, newton_euler), Path(folder, "figure_7.png"))
    style.save(figure_8(time, vd, newton_euler, low), Path(folder, "figure_8.png"))
    print(f"Written to {folder}: figure_7.png, figure_8.png")


if __name__ == "__main__":
    parser = ArgumentParser(description=__doc__, formatter_class=RawDescriptionHelpFormatter)
    parser.add_argument("folder", nargs="?", default="results/contrast")
    main(parser.parse_args().folder)
