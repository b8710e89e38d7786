"""A drive of one's own, by a file: its laws in plant, inverse and energies, in a robot file and in a scenario."""

import json
import os
import pickle
import re
import zipfile
from pathlib import Path

import numpy as np
import pytest

import vdfmu
from vdfmu.arm.equations.feedforward import feedforward_inverse
from vdfmu.arm.equations.flexible_joint import drive_losses, split_state, spring, state_names
from vdfmu.arm.equations.friction import joint_friction
from vdfmu.arm.equations.inverse_dynamics import inverse_dynamics
from vdfmu.arm.equations.mapping import joint_space_mass_matrix
from vdfmu.arm.equations.plant import plant_derivative, plant_outputs
from vdfmu.arm.equations.trajectory import desired_motion
from vdfmu.arm.fmus import build_fmus
from vdfmu.arm.robot import load_robot, robot_from_dict
from vdfmu.arm.robot.parameters import PARAMETERS
from vdfmu.arm.units.plant import Plant
from vdfmu.base.errors import ModelError, UnitError
from vdfmu.base.files import data_path
from vdfmu.base.trust import CodeNotRunError, announced_to, reading_only
from vdfmu.compiler.fmu.content import Content
from vdfmu.compiler.unit.interface import Interface
from vdfmu.system.inspect_source import inspect_source
from vdfmu.system.scenario import load_scenario

EXAMPLE = Path(vdfmu.__file__).parents[1] / "examples" / "own_drive"
TEXT = (EXAMPLE / "cubic_drive.py").read_text(encoding="utf-8")
FREE = np.zeros(6)
LIMITS = {
    "q_min": -2.0, "q_max": 2.0, "stop_stiffness": 1e4, "stop_damping": 1.0, "tau_stall": 9.0, "kappa_dot_max": 9.0
}  # fmt: skip


def made(text=TEXT, **tables):
    """Return the planar arm with rotors in pure rotation and a drive of its own."""
    data = load_robot("planar_2dof").to_dict() | {"drive": "my_drive.py", "rotor_coupling": False}
    for joint, K_1 in zip(data["joints"], (12e3, 6e3), strict=True):
        joint |= tables or {"cubic": {"K_1": K_1}, "warm": {"T_s": 30.0}}
    return robot_from_dict(data, files={"my_drive.py": text})


@pytest.fixture(scope="module")
def robot():
    return made()


def draw_state(robot, seed):
    random = np.random.default_rng(seed)
    sizes = {"q": 1.0, "q_dot": 1.0, "kappa_dot": 1.0, "tau_s": 30.0, "tau_c": 1.5, "T_f": 15.0}
    parts = {name: random.uniform(-size, size, robot.n) for name, size in sizes.items()}
    parts["T_f"] = parts["T_f"] + 310.0
    return np.concatenate(list(parts.values())), random.uniform(-0.5, 0.5, robot.n)


@pytest.mark.parametrize("seed", range(5))
def test_the_plant_is_the_arm_on_cubic_springs_with_hysteresis_and_warm_friction(robot, seed):
    """Links by the mass matrix, springs in the form that is explicit in the torsion, which the file never writes."""
    x, tau = draw_state(robot, seed)
    q, q_dot, kappa_dot, tau_s, tau_c, T_f = np.split(x, 6)
    rates = split_state(robot, plant_derivative(robot, x, tau, FREE))
    torsion = plant_outputs(robot, x).kappa - q
    np.testing.assert_allclose(
        robot.K_1 * (torsion + torsion**3 / robot.x_1**2), tau_s, rtol=1e-12
    )  # some 50 roundings
    stretch = kappa_dot - q_dot
    stiffness = robot.K_1 * (1.0 + 3.0 * (torsion / robot.x_1) ** 2)
    np.testing.assert_allclose(rates.tau_s, stiffness * stretch, rtol=1e-12)
    load = tau_s + tau_c
    slip = robot.K_c * (stretch - np.abs(stretch) * tau_c / robot.f_h3)
    np.testing.assert_allclose(rates.options["tau_c"], slip, rtol=1e-12)
    level = robot.f_c + (robot.f_s - robot.f_c) * np.exp(-((kappa_dot / robot.v_s) ** 2))
    xi = level * np.exp((robot.T_0 - T_f) / robot.T_s) * np.tanh(kappa_dot / robot.eps) + robot.f_v * kappa_dot
    links = load - inverse_dynamics(robot, q, q_dot, np.zeros(2))
    M = joint_space_mass_matrix(robot, q)
    # the condition of M, some 50, times some 100 roundings of 100 N m
    np.testing.assert_allclose(M @ rates.q_dot, links, rtol=0, atol=1e-11)
    np.testing.assert_allclose(rates.kappa_dot, (tau - (load + xi) / robot.ell) / robot.I_m, rtol=1e-12, atol=1e-10)
    heat = xi * kappa_dot + np.abs(stretch) * tau_c**2 / robot.f_h3
    np.testing.assert_allclose(drive_losses(robot, split_state(robot, x)), heat, rtol=1e-12)
    rate = (heat - robot.G_f * (T_f - robot.T_0)) / robot.C_f
    np.testing.assert_allclose(rates.options["T_f"], rate, rtol=1e-12, atol=1e-15)


