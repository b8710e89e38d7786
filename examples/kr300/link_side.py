"""Link positions of the KR 300 from motor-side measurements: a Kalman filter against the second encoders.

    python examples/kr300/link_side.py [PICTURE]

The arm and its springs are those identified from record A. The filter is causal and reads only torques and positions of
the motors. Its states for each axis are the positions and speeds of link and rotor, and a slowly drifting friction
torque that the model does not describe. Its two noise levels were chosen with record A, so record B is a prediction.
The reference is the second encoders: they have a constant delay and count from their start, so both constants are
removed.
"""

import sys
from itertools import product
from pathlib import Path

import numpy as np
from scipy.interpolate import CubicSpline
from scipy.linalg import expm, solve_discrete_are
from scipy.signal import butter, sosfiltfilt

import vdfmu
from vdfmu.arm.equations.friction import stribeck_friction
from vdfmu.arm.equations.harmonic_drive import deformation, deformation_derivative
from vdfmu.dynamics import gravity_torque, inverse_dynamics, mass_matrix
from vdfmu.extras.identify import read_log
from vdfmu.extras.pictures import style

HERE = Path(__file__).parent
DELAYS = (3.07e-3, 3.05e-3, 3.01e-3)
"""Of the second encoders [s], as `vdfmu identify` finds them in A."""
OFF = 20.0
"""Band [Hz] of the comparison: above are ripples of gear and encoder."""
DRIFTS, LOADS = (0.3, 3.0, 30.0), (3.0, 10.0, 30.0, 100.0)
"""Tried noises: drift of the friction [N.m/sqrt(s)], and error of the link's torque [N.m/sqrt(Hz)]."""
RESOLUTION = 1e-6
"""Standard deviation of the motor's position, link-side [rad]."""


def stiffness(robot, torque):
    """Return the stiffness (n,) of the springs about a torque (n,)."""
    return 1.0 / np.asarray(deformation_derivative(robot, torque), dtype=float)


def bend(robot, torque):
    """Return deformations (3,) by torques (n,)."""
    return np.asarray(deformation(robot, torque), dtype=float)[:3]


def gains(robot, pose, step, drift, load):
    """Return the model (A, B) of each axis from one row to the next, and the gain of its filter."""
    M, J = np.diag(mass_matrix(robot, pose)), robot.I_m * robot.ell
    K = stiffness(robot, gravity_torque(robot, pose))
    models = []
    for i in range(3):
        A = np.zeros((5, 5))
        A[0, 1] = A[2, 3] = 1.0
        A[1, [0, 2]] = [-K[i] / M[i], K[i] / M[i]]
        A[3, [0, 2, 4]] = [K[i] / J[i], -K[i] / J[i], -1.0 / J[i]]
        B = np.zeros((5, 2))
        B[1, 0], B[3, 1] = -1.0 / M[i], 1.0 / J[i]
        both = expm(step * np.block([[A, B], [np.zeros((2, 7))]]))
        F, G = both[:5, :5], both[:5, 5:]
        noise = step * (np.outer(B[:, 0], B[:, 0]) * load**2 + np.diag([0, 0, 0, 0, drift**2])) + 1e-18 * np.eye(5)
        C = np.array([[0.0, 0.0, 1.0, 0.0, 0.0]])
        P = solve_discrete_are(F.T, C.T, noise, np.array([[RESOLUTION**2]]))
        gain = P @ C.T / (C @ P @ C.T + RESOLUTION**2)
        models.append((F, G, gain[:, 0]))
    return models


