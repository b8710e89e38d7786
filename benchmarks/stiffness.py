"""How often the intervals of `identify --for stiffness` hold the truth: simulated logs of arms with bristle friction.

    python -m benchmarks.stiffness [LOGS]

LOGS simulated logs (default 60) of the excitation of `identify --design`, of four arms in turn, three of them with
rotor coupling. Plants have bristles, dampers beside the springs, stiffnesses of 0.7 to 1.4, friction of 0.5 to 2 and
rotors of 0.95 to 1.05 times those of the robot file, and a payload that is unknown. Encoders have 12 to 17 bits,
torques 0.5 % of noise. The truth is the regression of the spring's torque on its deformation in the simulation. The
exit code is 1 for a false call, an identifiable stiffness that is off by more than 10 %, if less than 85 % of the
intervals hold the truth, or if 95 % is not within the interval of this share.
"""

from __future__ import annotations

import dataclasses
import sys
from collections.abc import Sequence
from functools import cache
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from rich.console import Console

import vdfmu
from benchmarks.report import Table
from benchmarks.stiffness_plant import DampedPlant
from vdfmu.arm.robot import Robot
from vdfmu.arm.units.controller import PDController
from vdfmu.base.arrays import Floats
from vdfmu.dynamics import gravity_torque, mass_matrix
from vdfmu.extras.identify.log import Log
from vdfmu.extras.identify.motor_side import MotorSide
from vdfmu.extras.identify.periodic import PeriodicTorques
from vdfmu.extras.identify.stiffness import identify_stiffness
from vdfmu.extras.identify.stiffness_design import stiffness_experiment

ARMS = {"scara_4dof": 0.5, "slider_3dof": 0.5, "kr300_6dof": 50.0, "panda_7dof": 1.0}
"""Arms and their payloads [kg]; all but kr300_6dof have rotor coupling."""
RATES, BITS = (1000, 2000), (12, 13, 15, 17)
PLAYED = 2.5e-4
"""Step of the simulation [s], over which torques are held."""
FALSE = 0.1
"""Relative error of an identifiable stiffness that makes it a false call."""
FIRST = 100
"""First seed: the constants of the method were chosen with smaller ones."""


def robot_of(name: str) -> Robot:
    """Return the robot file: the shipped one with bristles and a payload."""
    robot = dataclasses.replace(vdfmu.load_robot(name), payload=True, bristles=True, limits=False)
    arm = np.array(robot.f_s)
    return robot.with_parameters(
        payload_mass=ARMS[name],
        payload_centroid=np.array([0.03, 0.0, 0.05]),
        sigma_0=arm / 2e-5,
        sigma_1=0.3 * arm / 2e-5 * 1e-3,
    )


@cache
def system_of(name: str, step: float) -> vdfmu.System:
    """Return the plant with its dampers, held by a soft controller to which the excitation is added."""
    joints = ("q", "q_dot", "kappa_dot")
    links = {f"plant.{name}": f"controller.{name}" for name in joints} | {"controller.tau": "plant.tau"}
    return vdfmu.connect(
        {"controller": PDController, "plant": DampedPlant},
        links,
        robot=robot_of(name),
        step=step,
        algorithm="gauss-seidel",
    )


def true_robot(name: str, dice: np.random.Generator) -> Robot:
    """Return the arm that is logged."""
    robot = robot_of(name)

    def factor(low: float, high: float) -> Floats:
        return np.exp(dice.uniform(np.log(low), np.log(high), robot.n))

    spring, dry = factor(0.7, 1.4), factor(0.5, 2.0)
    return robot.with_parameters(
        K_f0=robot.K_f0 * spring, K_w0=robot.K_w0 * spring, f_c=robot.f_c * dry, f_s=robot.f_s * dry,
        sigma_0=robot.sigma_0 * dry, sigma_1=robot.sigma_1 * dry, f_v=robot.f_v * factor(0.5, 2.0),
        I_m=robot.I_m * factor(0.95, 1.05), payload_mass=ARMS[name] * dice.uniform(0.5, 1.5),
    )  # fmt: skip


def played(name: str, true: Robot, plan: PeriodicTorques, pose: Floats, damping: Floats) -> Any:
    """Simulate the excitation about a pose."""
    B = true.I_m * true.ell + np.diag(mass_matrix(true, pose))
    slow = 2.0 * np.pi
    changed = ("K_f0", "K_w0", "f_c", "f_s", "sigma_0", "sigma_1", "f_v", "I_m")
    values: dict[str, Any] = {f"plant.{each}": getattr(true, each) for each in changed}
    values |= {
        "plant.payload_mass": float(true.payload_mass),
        "plant.q_0": pose,
        "plant.d": damping,
        "plant.tolerance": 1e-5,
    }
    values |= {"controller.K_p": B * slow**2, "controller.K_v": 1.4 * B * slow, "controller.q_d": pose}
    torque = plan.torque + gravity_torque(true, pose) / true.ell
    return system_of(name, PLAYED).run(
        stop=float(plan.t[-1]),
        step=PLAYED,
        parameters=values,
        inputs={"controller.tau_m": (plan.t, torque)},
        input_hold=True,
        record=("plant.kappa*", "plant.q*", "plant.tau_s*", "controller.tau*"),
    )


