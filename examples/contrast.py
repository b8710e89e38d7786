"""Section IV-A of the paper: joint torques by virtual decomposition and by Newton-Euler, compared with its Table 3.

    python examples/contrast.py [FOLDER]

The two formulations share no line of code. The third column shows one reading of Table 3: the difference that a gravity
constant of 9.80 instead of 9.81 m/s2 makes. The other reading is a thousandth of the torques themselves.
"""

import sys
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np

import vdfmu
from vdfmu.arm.equations.trajectory import desired_motion
from vdfmu.arm.kernel import Kernel

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


def draw(time, vd, newton_euler, low, folder):
    """Write the figures 7 and 8 of the paper."""
    figure, axes = plt.subplots(2, 3, figsize=(11, 6), sharex=True, layout="constrained")
    for i, panel in enumerate(axes.flat):
        panel.plot(time, vd[:, i], lw=3, label="virtual decomposition")
        panel.plot(time, newton_euler[:, i], "k--", lw=1, label="Newton-Euler")
        panel.set(title=f"Joint {i + 1}", xlabel="Time [s]", ylabel="Torque [N.m]")
    axes[0, 0].legend(fontsize=8)
    figure.savefig(folder / "figure_7.png", dpi=110)
    figure, (rounding, gravity, bars) = plt.subplots(3, 1, figsize=(8, 9), layout="constrained")
    for i in range(6):
        rounding.semilogy(time, 1e3 * np.abs(vd - newton_euler)[:, i], ".", ms=2, label=f"Joint {i + 1}")
        gravity.plot(time, 1e3 * (vd - low)[:, i])
    shown = {"g = 9.81 minus g = 9.80": 1e3 * rms(vd - low), "Table 3": TABLE_3, "1e-3 of the torque": rms(vd)}
    for k, (label, heights) in enumerate(shown.items()):
        bars.bar(np.arange(1, 7) + 0.27 * (k - 1), heights, width=0.25, label=label)
    rounding.set(title="Virtual decomposition minus Newton-Euler: rounding", xlabel="Time [s]", ylabel="N.mm")
    gravity.set(title="g = 9.81 minus g = 9.80", xlabel="Time [s]", ylabel="N.mm")
    bars.set(title="RMS, Table 3, and 1e-3 of the RMS torque", xlabel="Joint", ylabel="N.mm")
    rounding.legend(fontsize=8, ncols=6)
    bars.legend(fontsize=8)
    figure.savefig(folder / "figure_8.png", dpi=110)


def main(folder="results/contrast"):
    """Print the RMS values next to Table 3 and draw the figures."""
    time, vd, newton_euler, low = torques()
    columns = (rms(vd), 1e3 * rms(vd - newton_euler), 1e3 * rms(vd - low), TABLE_3)
    print("joint  torque N.m  VD - NE N.mm  g 9.81 - 9.80 N.mm  Table 3 N.mm")
    for i, row in enumerate(zip(*columns, strict=True)):
        print("{:5}{:12.3g}{:14.2g}{:20.3g}{:14}".format(i + 1, *row))
    Path(folder).mkdir(parents=True, exist_ok=True)
    draw(time, vd, newton_euler, low, Path(folder))
    print(f"Written to {folder}: figure_7.png, figure_8.png")


if __name__ == "__main__":
    main(*sys.argv[1:])