def filtered(robot, log, drift, load):
    """Return deformations (m, 3) by the filter."""
    models = gains(robot, log.kappa.mean(axis=0), log.step, drift, load)
    x = np.zeros((3, 5))
    x[:, 2] = log.kappa[0, :3]
    x[:, 0] = x[:, 2] - bend(robot, gravity_torque(robot, log.kappa[0]))
    bent, speed = np.zeros((len(log.t), 3)), np.zeros(robot.n)
    for k, kappa in enumerate(log.kappa):
        for i, (_, _, gain) in enumerate(models):
            x[i] += gain * (kappa[i] - x[i, 2])
        bent[k] = x[:, 2] - x[:, 0]
        if k:
            speed[3:] = (kappa - log.kappa[k - 1])[3:] / log.step
        speed[:3] = x[:, 1]
        weight = inverse_dynamics(robot, kappa, speed, np.zeros(robot.n))[:3]
        rotor = np.concatenate([x[:, 3], speed[3:]])
        push = (log.tau[k] * robot.ell - np.asarray(stribeck_friction(robot, rotor), dtype=float))[:3]
        for i, (F, G, _) in enumerate(models):
            x[i] = F @ x[i] + G @ [weight[i], push[i]]
    return bent


def static(robot, log):
    """Return deformations (m, 3) by gravity on the springs alone."""
    return np.array([bend(robot, gravity_torque(robot, each)) for each in log.kappa])


def measured(log):
    """Return deformations (m, 3) by the second encoders, without their delays."""
    links = [CubicSpline(log.t, log.q[:, i])(log.t + late) for i, late in enumerate(DELAYS)]
    return log.kappa[:, :3] - np.stack(links, axis=1)


def compared(signal, log):
    """Return a signal (m, 3) in the band, about its mean, without the ends."""
    low = sosfiltfilt(butter(4, OFF, fs=1.0 / log.step, output="sos"), signal, axis=0)[50:-50]
    return low - low.mean(axis=0)


def rms(signal):
    """Return root mean squares (3,) in microradians."""
    return 1e6 * np.sqrt((signal**2).mean(axis=0))


def main(picture=None):
    """Print the table, and draw the record B."""
    robot = vdfmu.load_robot("kr300_6dof")
    logs = {name.upper(): read_log(HERE / f"{name}.parquet", robot) for name in "ab"}
    real = {name: compared(measured(log), log) for name, log in logs.items()}
    tried = {
        noises: rms(real["A"] - compared(filtered(robot, logs["A"], *noises), logs["A"]))
        for noises in product(DRIFTS, LOADS)
    }
    best = min(tried, key=lambda noises: float((tried[noises] / rms(real["A"])).mean()))
    print(f"noises by record A: friction drifts {best[0]:g} N.m/sqrt(s), link's torque {best[1]:g} N.m/sqrt(Hz)")
    print("RMS of link position left [urad]   axis 1   axis 2   axis 3")
    shown = {}
    for name, log in logs.items():
        ways = {"rotor over ratio": 0.0 * real[name], "static spring": compared(static(robot, log), log)}
        ways["Kalman filter"] = compared(filtered(robot, log, *best), log)
        for way, bent in ways.items():
            left = rms(real[name] - bent)
            print(f"{name}  {way:28}" + "".join(f"{each:9.1f}" for each in left))
        shown[name] = ways
    if picture:
        style.save(draw(logs["B"].t[50:-50], real["B"], shown["B"]), Path(picture))


@style.styled
def draw(t, real, ways):
    """Draw deformations of record B."""
    words = "Deflections below 20 Hz about their mean, by the second encoders and by two models from the motors' side."
    figure = style.new_figure("KR 300, record B: motor minus link", words, height=6.0)
    for i in range(3):
        axes = figure.add_subplot(3, 1, i + 1)
        axes.plot(t, 1e6 * real[:, i], color="black", linewidth=0.9, label="second encoder")
        for (name, bent), look in zip(list(ways.items())[1:], ("--", "-"), strict=True):
            axes.plot(t, 1e6 * bent[:, i], look, color=style.joint_look(i)["color"], linewidth=0.9, label=name)
        axes.set_ylabel(f"axis {i + 1} [µrad]")
        axes.legend(loc="upper right", fontsize=7.0, ncols=3)
    axes.set_xlabel("time [s]")
    return figure


if __name__ == "__main__":
    main(*sys.argv[1:])
