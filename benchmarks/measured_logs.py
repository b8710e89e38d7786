"""Logs of real arms that others published, identified as rigid arms, and scored on motions that were not fitted."""

from __future__ import annotations

import re
import tempfile
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from scipy.interpolate import CubicSpline
from scipy.signal import butter, sosfiltfilt

import vdfmu
from benchmarks.report import Report, Table
from vdfmu.arm.equations.friction import stribeck_friction
from vdfmu.arm.equations.rigid_body import body_parameters
from vdfmu.arm.robot import Robot
from vdfmu.base.arrays import Floats
from vdfmu.base.toml_file import toml_text
from vdfmu.extras.identify.fit import PRIOR, identify
from vdfmu.extras.identify.log import Log, read_log
from vdfmu.extras.identify.problem import regressor
from vdfmu.extras.robots import robot_from_urdf

BAND = 4.0
"""Band of the equations [Hz]; the motions of Panda and UR10e have frequencies of up to 0.7 Hz."""
TX40_BAND = 10.0
"""The same of the TX40, whose accelerations last 0.1 s."""


class Model(NamedTuple):
    """What predicts the torques of a motion: an arm, and parameters of the links that it may not have as bodies."""

    robot: Robot
    """Ratios, rotors, and friction unless there is another law."""
    columns: Any
    links: Floats
    """Columns of the regressor, and the parameters of these."""
    friction: Callable[[Robot, Floats], Floats] = stribeck_friction
    offset: Any = 0.0
    """(n,) [N m], link-side: what the torques are too large by."""
    delay: float = 0.0
    """Delay of torques after positions [s]."""


def rigid(robot: Robot, **more: Any) -> Model:
    """Model of an arm as it is in its file."""
    return Model(robot, slice(None), body_parameters(robot), **more)


def fitted(log: Log, robot: Robot, band: float = BAND, prior: float = PRIOR) -> Model:
    """Model identified from a log."""
    estimate = identify(log, robot, band=band, prior=prior)
    value = dict(zip(estimate.names, estimate.values, strict=True))
    names = ("I_m", "f_c", "f_s", "v_s", "f_v")
    drives = {name: np.array([value[f"{name}[{i + 1}]"] for i in range(robot.n)]) for name in names}
    offset = robot.ell * [value.get(f"tau_0[{i + 1}]", 0.0) for i in range(robot.n)]  # torque sensors, if estimated
    links = np.array([value[name] for name in estimate.base.names])
    return Model(robot.with_parameters(**drives), estimate.base.columns, links, offset=offset, delay=estimate.delay)


def torques(model: Model, log: Log, band: float = BAND) -> tuple[Floats, Floats, Floats]:
    """Torques measured and the residual of the model, link-side (m, n), and the columns of a load (m, n, 10)."""
    robot, h, t = model.robot, log.step, log.t
    wide, narrow = (butter(4, f, fs=1.0 / h, output="sos") for f in (min(20.0 * band, 0.4 / h), band))
    trim = int(3.0 / band / h)  # transients of the filter

    def filtered(signal: Floats) -> Floats:
        return np.asarray(sosfiltfilt(narrow, signal, axis=0))[trim:-trim]

    motion = CubicSpline(t, sosfiltfilt(wide, log.kappa, axis=0))
    q, v, a = motion(t), motion(t, 1), motion(t, 2)
    parts = regressor(robot, q, v, a, v, a)
    J = robot.I_m * robot.ell
    predicted = parts.links[:, :, model.columns] @ model.links + parts.rotors @ J + J * (a + parts.carried)
    predicted = predicted + model.friction(robot, v) + model.offset
    measured = np.stack([np.interp(t + model.delay, t, column) for column in (log.tau * robot.ell).T], axis=1)
    return filtered(measured), filtered(measured - predicted), filtered(parts.links[:, :, -10:])


def percent(residual: Floats, measured: Floats) -> list[float]:
    """Root mean square of the residual, in % of the torque's, by joint."""
    return (100.0 * np.sqrt((residual**2).mean(axis=0) / (measured**2).mean(axis=0))).tolist()


