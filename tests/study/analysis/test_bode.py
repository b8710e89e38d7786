"""Frequency responses: the closed form of two masses on a spring, and MuJoCo's derivatives of the same arm."""

import dataclasses

import mujoco
import numpy as np
import pytest

import vdfmu
from tests.conftest import invoked, ran
from tests.study.analysis.lift import MASS, POSES
from tests.study.analysis.lift import roots as poles_of
from vdfmu.arm.equations.harmonic_drive import deformation_derivative
from vdfmu.base.errors import UsageError
from vdfmu.study.analysis.bode import bode, joint_bode


@pytest.fixture
def smooth(lift):
    return lift.with_parameters(f_v=0.0)


def test_two_masses_on_a_spring_have_their_resonance_and_anti_resonance(smooth):
    _, K, J = poles_of(smooth, 0.0)
    curves = joint_bode(smooth, [0.1], 1)
    # rounding of eigenvalues: 1e-16 of the norm of A, 1e5, over 300 rad/s
    assert curves.resonance == pytest.approx(np.sqrt(K * (1 / J + 1 / MASS)) / (2 * np.pi), rel=1e-9)
    assert curves.antiresonance[0] == pytest.approx(np.sqrt(K / MASS) / (2 * np.pi), rel=1e-9)
    assert not curves.antiresonance[1].size
    s = 2j * np.pi * curves.frequency
    near = np.min(np.abs(curves.frequency[:, None] - curves.resonance), axis=1) < 1e-3 * curves.resonance[0]
    # a motor torque acts as ell times as much on the link side
    ell = float(smooth.ell[0])
    whole = s * (J * MASS * s**2 + K * (J + MASS))
    rotor, link = ell * (MASS * s**2 + K) / whole, ell * K / whole
    size = np.abs(rotor) + np.abs(link)
    for mine, other in zip(curves.response, (rotor, link), strict=True):
        # beside the pole, of which both are infinite: rounding of 1e-16 times 1e5, over 1e-3 of the pole's square
        np.testing.assert_allclose((mine / size)[~near], (other / size)[~near], atol=1e-8)


def mjcf(robot):
    """Return the arm and its rotors, which tendons join to the links, with the stiffness at the pose."""
    body, rotors = "", ""
    for i in range(robot.n):
        quat = np.zeros(4)
        mujoco.mju_mat2Quat(quat, robot.rotation[i].ravel())
        full, J = robot.inertia[i], text(3 * [robot.I_m[i] * robot.ell[i]])
        six = text([*np.diag(full), full[0, 1], full[0, 2], full[1, 2]])
        body += (
            f'<body pos="{text(robot.offset[i])}" quat="{text(quat)}"><joint name="q{i}" axis="0 0 1"/>'
            f'<inertial pos="{text(robot.centroid[i])}" mass="{text([robot.mass[i]])}" fullinertia="{six}"/>'
        )
        rotors += (
            f'<body><joint name="k{i}" axis="0 0 1" damping="{text([robot.f_v[i]])}"/>'
            f'<inertial pos="0 0 0" mass="1" diaginertia="{J}"/></body>'
        )
    return body + robot.n * "</body>", rotors


def text(values):
    return " ".join(repr(float(v)) for v in values)


def test_the_arm_has_mujocos_transition():
    """The planar arm with springs of the slope at the pose: MuJoCo's semi-implicit Euler step, differenced."""
    robot = dataclasses.replace(vdfmu.load_robot("planar_2dof"), rotor_coupling=False)
    n, q, h = robot.n, np.array(POSES["planar_2dof"]), 1e-3
    system = vdfmu.linearize(robot, q)
    held = vdfmu.dynamics.gravity_torque(robot, q)
    K = 1.0 / np.asarray(deformation_derivative(robot, held))
    arm, rotors = mjcf(robot)
    tendons = "".join(
        f'<fixed name="t{i}" stiffness="{float(K[i])!r}" springlength="0">'
        f'<joint joint="q{i}" coef="1"/><joint joint="k{i}" coef="-1"/></fixed>'
        for i in range(n)
    )
    motors = "".join(f'<motor joint="k{i}" gear="{float(robot.ell[i])!r}"/>' for i in range(n))
    model = mujoco.MjModel.from_xml_string(
        f'<mujoco><compiler angle="radian" balanceinertia="false"/><option timestep="{h}" integrator="Euler" '
        f'gravity="0 0 {-float(robot.gravity[2])!r}"><flag eulerdamp="disable" contact="disable"/></option>'
        f"<worldbody>{arm}{rotors}</worldbody><tendon>{tendons}</tendon><actuator>{motors}</actuator></mujoco>"
    )
    data = mujoco.MjData(model)
    data.qpos[:] = [*q, *(q + held / K)]
    data.ctrl[:] = held / robot.ell
    A, B = np.zeros((4 * n, 4 * n)), np.zeros((4 * n, n))
    mujoco.mj_forward(model, data)
    # accelerations of 1e-9 rad/s2: rounding of torques of 10 N.m over inertias of 1e-3 kg m2
    np.testing.assert_allclose(data.qacc, 0.0, atol=1e-8)
    mujoco.mjd_transitionFD(model, data, 1e-6, True, A, B, None, None)
    # v+ = v + h a(q, v): the slopes of the accelerations of links and rotors by positions and velocities
    slopes = (A[2 * n :] - np.hstack([np.zeros((2 * n, 2 * n)), np.eye(2 * n)])) / h
    by_torque = B[2 * n :] / h
    # ours has tau_s = K (kappa - q) for kappa
    place = {name: i for i, name in enumerate(system.states)}
    rows = [place[f"{g}[{i + 1}]"] for g in ("q_dot", "kappa_dot") for i in range(n)]
    mine = system.A[rows]
    q_, qd, kd, t = np.split(np.arange(4 * n), 4)
    mine = np.hstack([mine[:, q_] - mine[:, t] * K, mine[:, t] * K, mine[:, qd], mine[:, kd]])
    # differences of 1e-6: curvature 1e-12 and rounding 1e-16 of 1e4 rad/s2 over 1e-6, of slopes of 1e5 and less
    np.testing.assert_allclose(slopes, mine, rtol=1e-6, atol=1e-3)
    np.testing.assert_allclose(by_torque, system.B[rows][:, :n], rtol=1e-6, atol=1e-6)


@pytest.mark.heavy
def test_the_command_draws_a_joint(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    said = ran("linear", "planar_2dof", "--pose", "0.3 -0.5", "--bode", "2")
    assert (tmp_path / "planar_2dof_bode.png").read_bytes().startswith(b"\x89PNG")
    curves = joint_bode(vdfmu.load_robot("planar_2dof"), [0.3, -0.5], 2)
    assert all(f"{f:.2f}" in said.output for f in (*curves.resonance, *curves.antiresonance[0]))
    for options, message in (
        (["--bode", "3"], "--bode 3: expected a joint, 1 to 2"),
        (["--bode", "1", "--modes"], "--modes is for a scenario, and planar_2dof is a robot"),
    ):
        failed = invoked("linear", "planar_2dof", *options, "--overwrite")
        assert isinstance(failed.exception, UsageError) and message in str(failed.exception), options
        assert "Hz" not in failed.output  # it fails before it prints anything


def test_signals_that_are_not_there_are_named(smooth):
    with pytest.raises(UsageError, match=r"expected a system in continuous time with tau\[2\], q\[1\]; inputs are tau"):
        bode(vdfmu.linearize(smooth, [0.1]), "tau[2]", ["q[1]"])