def test_the_inverse_uses_the_spring_and_the_energy_is_the_work_on_it(robot):
    """Along a planned motion there is no hysteresis, and the joint has the temperature of the surroundings."""
    desired = desired_motion(0.4, np.array([-0.2, 0.1]), np.array([1.0, 1.4]), 2.0)
    torques = feedforward_inverse(robot, desired)
    x = np.concatenate([desired.q_d, desired.q_d_dot, torques.kappa_dot_d, torques.tau_s, np.zeros(2), robot.T_0])
    rates = split_state(robot, plant_derivative(robot, x, torques.tau_m, FREE))
    # 1e-16 of torques of 100 N m over masses of 1e-2 kg m2
    np.testing.assert_allclose(rates.q_dot, desired.q_d_ddot, rtol=0, atol=1e-11)
    h, t = 1e-4, 0.4
    ahead, behind = (
        feedforward_inverse(robot, desired_motion(t + s * h, np.array([-0.2, 0.1]), np.array([1.0, 1.4]), 2.0))
        for s in (1, -1)
    )
    # h^2 / 6 of fourth derivatives of kappa_d_dot, some 1e3; 1e-16 / h of speeds near 1
    rate = (ahead.kappa_dot_d - behind.kappa_dot_d) / (2 * h)
    np.testing.assert_allclose(rates.kappa_dot, rate, rtol=0, atol=1e-5)
    torque = np.linspace(0.0, 40.0, 20001)[:, None] * np.ones(2)
    work = np.trapezoid(torque, spring(robot, torque).deformation, axis=0)
    # trapezoids of 2e-3 N m: their square over 12, times the curvature
    np.testing.assert_allclose(spring(robot, torque[-1]).energy, work, rtol=1e-7)


def test_a_robot_carries_the_text_of_its_drive_beside_its_data(robot, planar):
    assert state_names(robot)[4:] == ["tau_c", "T_f"]
    assert robot.to_dict()["drive"] == "my_drive.py" and robot.files == {"my_drive.py": TEXT}
    assert robot_from_dict(robot.to_dict(), files=robot.files).to_dict() == robot.to_dict()
    again = pickle.loads(pickle.dumps(robot))
    assert again.to_dict() == robot.to_dict() and again.key() == robot.key()
    other = made(TEXT + "# edited\n")
    assert other.key() != robot.key() != planar.key()  # what was traced of one text is not taken for another
    assert robot.with_parameters(K_1=1e4).K_1.tolist() == [1e4, 1e4]
    assert planar.rows is PARAMETERS and not {"K_1", "T_s"} & {*PARAMETERS}


def test_a_robot_file_names_the_file_of_its_drive_and_a_scenario_gives_one(tmp_path, monkeypatch):
    (tmp_path / "my_drive.py").write_text(TEXT)
    shipped = (data_path("models") / "robots" / "planar_2dof.toml").read_text(encoding="utf-8")
    text = shipped.replace('friction = "lumped"', 'friction = "lumped"\ndrive = "my_drive.py"', 1)
    text = text.replace("[joints.link]", "[joints.cubic]\nK_1 = 9e3\n[joints.warm]\nT_s = 20.0\n[joints.link]")
    (tmp_path / "arm.toml").write_text(text)
    monkeypatch.chdir(tmp_path.parent)
    robot = load_robot(f"{tmp_path.name}/arm.toml")
    assert robot.K_1.tolist() == [9e3, 9e3] and robot.drive.text.startswith('"""A custom drive')
    scenario = load_scenario(str(EXAMPLE / "track.toml"))
    assert scenario.robot.K_1.tolist() == [12e3, 6e3] and scenario.robot.T_s.tolist() == [30.0, 30.0]


@pytest.mark.heavy
def test_the_example_runs_as_its_reference():
    run = vdfmu.run(str(EXAMPLE / "track.toml"), stop=0.3, out=False)
    assert np.abs(run["plant.tau_c"]).max() > 0.1  # it acts
    assert {check["state"] for check in run.summary["verdict"]["checks"]} == {"good"}
    difference = run.summary["reference"]["sampled"]["max_position_difference_rad"]
    assert difference < 1e-8  # local errors of 1e-7 of either solver, seen 4e-10


HEAD = "from dataclasses import dataclass\nfrom vdfmu.drive import *\n"
ROWS = HEAD + "@dataclass(frozen=True, eq=False, kw_only=True)\nclass Rows:\n    {}: Array = row('mine', '1', 'x')\n"
LAW = "def law(friction, robot, sliding, state):\n    return {}\nMINE = DriveOption(friction=law)\n"
STATE = HEAD + "MINE = DriveOption(state=OptionState('tau_s', '1', 'x', 'y'))\n"


