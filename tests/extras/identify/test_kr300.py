"""Ways to identify a measured arm, on made-up logs of a rigid one; no assertion on any time."""

import logging
import subprocess
import sys
from types import SimpleNamespace

import numpy as np
import pytest
import scipy.io

from benchmarks import kr300
from vdfmu.arm.equations.rigid_body import body_parameters
from vdfmu.arm.robot import load_robot
from vdfmu.base.files import data_path
from vdfmu.extras.identify.log import Log, read_log
from vdfmu.extras.identify.problem import regressor

H = 0.01
T = H * np.arange(1501)


def rigid_log(robot, seed):
    """Return a log of a rigid arm with rotors, Coulomb and viscous friction, along sines of 0.1 to 0.5 Hz."""
    random = np.random.default_rng(seed)
    w = 2 * np.pi * np.array([0.1, 0.2, 0.3, 0.5])[:, None, None]
    size, phase = random.uniform(0.2, 0.5, (4, 1, robot.n)), random.uniform(0.0, 6.0, (4, 1, robot.n))
    angle = w * T[:, None] + phase
    q, q_dot, q_ddot = (
        (size * each).sum(axis=0) for each in (np.sin(angle), w * np.cos(angle), -(w**2) * np.sin(angle))
    )
    tau = regressor(robot, q, q_dot, q_ddot, 0.0 * q, 0.0 * q).links @ body_parameters(robot)
    tau += robot.I_m * robot.ell * q_ddot + robot.f_c * np.tanh(q_dot / robot.eps) + robot.f_v * q_dot
    return Log("made up", T, q, tau / robot.ell, None)


@pytest.mark.heavy
def test_the_toolbox_finds_the_arm(monkeypatch):
    """With stand-ins for two packages with which the toolbox prints, which the tests do not install."""
    for name in [name for name in sys.modules if name.startswith("mujoco.sysid")]:
        monkeypatch.delitem(sys.modules, name)
    monkeypatch.setitem(sys.modules, "absl", SimpleNamespace(logging=logging))
    monkeypatch.setitem(sys.modules, "tabulate", SimpleNamespace(tabulate=str))
    robot, said = load_robot("planar_2dof"), []
    guess = robot.with_parameters(mass=1.1 * robot.mass, f_v=0.8 * robot.f_v)
    fits = kr300.study(guess, rigid_log(robot, 1), rigid_log(robot, 2), said.append, 5)
    assert said == [fit.method for fit in fits[-2:]]
    # the true arm leaves 2.4e-3 in MuJoCo, whose friction has another slope about standstill than the log
    assert np.max([fit.residual for fit in fits[-2:]]) < 5e-3


def test_a_log_from_a_public_record_counts_from_its_start(tmp_path, capfd):
    """Positions in degrees from the pose 0, -90, 90, 0, 0, 0; encoders behind the gears of axes 1 to 3 only."""
    arm, random, t = load_robot("kr_6dof"), np.random.default_rng(0), 0.004 * np.arange(600)
    mot = np.cumsum(np.cumsum(random.normal(size=(6, 600)), axis=1), axis=1) * 1e-3
    rec = {
        "time_cont": t,
        "act_pos_mot_deg": mot,
        "act_pos_se_deg": mot,
        "act_torque_abs_nm": random.normal(size=(6, 600)),
    }
    record, made = tmp_path / "data.mat", tmp_path / "log.csv"
    script = [sys.executable, data_path("examples") / "kr300" / "log.py", record, made]
    scipy.io.savemat(record, {"rec": rec})
    subprocess.run(script, check=True)
    log = read_log(made, arm)
    start = np.deg2rad([0, -90, 90, 0, 0, 0])
    np.testing.assert_allclose(log.kappa, np.deg2rad(mot.T) + start, rtol=1e-14, atol=1e-16)
    np.testing.assert_allclose(log.q[:, :3], log.kappa[:, :3], rtol=1e-14)
    assert np.isnan(log.q[:, 3:]).all()
    np.testing.assert_array_equal(log.tau, rec["act_torque_abs_nm"].T)  # motor-side, as it is
    motors = np.deg2rad([0, -80, 90, 0, 0, 0]) * arm.ell
    ratios = {"para": {"u": arm.ell}, "ref_dyn": {"phi_r_m_all": np.tile(motors, (600, 1))}}
    scipy.io.savemat(record, {"rec": rec, **ratios})
    assert subprocess.run(script).returncode == 1
    assert "expected a start at [  0. -90.  90." in capfd.readouterr().err