def as_log(robot: Robot, t: Floats, q: Floats, tau: Floats, factors: Floats) -> Log:
    """Log of positions (m, n) and of torques, link-side, or currents, by the reader of ``vdfmu identify``."""
    joints = [str(i + 1) for i in range(robot.n)]
    head = ",".join(["time", *(f"q{i}" for i in joints), *(f"tau{i}" for i in joints)])
    columns = {"kappa": "q{} [rad]", **{f"tau_link[{i}]": f"tau{i} [{factors[int(i) - 1]} N.m]" for i in joints}}
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder, "log.csv")
        np.savetxt(path, np.column_stack([t, q, tau]), delimiter=",", header=head, comments="")
        return read_log(path, robot, columns)


def panda(report: Report, folder: Path) -> None:
    """Panda of Gaz and others 2019, 21 s at nearly 1 kHz: fitted on a part of the period, scored on another."""
    robot = vdfmu.load_robot("panda_7dof")
    place = folder / "matlab" / "data" / "Exciting_Traj" / "Trajectory_1" / "rbt_log"
    each = [np.loadtxt(place / f"exciting_traj_{name}.txt") for name in ("time", "positions", "torques")]
    rows = len(each[0]) // 5 * 5  # means of 5 rows: their times and positions jitter by up to 8 ms
    t, q, tau = (x.reshape(len(each[0]), -1)[:rows].reshape(rows // 5, 5, -1).mean(axis=1) for x in each)
    text = (folder / "cpp" / "panda_dyn_model_example" / "include" / "franka_model.h").read_text(encoding="utf-8")
    phi = np.array(re.findall(r"FI_\d\d = ([-\d.e]+);", text), dtype=float).reshape(3, robot.n)

    def sigmoid(robot: Robot, v: Floats) -> Floats:
        return phi[0] / (1.0 + np.exp(-phi[1] * (v + phi[2]))) - phi[0] / (1.0 + np.exp(-phi[1] * phi[2]))

    def part(begin: float, end: float) -> Log:
        inside = (t[:, 0] >= begin) & (t[:, 0] <= end)
        return as_log(robot, t[inside, 0], q[inside], tau[inside], np.ones(robot.n))

    table = Table(
        "panda",
        "Panda: residual torque of all joints [%]",
        [("fitted", ""), ("model", ""), ("motion", ""), ("", ".2f")],
    )
    theirs = rigid(robot.with_parameters(I_m=np.full(robot.n, 1e-9)), friction=sigmoid)
    for begin, end in ((9.0, 13.4), (0.0, 21.0)):
        fit, motion = part(0.0, 9.0 if begin else end), part(begin, end)
        for name, model in (("fitted", fitted(fit, robot)), ("the authors' links and friction", theirs)):
            measured, residual, _ = torques(model, motion)
            all_joints = 100.0 * float(np.linalg.norm(residual) / np.linalg.norm(measured))
            table.add(f"to {fit.t[-1]:.0f} s", name, f"{begin:g} to {end:g} s", all_joints)
    report.show(table)


UR10E = {
    "12 harmonics, 30 s": ("identification_data/ur-20_02_10-30sec_12harm.csv", 635, 3510),
    "10 points": ("validation_data/ur-20_01_17-ptp_10_points.csv", 700, 4200),
    "14 harmonics": ("identification_data/ur-20_02_19_14harm50sec.csv", 195, 4966),
    "14 harmonics, load": ("identification_data/ur-20_02_19_14harm50secLoad.csv", 308, 5071),
    "31 January, load": ("identification_data/ur-20_01_31-load.csv", 346, 2618),
}
"""Motions: file and rows, from 1; of all but the last these are those of the authors' scripts."""


def ur10e(report: Report, folder: Path) -> None:
    """UR10e of Mamedov and Mikhel 2020, with and without a load of 2.805 kg, currents times their drive gains."""
    text = (folder / "UR10E_parameters.txt").read_text(encoding="utf-8")

    def read(name: str) -> Floats:
        return np.array(re.findall(rf"{name} = \[([^\]]*)\]", text)[0].split(), dtype=float)

    robot = robot_from_urdf(folder / "URe" / "urdf" / "ur10e.urdf", base="base_link", tip="wrist_3_link")
    effort = 0.03 * np.array([330.0, 330.0, 150.0, 54.0, 54.0, 54.0])
    robot = robot.with_parameters(f_c=effort, f_s=effort, f_v=effort, v_s=np.full(6, 0.1))  # 0 in the file
    gains = read("drvGains")

    def motion(name: str) -> Log:
        file, begin, end = UR10E[name]
        lines = (folder / "dataset_ur10e" / file).read_text(encoding="utf-8").splitlines()[begin - 1 : end]
        rows = np.array([line.split(",")[:19] for line in lines], dtype=float)
        return as_log(robot, rows[:, 0], rows[:, 1:7], rows[:, 13:19], gains)

    logs = {name: motion(name) for name in UR10E}
    model, theirs = fitted(logs["12 harmonics, 30 s"], robot), _authors(robot, read)
    joints = [(f"joint {i + 1}", ".1f") for i in range(6)]
    table = Table("ur10e", "UR10e: residual torque [%]", [("model", "s"), ("motion", "s"), *joints])
    for name in ("10 points", "14 harmonics"):
        for who, candidate in (("fitted to 12 harmonics", model), ("the authors' parameters", theirs)):
            measured, residual, _ = torques(candidate, logs[name])
            table.add(who, name, *percent(residual, measured))
    bare = fitted(logs["14 harmonics"], robot)
    noise = np.sqrt((torques(bare, logs["14 harmonics"])[1] ** 2).mean(axis=0))[:, None]
    _, residual, columns = torques(bare, logs["14 harmonics, load"])
    load: Any = np.linalg.lstsq((columns / noise).reshape(-1, 10), (residual / noise[:, 0]).ravel(), rcond=None)[0]
    measured, residual, columns = torques(bare, logs["31 January, load"])
    table.add("arm fitted to 14 harmonics", "31 January, load", *percent(residual, measured))
    table.add("and a load fitted with them", "31 January, load", *percent(residual - columns @ load, measured))
    table.notes.append(f"The load of 2.805 kg as fitted: {load[0]:.2f} kg.")
    report.show(table)


def _authors(robot: Robot, read: Callable[[str], Floats]) -> Model:
    """Model of the authors: inertias about the origins of the URDF's frames, whose axes are y where ours are z."""
    bodies, friction = read("pi_rgd").reshape(6, 10), read("pi_frcn").reshape(6, 3)
    about_y = np.array([[1.0, 0.0, 0.0], [0.0, 0.0, 1.0], [0.0, -1.0, 0.0]])
    centroids, inertias = np.zeros((6, 3)), np.zeros((6, 3, 3))
    for i, (xx, xy, xz, yy, yz, zz, *first, m) in enumerate(bodies):
        turn, c = np.eye(3) if i in (0, 4) else about_y, np.array(first) / m
        inertia = np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]]) - m * (c @ c * np.eye(3) - np.outer(c, c))
        centroids[i], inertias[i] = turn.T @ c, turn.T @ inertia @ turn
    drives = {"I_m": read("pi_drvs") / robot.ell, "f_v": friction[:, 0], "f_c": friction[:, 1], "f_s": friction[:, 1]}
    links = {"mass": bodies[:, 9], "centroid": centroids, "inertia": inertias}
    arm = replace(robot, rotor_coupling=False).with_parameters(**links, **drives)
    return rigid(arm, offset=friction[:, 2])


