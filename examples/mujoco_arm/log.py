"""A log of an arm that vdfmu did not simulate: MuJoCo, with a current loop, cogging, warming friction and a soft mount.

    pip install mujoco
    python examples/mujoco_arm/log.py LOG.csv [TORQUES.csv]
    vdfmu identify LOG.csv --robot planar_2dof --for stiffness --excitation TORQUES.csv

The arm is planar_2dof as `vdfmu robot export` writes it, with springs of 0.8 and 1.25 times the stiffness of the file
and 1 % of damping. It has additional features that the identification does not model: currents follow their commands
with a loop of 600 Hz, cogging is 5 % of the breakaway torque 24 times a turn of the motor, friction falls by a fifth
within the log as the drive warms up, and the arm is mounted on a base that oscillates at some 60 Hz. The log has
commanded currents times the torque constant, and encoders of 17 bits. With ``--stiff`` the mount is rigid.
"""

import sys
import xml.etree.ElementTree as ElementTree
from pathlib import Path
from tempfile import TemporaryDirectory

import mujoco
import numpy as np

import vdfmu
from vdfmu.dynamics import gravity_torque, mass_matrix
from vdfmu.extras.identify import stiffness_experiment
from vdfmu.extras.identify.stiffness_commands import excitation_text
from vdfmu.extras.robots import export_robot

FACTORS = np.array([0.8, 1.25])
MOUNT, MASS, HEIGHT = 60.0, 20.0, 0.3
"""Frequency of the mount's swing without the arm [Hz], its mass [kg], and the height of the arm on it [m]."""
LOOP, COGGING, WARMING = 600.0, 0.05, 0.2
STEP, FINE = 1e-3, 1.25e-4
"""Steps of the log and of the simulation [s]."""


def model_of(robot, stiff):
    """Return the model of MuJoCo, and the stiffness (n,) of its springs."""
    with TemporaryDirectory() as folder:
        path = Path(folder) / "arm.xml"
        export_robot(robot, path)
        tree = ElementTree.parse(path)
    root = tree.getroot()
    root.find("option").set("timestep", str(FINE))
    stiffness = np.array([float(each.get("stiffness")) for each in root.iter("fixed")]) * FACTORS
    M = np.diag(mass_matrix(robot, stiffness_experiment(robot).pose))
    for spring, K, m in zip(root.iter("fixed"), stiffness, M, strict=True):
        spring.set("stiffness", f"{K:.9g}")
        spring.set("damping", f"{2.0 * 0.01 * np.sqrt(K * m):.6g}")
    world = root.find("worldbody")
    bodies = list(world)
    mount = ElementTree.SubElement(world, "body", name="mount")
    inertia = MASS * HEIGHT**2
    ElementTree.SubElement(mount, "inertial", pos=f"0 0 {-HEIGHT}", mass=str(MASS), diaginertia="0.1 0.1 0.1")
    if not stiff:
        K = (2.0 * np.pi * MOUNT) ** 2 * inertia
        ElementTree.SubElement(
            mount, "joint", name="mount", type="hinge", axis="0 1 0", pos=f"0 0 {-HEIGHT}", stiffness=f"{K:.6g}",
            damping=f"{2.0 * 0.02 * np.sqrt(K * inertia):.6g}",
        )  # fmt: skip
    for body in bodies:
        world.remove(body)
        mount.append(body)
    return mujoco.MjModel.from_xml_string(ElementTree.tostring(root, encoding="unicode")), stiffness


def played(robot, plan, stiff):
    """Return times, positions of rotors divided by the gear ratio and commanded torques (m, n), and the true stiffness
    (n,)."""
    model, stiffness = model_of(robot, stiff)
    data = mujoco.MjData(model)
    n, ell = robot.n, robot.ell
    rotors, links = ([model.joint(f"joint_{i + 1}{kind}").qposadr[0] for i in range(n)] for kind in ("_rotor", ""))
    speeds = [model.joint(f"joint_{i + 1}_rotor").dofadr[0] for i in range(n)]
    hold = gravity_torque(robot, plan.pose)
    data.qpos[links] = plan.pose
    data.qpos[rotors] = (plan.pose + hold / stiffness) * ell
    B = robot.I_m * ell + np.diag(mass_matrix(robot, plan.pose))
    k_p, k_v = B * (2.0 * np.pi) ** 2 / ell, 1.4 * B * 2.0 * np.pi / ell
    each, rows = round(STEP / FINE), round(plan.excitation.t[-1] / STEP)
    t = np.arange(rows * each) * FINE
    torque = np.stack([np.interp(t, plan.excitation.t, column) for column in plan.excitation.torque.T], axis=1)
    friction = model.dof_frictionloss.copy()
    pole, current = np.exp(-2.0 * np.pi * LOOP * FINE), hold / ell
    log = []
    for k, now in enumerate(t):
        kappa, speed = data.qpos[rotors] / ell, data.qvel[speeds] / ell
        command = torque[k] + hold / ell + k_p * (plan.pose - kappa) - k_v * speed
        if k % each == 0:
            log.append([now, *kappa, *command])
            model.dof_frictionloss[:] = friction * (1.0 - WARMING * now / t[-1])
        current = pole * current + (1.0 - pole) * command
        data.ctrl[:] = current + COGGING * robot.f_s / ell * np.sin(24.0 * kappa * ell)
        mujoco.mj_step(model, data)
    log = np.array(log)
    return log[:, 0], log[:, 1 : n + 1], log[:, n + 1 :], stiffness


def main(path, torques="torques.csv", stiff=False):
    """Simulate, and write the log and the torques that were played."""
    robot = vdfmu.load_robot("planar_2dof")
    plan = stiffness_experiment(robot)
    Path(torques).write_text(excitation_text(plan.excitation), encoding="utf-8")
    t, kappa, tau, stiffness = played(robot, plan, stiff)
    dice, bit = np.random.default_rng(1), 2.0 * np.pi / 2**17 / robot.ell
    tau = tau + 0.005 * np.abs(tau - tau.mean(axis=0)).max(axis=0) * dice.standard_normal(tau.shape)
    table = np.column_stack([t, np.round(kappa / bit) * bit, tau])
    heads = ",".join(["time", *(f"{name}[{i + 1}]" for name in ("kappa", "tau") for i in range(robot.n))])
    np.savetxt(path, table, delimiter=",", header=heads, comments="", fmt="%.10g")
    print("stiffness of the simulated springs [N.m/rad]:", ", ".join(f"{K:.0f}" for K in stiffness))


if __name__ == "__main__":
    words = [each for each in sys.argv[1:] if each != "--stiff"]
    main(*words, stiff="--stiff" in sys.argv)
