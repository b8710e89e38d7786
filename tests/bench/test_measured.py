"""The script for what others measured, on files of the same form that are made here."""

import csv
import io
from pathlib import Path

import numpy as np
import pytest
from rich.console import Console
from scipy.integrate import cumulative_trapezoid

import vdfmu
from benchmarks import measured, measured_logs
from benchmarks.report import Report
from vdfmu.arm.equations.friction import stribeck_friction
from vdfmu.arm.equations.rigid_body import body_parameters
from vdfmu.arm.robot import Robot
from vdfmu.base.arrays import Floats
from vdfmu.base.platforms import native_available
from vdfmu.extras.identify.problem import regressor

pytestmark = [
    pytest.mark.heavy,
    pytest.mark.skipif(not native_available(), reason="the compiler of native FMUs is not installed"),
]


@pytest.fixture
def report(tmp_path):
    return Report("measured", "Measured", tmp_path, Console(file=io.StringIO(), width=120))


def _write(folder: Path, model: str, signals: dict[str, Floats]) -> None:
    path = folder.joinpath("Modelica", "Mechanics", *model.split("."))
    path.mkdir(parents=True)
    with open(path / f"{path.name}.csv", "w", newline="") as file:
        rows = csv.writer(file)
        rows.writerow(signals)
        rows.writerows(np.column_stack(list(signals.values())).tolist())


def _lossy_gear() -> dict[str, Floats]:
    """LossyGearDemo1 worked out by hand: the equation of each mode between the times at which these change."""
    # With the efficiency e, ratio 2, and inertias 1 and 1.5: driving (1.5 + 4 e) a = load + 2 e tau, driven back (1.5
    # + 4 / e) a = load + 2 tau / e.
    t = np.linspace(0.0, 0.5, 20001)
    tau, load = 10.0 * np.sin(2.0 * np.pi * t), -10.0 + 2.5 * t
    back, drive = (load + 4.0 * tau) / 9.5, (load + tau) / 3.5
    mode, speed, now = np.zeros(len(t)), np.zeros(len(t)), 0.0
    for k in range(len(t) - 1):
        if now == 0.0:
            now = 1.0 if drive[k] > 0.0 else -1.0 if back[k] < 0.0 else 0.0
        mode[k + 1], h = now, t[1]
        speed[k + 1] = speed[k] + h * (0.0 if now == 0.0 else (back if now < 0.0 else drive)[k : k + 2].mean())
        if speed[k + 1] * now < 0.0:
            speed[k + 1], mode[k + 1], now = 0.0, 0.0, 0.0
    angle = cumulative_trapezoid(speed, t, initial=0.0)
    return {"time": t, "Inertia2.phi": np.asarray(angle), "Inertia2.w": speed, "gear.mode": mode}


def test_the_gear_follows_the_law_by_hand_in_each_mode(report, tmp_path):
    for model in ("LossyGearDemo1", "LossyGearDemo2"):
        _write(tmp_path, f"Rotational.Examples.{model}", _lossy_gear())
    measured.lossy_gears(report, tmp_path)
    (table,) = report.tables
    rows = [row for row in table.rows if row[0] == "LossyGearDemo1"]
    assert [row[2] for row in rows[::2]] == ["all", "all", "driven back", "stuck, driving, stuck", "driven back"]
    # The spring starts with the load of 10 N.m, at rest, not with that of the accelerated gear, 8.4: it swings within
    # 1 ms by 1.6 N.m / 9.5 kg.m2 * 1 ms, 1 % of the speeds. Other differences are those of eps / 1e-2 rad/s, 0.01 %.
    assert all(row[8] < 0.2 and row[7] < 2.0 for row in rows[4:])
    assert all(row[7] > 50.0 for row in rows[:4])  # no one mu_l does for both directions


