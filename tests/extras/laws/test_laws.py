"""Control laws: what they compute against Pinocchio, and their loops against closed forms of one joint."""

import dataclasses

import numpy as np
import pinocchio as pin
import pytest

import vdfmu
from tests.arm.dynamics.conftest import build_pinocchio_model
from tests.arm.dynamics.rotor_bodies import RotorBodies
from tests.arm.units.one_joint import one_joint
from vdfmu.arm.robot import Robot
from vdfmu.arm.units import find_unit

LAWS = ("computed_torque", "joint_torque", "pd_gravity", "state_feedback")
SAMPLED = ("disturbance_observer", "iterative_learning", "virtual_decomposition")
K_P, K_V = 300.0, 12.0


def deformation(robot: Robot, torque: np.ndarray) -> np.ndarray:
    """Deformation of the drives, (2)-(3) solved for it, in numpy alone."""
    a, sign = np.abs(torque) / robot.ell, np.sign(torque)
    flexspline = np.arctan(robot.c_f * torque) / (robot.c_f * robot.K_f0)
    return flexspline + sign * (1.0 - np.exp(-robot.c_w * a)) / (robot.c_w * robot.ell * robot.K_w0)


def rotors_too(robot: Robot) -> pin.Model:
    if robot.rotor_coupling:
        return RotorBodies(robot).model
    model = build_pinocchio_model(robot)
    model.armature = robot.ell * robot.I_m
    return model


@pytest.mark.parametrize("law", LAWS + SAMPLED)
def test_torque_keeps_within_its_limit_and_comes_back_at_once(law, planar):
    """Nothing winds up; the estimate of the disturbance, which takes its time constant, has a test of its own."""
    unit, free = find_unit(law)(planar, q_d=[3.0, 3.0], tau_max=[0.05, 0.02]), find_unit(law)(planar)
    for each in (unit, free):
        each.start(), each.update(), each.outputs()
    assert np.array_equal(unit.tau, [0.05, 0.02])
    if law != "disturbance_observer":
        unit.q_d = np.zeros(2)
        unit.update(), unit.outputs()
        assert np.array_equal(unit.tau, np.clip(free.tau, [-0.05, -0.02], [0.05, 0.02]))


def test_computed_torque_is_the_inverse_dynamics_of_the_rigid_arm(chain, draw):
    """With rotors that turn as their links do, the torque on each is that of Pinocchio's whole system."""
    model = rotors_too(chain)
    data, n = model.createData(), chain.n
    for state in draw(chain, 10, seed=1):
        unit = find_unit("computed_torque")(
            chain, q=state.q, q_dot=state.q_dot, kappa_dot=state.q_dot, q_d=state.q + 0.1, q_d_dot=state.q_dot - 0.2,
            q_d_ddot=state.q_ddot, k_p=K_P, k_v=K_V, K_v=0.0,
        )  # fmt: skip
        unit.outputs()
        a = state.q_ddot + 0.1 * K_P - 0.2 * K_V
        if model.nv == n:
            torque = pin.rnea(model, data, state.q, state.q_dot, a)
        else:
            turned = [np.concatenate([x, chain.ell * x]) for x in (state.q, state.q_dot, a)]
            both = pin.rnea(model, data, *turned)
            torque = both[:n] + chain.ell * both[n:]
        # some 5000 roundings of the largest
        np.testing.assert_allclose(chain.ell * unit.tau, torque, rtol=0, atol=1e-12 * np.abs(torque).max())


def test_virtual_decomposition_along_its_motion_is_the_inverse_dynamics_of_the_rigid_arm(chain, draw):
    """With true parameters of bodies, and none of joints, the torque is that of Pinocchio's links."""
    model = build_pinocchio_model(chain)
    data, none = model.createData(), np.zeros((chain.n, 3))
    for state in draw(chain, 10, seed=7):
        unit = find_unit("virtual_decomposition")(
            chain, theta_0=none, q=state.q, q_d=state.q, q_dot=state.q_dot, q_d_dot=state.q_dot, kappa_dot=state.q_dot,
            q_d_ddot=state.q_ddot,
        )  # fmt: skip
        unit.start(), unit.update()
        torque = pin.rnea(model, data, state.q, state.q_dot, state.q_ddot)
        # some 5000 roundings of the largest
        np.testing.assert_allclose(chain.ell * unit.tau, torque, rtol=0, atol=1e-12 * np.abs(torque).max())