def measured(results: Any, robot: Robot, rate: int, bits: int, dice: np.random.Generator) -> Log:
    """Return what is logged of a simulation."""
    every = round(1.0 / rate / PLAYED)
    t, tau, kappa = (
        np.asarray(each)[::every] for each in (results.time, results["controller.tau"], results["plant.kappa"])
    )
    noise = 0.005 * np.abs(tau - tau.mean(axis=0)).max(axis=0)
    bit = 2.0 * np.pi / 2.0**bits / robot.ell
    steps = np.floor(kappa / bit + dice.random(robot.n)) * bit
    return Log("log", t, steps, tau + noise * dice.standard_normal(tau.shape), None)


def truth_of(results: Any, plan: PeriodicTorques) -> Floats:
    """Return the stiffness (levels, n): the regression of torques of springs on deformations in the used periods."""
    whole = len(plan.t) // plan.levels
    kappa, q, tau_s = (np.asarray(results[f"plant.{each}"])[: len(plan.t)] for each in ("kappa", "q", "tau_s"))
    rows = []
    for k in range(plan.levels):
        here = slice(k * whole, (k + 1) * whole)
        bent, torque = (each[here] - each[here].mean(axis=0) for each in (kappa - q, tau_s))
        rows.append((bent * torque).sum(axis=0) / (bent**2).sum(axis=0))
    return np.array(rows)


class Identified(NamedTuple):
    """A simulated log and what was identified from it, (levels, n): relative errors and the deviation of stiffness."""

    arm: str
    called: NDArray[np.bool_]
    """Whether a stiffness is identifiable."""
    error: Floats
    deviation: Floats
    damping: Floats
    """Relative error of the damping."""

    @property
    def inside(self) -> NDArray[np.bool_]:
        """Whether an interval holds the truth."""
        return np.abs(self.error) < 1.96 * self.deviation


def identified(seed: int) -> Identified:
    """Simulate and identify a log."""
    name = [*ARMS][seed % len(ARMS)]
    dice = np.random.default_rng(seed)
    rate, bits = int(dice.choice(RATES)), int(dice.choice(BITS))
    true = true_robot(name, dice)
    experiment = stiffness_experiment(robot_of(name), step=1.0 / rate, seed=seed)
    plan = experiment.excitation
    damping = MotorSide(true, experiment.pose).start().damping * dice.uniform(0.5, 2.0, true.n)
    results = played(name, true, plan, experiment.pose, damping)
    levels = identify_stiffness(measured(results, true, rate, bits, dice), robot_of(name), plan).levels
    return Identified(
        name,
        called=np.array([each.identifiable for each in levels]),
        error=np.array([each.stiffness for each in levels]) / truth_of(results, plan) - 1.0,
        deviation=np.array([each.deviation for each in levels]),
        damping=np.array([each.drives.damping for each in levels]) / damping - 1.0,
    )


def of_called(logs: Sequence[Identified], quantity: str) -> Floats:
    """Return a quantity of all identifiable stiffnesses."""
    return np.concatenate([getattr(log, quantity)[log.called] for log in logs])


def summary(logs: Sequence[Identified]) -> bool:
    """Print the figures of the logs; return whether they are as wanted."""
    table = Table(
        "stiffness", "Stiffness of the springs",
        [("arm", ""), ("logs", "d"), ("identifiable", "d"), ("of", "d"), ("largest error [%]", ".2f"),
         ("mean [%]", ".2f"), ("spread [%]", ".2f"), ("inside the interval", ".3f")],
    )  # fmt: skip
    for name in [*ARMS, "all"]:
        if here := [log for log in logs if name in (log.arm, "all")]:
            error, inside = of_called(here, "error"), of_called(here, "inside")
            percents = 100.0 * np.array([np.abs(error).max(), error.mean(), error.std()])
            table.add(name, len(here), len(error), sum(log.called.size for log in here), *percents, inside.mean())
    table.show(Console())
    counts = np.array([[log.inside[log.called].sum(), log.called.sum()] for log in logs])
    dice = np.random.default_rng(0).integers(0, len(logs), (9999, len(logs)))
    shares = counts[dice].sum(axis=1)
    low, high = np.quantile(shares[:, 0] / np.maximum(shares[:, 1], 1), (0.025, 0.975))
    coverage, false = table.rows[-1][-1], int((np.abs(of_called(logs, "error")) > FALSE).sum())
    print(f"false calls {false}, coverage {coverage:.3f} with 95 % in {low:.3f} to {high:.3f} (logs drawn again)")
    print(f"median error of the damping {100 * np.median(np.abs(of_called(logs, 'damping'))):.0f} %")
    return false == 0 and coverage >= 0.85 and low <= 0.95 <= high


if __name__ == "__main__":
    count = int(sys.argv[1]) if len(sys.argv) > 1 else 60
    sys.exit(0 if summary([identified(seed) for seed in range(FIRST, FIRST + count)]) else 1)
