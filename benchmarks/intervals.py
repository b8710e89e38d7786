"""How often the intervals of `identify` hold the truth: simulated logs of several arms with white and coloured noise.

    python -m benchmarks.intervals [LOGS]

LOGS simulated logs (default 40) of three arms, half with white noise on the torques, half with noise that a low-pass
filter of 0.1 s has coloured. For each kind of parameter the table has the share of intervals, of parameters that are
not weak, that hold the truth, and the 95 % confidence interval of this share, with the logs as independent samples. It
ends with exit code 1 if a share is below 85 % or 95 % is not within its interval.
"""

from __future__ import annotations

import sys
from collections import defaultdict

import numpy as np
from rich.console import Console
from scipy.signal import lfilter

import vdfmu
from benchmarks.report import Table
from vdfmu.arm.motion import Motion
from vdfmu.arm.robot import Robot
from vdfmu.extras.identify.excitation import multisine
from vdfmu.extras.identify.fit import Identified, identify
from vdfmu.extras.identify.log import Log
from vdfmu.extras.identify.motion_choice import SensorNoise, exact_log

ARMS = ("planar_2dof", "slider_3dof", "scara_4dof")
STEP, PERIOD, NOISE, CORRELATED = 0.004, 12.0, 0.01, 0.1
"""Step of the log [s], period of its motion [s], noise over the largest torque, and time that colours the noise [s]."""
SHARES = {"I_m": 0.2, "f_c": 0.3, "f_s": 0.1, "v_s": 0.3, "f_v": 0.3, "K_f0": 0.2, "c_f": 0.2, "K_w0": 0.2, "c_w": 0.2}
"""Deviations of the logarithms of the values of a robot file from the truth."""


def motion_of(robot: Robot) -> Motion:
    """Return a multisine about the middle of the joints' ranges."""
    size = np.where([kind == "revolute" for kind in robot.joint_types], 0.8, 0.1)
    return multisine(np.zeros(robot.n), size, [1, 2, 5, 9], period=PERIOD, periods=2, phases="random")


def simulated(log: Log, robot: Robot, seed: int, coloured: bool) -> Log:
    """Return a log as the encoders and the noise of the torques give it."""
    dice = np.random.default_rng(seed)
    noise = dice.standard_normal(log.tau.shape)
    if coloured:
        pole = float(np.exp(-STEP / CORRELATED))
        noise = lfilter([np.sqrt(1.0 - pole**2)], [1.0, -pole], noise, axis=0)
    zeros = dice.uniform(0.0, 1e-3, (2, robot.n))  # of the encoders, more than their steps
    shifted = log._replace(kappa=log.kappa + zeros[0], q=log.q + zeros[1])
    measured = SensorNoise(step=STEP).measured(shifted, robot)
    return measured._replace(
        kappa=measured.kappa - zeros[0],
        q=measured.q - zeros[1],
        tau=log.tau + NOISE * np.abs(log.tau).max(axis=0) * noise,
    )


def start_of(robot: Robot, seed: int) -> Robot:
    """Return a robot file that is as far off as its errors say."""
    dice = np.random.default_rng(1000 + seed)
    values = {name: getattr(robot, name) * np.exp(s * dice.standard_normal(robot.n)) for name, s in SHARES.items()}
    values["f_s"] = np.maximum(values["f_s"], values["f_c"])
    return robot.with_parameters(**values, mass=robot.mass * np.exp(0.1 * dice.standard_normal(robot.n)))


def held(fit: Identified, robot: Robot) -> dict[str, list[bool | None]]:
    """Return whether the interval of each parameter holds the truth, by kind; None for those that are weak."""
    low, high = fit.interval()
    kinds: dict[str, list[bool | None]] = defaultdict(list)
    for name, true, a, b in zip(fit.names, fit.of(robot), low, high, strict=True):
        if name not in fit.held and name not in ("delay_tau",):
            kind = "links" if name in fit.base.names else name.partition("[")[0]
            kinds[kind].append(None if name in fit.weak else bool(a <= true <= b))
    return kinds


def main(logs: int) -> int:
    """Print the table; return the exit code."""
    arms = {name: vdfmu.load_robot(name) for name in ARMS}
    exact = {name: exact_log(robot, motion_of(robot), STEP) for name, robot in arms.items()}
    shares: dict[str, list[float]] = defaultdict(list)
    weak: dict[str, list[bool]] = defaultdict(list)
    for seed in range(logs):
        name = ARMS[seed % len(ARMS)]
        robot = arms[name]
        fit = identify(simulated(exact[name], robot, seed, seed % 2 == 1), start_of(robot, seed))
        for kind, each in held(fit, robot).items():
            weak[kind] += [value is None for value in each]
            if strong := [value for value in each if value is not None]:
                shares[kind].append(float(np.mean(strong)))
    table = Table(
        "intervals", "Intervals that hold the truth",
        [("parameter", ""), ("logs", "d"), ("inside", ".1%"), ("from", ".1%"), ("to", ".1%"), ("weak", ".0%")],
    )  # fmt: skip
    missed = False
    for kind, marks in weak.items():
        each = np.array(shares[kind])
        if not len(each):
            table.add(kind, 0, None, None, None, np.mean(marks))
            continue
        dice = np.random.default_rng(0)
        means = dice.choice(each, (2000, len(each))).mean(axis=1)
        low, high = np.quantile(means, (0.025, 0.975))
        # logs that all hold the truth say no more than that less than 3 / logs miss it
        high = max(high, 1.0) if each.min() == 1.0 else high
        missed |= each.mean() < 0.85 or high < 0.95
        table.add(kind, len(each), each.mean(), low, high, np.mean(marks))
    table.show(Console())
    return int(missed)


if __name__ == "__main__":
    sys.exit(main(int(sys.argv[1]) if sys.argv[1:] else 40))