@pytest.mark.parametrize("law", ["pd_gravity", "joint_torque", "state_feedback"])
def test_laws_with_gravity_hold_the_arm_with_its_springs_deflected(law, chain, draw):
    """At rest at q_d with the rotors at kappa_d the torque is gravity's; a rotor that is off is drawn by K_p."""
    model, random = build_pinocchio_model(chain), np.random.default_rng(2)
    data = model.createData()
    for state in draw(chain, 10, seed=3):
        gravity = pin.computeGeneralizedGravity(model, data, state.q)
        kappa = state.q + deformation(chain, gravity)
        for _ in range(60):  # a contraction by at least a half
            error = chain.theta_err_amplitude * np.sin(2.0 * chain.ell * kappa + chain.theta_err_phase)
            kappa = state.q + deformation(chain, gravity) + error
        off, slow = 1e-3 * random.normal(size=(2, chain.n))
        unit = find_unit(law)(chain, q_d=state.q, q_d_dot=slow, kappa=kappa - off, kappa_dot=0.0)
        if law == "state_feedback":
            unit.q = state.q
            unit.K_kappa, unit.K_kappa_dot = K_P * np.eye(chain.n), K_V * np.eye(chain.n)
        else:
            unit.K_p, unit.K_v = K_P, K_V
        expected = gravity + K_P * off + K_V * slow
        if law == "joint_torque":
            unit.tau_s, unit.share = 0.4 * gravity, 0.25
            expected = 0.4 * gravity + 4.0 * (expected - 0.4 * gravity)
        unit.outputs()
        # gravity as above, 4 of it; K_p on kappa, of up to 2 pi, of which a rounding is 1e-15
        np.testing.assert_allclose(
            chain.ell * unit.tau, expected, rtol=0, atol=1e-11 * max(np.abs(gravity).max(), 1.0) + 1e-15 * 10 * K_P
        )


def test_gravity_turns_with_a_moving_base(planar):
    """A base that is turned by half a turn about the axis across gravity hangs the arm upside down."""
    robot = dataclasses.replace(planar, moving_base=True)
    unit = find_unit("pd_gravity")(robot, R_S=np.diag([1.0, -1.0, -1.0]), K_p=0.0)
    unit.outputs()
    up = find_unit("pd_gravity")(planar, K_p=0.0)
    up.outputs()
    np.testing.assert_allclose(unit.tau, -up.tau, rtol=0, atol=1e-15)  # the same products with another sign


@pytest.mark.parametrize("law", LAWS)
def test_poles_of_one_joint_are_those_of_the_closed_form(law):
    """M q_ddot = K (kappa - q), J kappa_ddot = ell tau - K (kappa - q)."""
    robot = one_joint()
    K = 1.0 / (1.0 / robot.K_f0[0] + 1.0 / (robot.ell[0] ** 2 * robot.K_w0[0]))
    M, J = vdfmu.dynamics.mass_matrix(robot, np.zeros(1))[0, 0], (robot.ell * robot.I_m)[0]
    share, k_p, k_v = 0.3, 90.0, 15.0
    # gains of ell tau on q, q_dot, kappa, kappa_dot, and the rest of the rotor's inertia
    gains, left, parameters = {
        "pd_gravity": ((0.0, 0.0, K_P, K_V), 1.0, {"K_p": K_P, "K_v": K_V}),
        "joint_torque": ((0.0, 0.0, K_P, K_V), share, {"K_p": K_P, "K_v": K_V, "share": share}),
        "state_feedback": (
            (700.0, 30.0, -200.0, 40.0), 1.0,
            {"K_q": [[700.0]], "K_q_dot": [[30.0]], "K_kappa": [[-200.0]], "K_kappa_dot": [[40.0]]},
        ),
        "computed_torque": (
            ((M + J) * k_p, M * k_v, 0.0, J * k_v + K_V), 1.0, {"k_p": k_p, "k_v": k_v, "K_v": K_V}
        ),
    }[law]  # fmt: skip
    a, b, c, d = gains
    links, rotors = np.array([M, 0.0, K]), np.array([left * J, d, c + K])
    expected = np.polysub(np.polymul(links, rotors), np.polymul([K], [-b, K - a]))
    feedback = find_unit(law)(robot, **parameters).linearize()
    arm = vdfmu.linearize(robot, at=[0.0])
    D = {name.partition("[")[0]: feedback.D[-1, i] for i, name in enumerate(feedback.inputs)}
    D |= {"kappa": D.get("kappa", 0.0)}
    gain = np.array([[D.get(name.partition("[")[0], 0.0) for name in arm.outputs[: arm.outputs.index("p_O[1]")]]])
    poles = np.linalg.eigvals(arm.A + arm.B[:, :1] @ gain @ arm.C[: gain.size])
    # the coefficients of a polynomial are as exact as the gains: some 20 roundings
    np.testing.assert_allclose(np.poly(poles), expected / expected[0], rtol=1e-10)