@pytest.mark.parametrize(("text", "message"), [
    ("x = \n", r"my_drive\.py, line 1: invalid syntax"),
    ("x = 1\ny = 1 / 0\n", r"my_drive\.py, line 2: .*division by zero"),
    ("import sys\nsys.exit(0)\n", r"my_drive\.py, line 2: SystemExit"),
    ("x = 1\n", r"my_drive\.py must have a DriveOption of vdfmu\.drive"),
    (ROWS.format("K_f0") + "MINE = DriveOption()\n", r"K_f0: every arm already has such names"),
])  # fmt: skip
def test_a_file_that_is_no_drive_is_refused(text, message):
    with pytest.raises(ModelError, match=message) as refused:
        made(text, mine={})
    assert "mine" not in str(refused.value)  # whether a table is known depends on the drive


@pytest.mark.parametrize(("drive", "message"), [
    ("no_such.py", r"drive must be a Python file, got 'no_such.py': No such file"),
    ("pipe", r"drive must be a Python file, got 'pipe': it is a pipe, a device or another special file"),
    ("/dev/zero", r"drive must be a Python file, got '/dev/zero': it is a pipe, a device"),
    ("large.py", r"drive must be a Python file, got 'large.py': it has more than the 1 MiB that are read"),
    ("import os\nos.abort()\n", r"code is not run from inside a data file"),
])  # fmt: skip
def test_a_drive_is_a_regular_file_and_no_text(tmp_path, planar, drive, message):
    os.mkfifo(tmp_path / "pipe")
    (tmp_path / "large.py").write_bytes(b"#" * 2**21)
    with pytest.raises(ModelError, match=message):
        robot_from_dict(planar.to_dict() | {"drive": drive}, str(tmp_path / "arm.toml"))


@pytest.mark.few(1)
@pytest.mark.parametrize("backend", ["python", "native"])
def test_an_fmu_carries_the_drive_as_a_file_and_no_code_in_its_data(robot, tmp_path, backend):
    """The record of a native FMU is for people; a Python FMU makes its robot again from both."""
    file = build_fmus(robot, tmp_path, units=["feedforward"], backend=backend, folded=True)["feedforward"]
    with zipfile.ZipFile(file) as fmu:
        folder = {"python": "resources", "native": "extra/vdfmu"}[backend]
        data = json.loads(fmu.read(f"{folder}/vdfmu.json"))
        assert fmu.read(f"{folder}/robot/my_drive.py").decode() == TEXT
        fmu.extractall(tmp_path / "unpacked")
    assert data["robot"]["drive"] == "my_drive.py" and "DriveOption" not in json.dumps(data)
    if backend == "python":
        again = Content.read(tmp_path / "unpacked" / "resources", "Feedforward").robot
        assert again.to_dict() == robot.to_dict(looks=False) and again.files == robot.files


@pytest.mark.few(1)
@pytest.mark.parametrize("law", [
    "friction._replace(dry=0.1 * sliding)",  # a record, not an array
    "friction._replace(dry=friction.dry if sliding.velocity[0] > 0.0 else friction.dry)",  # works on numbers alone
])  # fmt: skip
def test_a_law_that_fails_has_its_own_line_in_the_message_and_check_finds_it(tmp_path, law):
    (tmp_path / "my_drive.py").write_text(HEAD + LAW.format(law))
    track = (EXAMPLE / "track.toml").read_text(encoding="utf-8")
    track = re.sub(r"(?m)^(cubic|warm) = .*$", "", track).replace("cubic_drive.py", "my_drive.py")
    (tmp_path / "track.toml").write_text(track)
    (problem,) = inspect_source(tmp_path / "track.toml", "planar_2dof").problems
    assert re.search(r"drive(\.py)?, line 4: \w+\(\) of (Feedforward|Plant) (fails|cannot be traced): ", problem)


@pytest.mark.parametrize(
    ("text", "name"), [(STATE, "tau_s"), (ROWS.format("tau") + "MINE = DriveOption()\n", "tau")], ids=["state", "row"]
)
def test_a_name_of_the_plant_is_refused(text, name):
    robot = made(text, **({"mine": {"tau": 1.0}} if name == "tau" else {"limits": LIMITS}))
    with pytest.raises(UnitError, match=rf"^.*\b{name}\b.* Rename"):
        Interface(Plant, robot)


def test_a_number_that_is_missing_has_its_place_and_no_drive_is_run_where_files_are_only_read(robot, planar):
    with pytest.raises(ModelError, match=r"joints\[2\]\.cubic\.K_1: expected a finite number > 0 in N\.m/rad"):
        made(cubic={}, warm={"T_s": 30.0})
    with announced_to(reading_only), pytest.raises(CodeNotRunError):
        made(TEXT + "# another\n")
    speed = np.array([0.3, -0.4])
    warm, cold = (joint_friction(arm, speed, speed)[1] for arm in (robot, planar))
    np.testing.assert_array_equal(warm, cold)
