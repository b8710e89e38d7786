"""How often the intervals of `identify --for stiffness` hold the truth: simulated logs of arms with bristle friction.

    python benchmarks/stiffness.py [LOGS] [FILE]

LOGS simulated logs (default 60) of the excitation of `identify --design`, of four arms in turn, three of them with
rotor coupling. Plants have bristles, dampers beside the springs, stiffnesses of 0.7 to 1.4, friction of 0.5 to 2 and
rotors of 0.95 to 1.05 times those of the robot file, and a payload that is unknown. Encoders have 12 to 17 bits,
torques 0.5 % of noise. The truth is the regression of the spring's torque on its deformation in the simulation. FILE
keeps each log's numbers as a line of JSON, so that a later run goes on. The exit code is 1 for a false call, an
identifiable stiffness that is off by more than 10 %, if less than 85 % of the intervals hold the truth, or if 95 % is
not within the interval of this share.
"""

from __future__ import annotations

import dataclasses
import json
import sys
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np

import vdfmu
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


def logged(seed: int) -> tuple[str, int, Log, PeriodicTorques, Floats, Floats]:
    """Return the arm, bits, log, excitation, true stiffness (levels, n) and damping (n,) of a simulation."""
    name = [*ARMS][seed % len(ARMS)]
    dice = np.random.default_rng(seed)
    rate, bits = int(dice.choice(RATES)), int(dice.choice(BITS))
    true = true_robot(name, dice)
    experiment = stiffness_experiment(robot_of(name), step=1.0 / rate, seed=seed)
    side = MotorSide(true, experiment.pose)
    damping = side.start().damping * dice.uniform(0.5, 2.0, true.n)
    results = played(name, true, experiment.excitation, experiment.pose, damping)
    truth = truth_of(results, experiment.excitation)
    return name, bits, measured(results, true, rate, bits, dice), experiment.excitation, truth, damping


def identified(seed: int) -> dict[str, Any]:
    """Simulate and identify a log."""
    name, bits, log, plan, truth, damping = logged(seed)
    fit = identify_stiffness(log, robot_of(name), plan)
    return {
        "seed": seed, "arm": name, "rate": round(1.0 / log.step), "bits": bits, "truth": truth.tolist(),
        "stiffness": [each.stiffness.tolist() for each in fit.levels],
        "deviation": [each.deviation.tolist() for each in fit.levels],
        "absolute": [each.absolute.tolist() for each in fit.levels],
        "called": [each.identifiable.tolist() for each in fit.levels],
        "share": [each.share.tolist() for each in fit.levels],
        "delay": [each.delay for each in fit.levels], "damping": [each.drives.damping.tolist() for each in fit.levels],
        "true_damping": damping.tolist(),
    }  # fmt: skip


def summary(rows: list[dict[str, Any]]) -> bool:
    """Print the figures of the logs; return whether they are as wanted."""
    called = [np.array(row["called"], bool) for row in rows]
    errors = [np.array(row["stiffness"]) / np.array(row["truth"]) - 1.0 for row in rows]
    normal = [np.abs(e) / np.array(row["deviation"]) for e, row in zip(errors, rows, strict=True)]
    print("arm          logs  called of    worst %  bias %  spread %  median sd %  coverage")
    for name in [*ARMS, "all"]:
        here = [k for k, row in enumerate(rows) if name in (row["arm"], "all")]
        if not here:
            continue
        e, z = (np.concatenate([each[k][called[k]] for k in here]) for each in (errors, normal))
        sd = np.concatenate([np.array(rows[k]["deviation"])[called[k]] for k in here])
        print(
            f"{name:12} {len(here):4} {len(e):7} {sum(called[k].size for k in here):3} {100 * np.abs(e).max():9.2f} "
            f"{100 * e.mean():7.2f} {100 * e.std():9.2f} {100 * np.median(sd):12.2f} {(z < 1.96).mean():9.3f}"
        )
    counts = np.array([[(z < 1.96)[c].sum(), c.sum()] for z, c in zip(normal, called, strict=True)])
    dice = np.random.default_rng(0).integers(0, len(rows), (9999, len(rows)))
    shares = counts[dice].sum(axis=1)
    low, high = np.quantile(shares[:, 0] / np.maximum(shares[:, 1], 1), (0.025, 0.975))
    coverage = counts[:, 0].sum() / counts[:, 1].sum()
    false = sum(int((np.abs(e) > FALSE)[c].sum()) for e, c in zip(errors, called, strict=True))
    damping = [
        np.abs(np.array(row["damping"]) / np.array(row["true_damping"]) - 1.0)[c]
        for row, c in zip(rows, called, strict=True)
    ]
    print(f"false calls {false}, coverage {coverage:.3f} with 95 % in {low:.3f} to {high:.3f} (logs drawn again)")
    print(f"median error of the damping {100 * np.median(np.concatenate(damping)):.0f} %")
    return false == 0 and coverage >= 0.85 and low <= 0.95 <= high


def main() -> None:
    """Simulate and identify the logs that the file lacks."""
    wanted = int(sys.argv[1]) if len(sys.argv) > 1 else 60
    path = Path(sys.argv[2]) if len(sys.argv) > 2 else None
    rows = [json.loads(line) for line in path.read_text().splitlines()] if path and path.is_file() else []
    there = {row["seed"] for row in rows}
    for seed in range(FIRST, FIRST + wanted):
        if seed not in there:
            rows.append(identified(seed))
            if path:
                with path.open("a") as file:
                    file.write(json.dumps(rows[-1]) + "\n")
    sys.exit(0 if summary(rows) else 1)


if __name__ == "__main__":
    main()