def test_an_axis_follows_its_path(report, tmp_path):
    t = np.linspace(0.0, 0.998, 2000)  # 120 degrees at 3 rad/s and 10 rad/s2, till it comes to rest
    speed = np.interp(t, [0.0, 0.3, 0.69813, 0.99813], [0.0, 3.0, 3.0, 0.0])
    names = ("axis.initializeFlange.phi_flange", "axis.initializeFlange.w_flange", "axis.motor.La.i",
             "axis.gear.spring.phi_rel")  # fmt: skip
    signals = (cumulative_trapezoid(speed, t, initial=0.0), speed, np.gradient(speed, t), np.gradient(speed, t))
    _write(
        tmp_path,
        "MultiBody.Examples.Systems.RobotR3.OneAxis",
        {"time": t, **{n: np.asarray(s) for n, s in zip(names, signals, strict=True)}},
    )
    measured.one_axis(report, tmp_path)
    (table,) = report.tables
    assert [row[0] for row in table.rows] == list(names)
    # The controller's integral takes T_s of 50 ms to come to the 3.6 A that accelerate and rub; till then speeds differ
    # by 3.6 A / (0.5 A.s/rad) / 210 = 0.034 rad/s, positions by 1.7 mrad, twice as much where the acceleration turns,
    # and by the spring's 0.6 mrad: 4 mrad of 2.1 rad.
    assert table.rows[0][3] < 0.2


def _torques(robot: Robot, q: Floats, v: Floats, a: Floats) -> Floats:
    J = robot.I_m * robot.ell
    parts = regressor(robot, q, v, a, v, a)
    return parts.links @ body_parameters(robot) + parts.rotors @ J + J * (a + parts.carried)


def _sines(t: Floats, n: int, seed: int) -> tuple[Floats, Floats, Floats]:
    """Positions, velocities and accelerations, (m, n) each, of five harmonics of 0.075 Hz."""
    random, w = np.random.default_rng(seed), 2.0 * np.pi * 0.075 * np.arange(1, 6)
    size, phase = random.uniform(0.2, 0.5, (n, 5)), random.uniform(0.0, 2.0 * np.pi, (n, 5))
    each = [size * w**k * np.sin(w * t[:, None, None] + phase + 0.5 * np.pi * k) for k in range(3)]
    return each[0].sum(axis=2), each[1].sum(axis=2), each[2].sum(axis=2)


def test_a_panda_of_the_authors_files_is_theirs_and_ours(report, tmp_path):
    robot = vdfmu.load_robot("panda_7dof").with_parameters(I_m=np.full(7, 1e-9))
    random = np.random.default_rng(1)
    t = np.arange(0.0, 21.0, 1.4e-3) + random.uniform(0.0, 5e-4, 15000)
    q, v, a = _sines(t, 7, 2)
    phi = np.array([[0.5] * 7, [8.0] * 7, [0.02] * 7])
    friction = phi[0] / (1.0 + np.exp(-phi[1] * (v + phi[2]))) - phi[0] / (1.0 + np.exp(-phi[1] * phi[2]))
    place = tmp_path / "matlab" / "data" / "Exciting_Traj" / "Trajectory_1" / "rbt_log"
    place.mkdir(parents=True)
    for name, values in (("time", t), ("positions", q), ("torques", _torques(robot, q, v, a) + friction)):
        np.savetxt(place / f"exciting_traj_{name}.txt", values.reshape(-1, 1))
    header = tmp_path / "cpp" / "panda_dyn_model_example" / "include" / "franka_model.h"
    header.parent.mkdir(parents=True)
    lines = (f"const double  FI_{k + 1}{i + 1} = {x};" for k, row in enumerate(phi) for i, x in enumerate(row))
    header.write_text("\n".join(lines))
    measured_logs.panda(report, tmp_path)
    (table,) = report.tables
    assert len(table.rows) == 5
    # Means of 5 rows attenuate 0.4 Hz by (w T)^2 / 24 with T of 8 ms, 2e-5, also on products of sines; splines and
    # filters by less: 0.1 % of the torques.
    assert all(row[-1] < 0.1 for row in (table.rows[1], table.rows[4]))
    # The fit keeps the file's rotors, of up to 0.12 kg.m2 at the link: 0.6 N.m at 5 rad/s2, of torques of 20 N.m.
    assert table.rows[0][-1] < 4.0


_ORIGINS = ("0 0 0.18", "0 0.18 0", "0 -0.14 0.61", "0 0 0.57", "0 0.14 0", "0 0 0.12")