LAST_LINK = {"mass": 0.2, "centroid": [0.0, 0.0, 0.042], "inertia": [1e-4, 1e-4, 1e-4]}
"""Flange of the TX40: the URDF has its mass and centre of mass, and an inertia of 0."""


def tx40(report: Report, folder: Path) -> None:
    """TX40 of FIGAROH, 7.5 s at its speed limits, motors at 5 kHz: fitted to 5 s, scored on the rest."""
    place = folder / "examples" / "staubli_TX40"
    text = (place / "config" / "TX40_config.yaml").read_text(encoding="utf-8")

    def read(name: str) -> Floats:
        return np.array(re.findall(rf"\b{name} ?: \[?([-\d., ]+)", text)[0].split(","), dtype=float)

    urdf, ratios = place / "urdf" / "tx40_mdh_modified.urdf", read("reduction_ratio")

    def values(name: str) -> Floats:
        return np.array(re.findall(rf'\b{name}="([\d.]+)"', urdf.read_text(encoding="utf-8")), dtype=float)

    with tempfile.TemporaryDirectory() as temporary:
        drives = Path(temporary, "drives.toml")
        ells = {f"joint_{i + 1}": {"drive": {"ell": abs(float(ratio))}} for i, ratio in enumerate(ratios)}
        drives.write_text(toml_text({**ells, "joint_6": {**ells["joint_6"], "link": LAST_LINK}}), encoding="utf-8")
        robot = robot_from_urdf(urdf, base="base_link", tip="tool0", drives=drives)
    effort = 0.03 * values("effort")
    robot = robot.with_parameters(f_c=effort, f_s=effort, f_v=effort, v_s=np.full(6, 0.1))  # 0 in the file
    gear = np.diag(ratios)
    gear[5, 4] = ratios[5]  # joint 5 turns motor 6 too
    motors, currents = (
        np.loadtxt(place / "data" / f"{name}.csv", delimiter=",", skiprows=1).reshape(-1, 5, 6).mean(axis=1)
        for name in ("pos_read_data", "curr_data")  # the torques of the motors in N.m, despite the name
    )
    t: Any = 1e-3 * np.arange(len(motors))
    q = np.linalg.solve(gear, motors.T).T + np.array([0.0, -0.5, 0.5, 0.0, 0.0, 0.0]) * np.pi
    tau = currents @ gear
    motion = CubicSpline(t, sosfiltfilt(butter(4, 80.0, fs=1000.0, output="sos"), q, axis=0))
    v, a = motion(t, 1), motion(t, 2)
    shares = ", ".join(f"{100.0 * share:.0f}" for share in np.abs(v).max(axis=0) / values("velocity"))
    report.say(f"TX40: peak speeds of {shares} % of the limits in the URDF")
    swapped = [5, 4]  # motor 6, driven by both joints of the wrist: what each adds to the torque of the other
    shared = read("fsm6") * np.sign(v[:, 4:].sum(axis=1, keepdims=True))
    wrist = np.pad(read("Iam6") * a[:, swapped] + read("fvm6") * v[:, swapped] + shared, ((0, 0), (4, 0)))

    def part(begin: float, end: float, torque: Floats) -> Log:
        inside = (t >= begin) & (t <= end)
        return as_log(robot, t[inside], q[inside], torque[inside], np.ones(6))

    def sign(robot: Robot, v: Floats) -> Floats:
        return robot.f_c * np.sign(v) + robot.f_v * v

    joints = [(f"joint {i + 1}", ".1f") for i in range(6)]
    table = Table("tx40", "TX40: residual torque [%]", [("model", "s"), ("motion", "s"), *joints])
    apart = tau - wrist
    begun = part(0.0, 5.0, apart)
    split = fitted(begun, robot, TX40_BAND)
    rotors = read("Ia") / robot.ell
    arm = replace(robot, rotor_coupling=False).with_parameters(I_m=rotors, f_c=read("fs"), f_v=read("fv"))
    theirs = rigid(arm, friction=sign, offset=read("offset"))
    other = arm.with_parameters(I_m=np.append(split.robot.I_m[:2], rotors[2:]))
    for model, name, torque in (
        (fitted(part(0.0, 5.0, tau), robot, TX40_BAND), "fitted to 0 to 5 s", tau),
        (split, "the same, without the terms of motor 6", apart),
        (fitted(begun, robot, TX40_BAND, prior=1e-3), "without these terms, links held", apart),
        (theirs, "the repository's numbers, with these terms", apart),
        (theirs._replace(robot=other), "the same, rotors 1 and 2 as fitted", apart),
    ):
        for begin, end, when in ((0.0, 5.0, "0 to 5 s"), (5.0, 8.0, "5 to 8 s, not fitted")):
            measured, residual, _ = torques(model, part(begin, end, torque), TX40_BAND)
            table.add(name, when, *percent(residual, measured))
    report.show(table)

    columns = [(heading, ".3g") for heading in ("friction", "from", *(heading for heading, _ in joints))]
    friction = Table("tx40_friction", "TX40: friction", columns)
    for key, name in (("f_c", "Coulomb [N m]"), ("f_v", "viscous [N m s/rad]")):
        for who, model in (("fitted, without the terms of motor 6", split), ("the repository", theirs)):
            friction.add(name, who, *getattr(model.robot, key))
    report.show(friction)