def test_a_ur10e_of_the_authors_parameters_is_theirs_and_ours_and_its_load_is_found(report, tmp_path):
    random, links, bodies = np.random.default_rng(3), ['<link name="base_link"/>'], []
    for i, origin in enumerate(_ORIGINS):
        m, c = 8.0 / (i + 1), random.uniform(-0.1, 0.1, 3)
        xx, yy, zz, xy, xz, yz = *(0.02 * m * (1.0 + random.uniform(0.0, 0.3, 3))), *(0.003 * m * random.normal(size=3))
        inertia = np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]]) + m * (c @ c * np.eye(3) - np.outer(c, c))
        bodies += [*inertia[np.triu_indices(3)], *(m * c), m]
        name, before = ("wrist_3_link", "5") if i == 5 else (f"{i + 1}", f"{i}" if i else "base_link")
        links.append(
            f'<link name="{name}"><inertial><mass value="{m}"/><origin xyz="{c[0]} {c[1]} {c[2]}"/><inertia ixx="{xx}" '
            f'ixy="{xy}" ixz="{xz}" iyy="{yy}" iyz="{yz}" izz="{zz}"/></inertial></link><joint name="j{i}" '
            f'type="revolute"><parent link="{before}"/><child link="{name}"/><origin xyz="{origin}"/>'
            f'<axis xyz="{"0 0 1" if i in (0, 4) else "0 1 0"}"/>'
            '<limit effort="100" velocity="3" lower="-9" upper="9"/><dynamics friction="0" damping="0"/></joint>'
        )
    urdf = tmp_path / "URe" / "urdf" / "ur10e.urdf"
    urdf.parent.mkdir(parents=True)
    urdf.write_text(f'<robot name="ur10e">{"".join(links)}</robot>')
    arm = vdfmu.robot_from_urdf(urdf, base="base_link", tip="wrist_3_link")
    gains, J = np.linspace(8.0, 12.0, 6), arm.I_m * arm.ell
    friction = np.array([[3.0, 5.0, 0.1]] * 6)
    numbers = {"drvGains": gains, "pi_drvs": J, "pi_frcn": friction.ravel(), "pi_rgd": np.array(bodies)}
    text = "\n\n".join(f"{name} = [{'  '.join(map(repr, map(float, each)))}]" for name, each in numbers.items())
    (tmp_path / "UR10E_parameters.txt").write_text(text)

    dry = {"f_v": friction[:, 0], "f_c": friction[:, 1], "f_s": friction[:, 1]}
    arm = arm.with_parameters(**dry)
    load = np.array([2.8, 0.1, 0.4, 0.4, 0.2, 0.0, 0.2, 0.0, 0.0, 0.2])
    for seed, (name, (file, _, end)) in enumerate(measured_logs.UR10E.items()):
        t = 0.01 * np.arange(end)
        q, v, a = _sines(t, 6, 10 + seed)
        tau = _torques(arm, q, v, a) + stribeck_friction(arm, v) + friction[:, 2]
        if "load" in name:
            tau = tau + regressor(arm, q, v, a, v, a).links[:, :, -10:] @ load
        path = tmp_path / "dataset_ur10e" / file
        path.parent.mkdir(parents=True, exist_ok=True)
        np.savetxt(path, np.column_stack([t, q, v, tau / gains]), delimiter=",")
    measured_logs.ur10e(report, tmp_path)
    plain, loaded = report.tables
    assert [len(plain.rows), len(loaded.rows)] == [8, 4]
    # Of the authors' parameters nothing is left but what the filters do to a sign of 5 N.m that jumps within a row:
    # 0.1 N.m of torques of some 10. What is fitted has no constant torque of 0.1 N.m, or has it.
    assert all(max(row[2:]) < 1.0 for row in plain.rows[1::2])
    assert all(max(row[2:]) < 5.0 for row in [*plain.rows[::2], *loaded.rows[1::2]])
    mass = float(loaded.notes[0].split()[2])
    assert mass == pytest.approx(2.8, rel=0.02)  # 0.1 N.m of 28 N at arms of 0.3 m and more


def test_folders_are_asked_for(capsys):
    with pytest.raises(SystemExit) as exit_:
        measured.main([])
    assert exit_.value.code == 2
    assert "name at least one folder" in capsys.readouterr().err
