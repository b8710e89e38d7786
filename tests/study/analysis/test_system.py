"""Whole systems linearised by their FMUs: against masses on springs, the matrix exponential and the nonlinear run."""

import dataclasses

import numpy as np
import pytest
from scipy.linalg import expm

import vdfmu
from vdfmu.arm.equations.harmonic_drive import deformation_derivative
from vdfmu.base.errors import UsageError
from vdfmu.base.state_space import Linear
from vdfmu.study.analysis.loops import margins_along
from vdfmu.system.scenario import load_scenario

AT_REST = {  # the planar arm held where it starts, without dry friction
    "trajectory.q_end": [-1.2, 0.4], "trajectory.q_start": [-1.2, 0.4], "plant.q_0": [-1.2, 0.4],
    "plant.f_c": 0.0, "plant.f_s": 0.0, "feedforward.f_c": 0.0, "feedforward.f_s": 0.0,
}  # fmt: skip


def masses_and_springs():
    """Return the planar arm at rest, without coupled rotors, and the feedback of its controller, by hand."""
    robot, n = dataclasses.replace(vdfmu.load_robot("planar_2dof"), rotor_coupling=False), 2
    q = np.array([-1.2, 0.4])
    M = vdfmu.dynamics.mass_matrix(robot, q)
    e = 1e-6 * np.eye(n)
    slope = np.array(
        [(vdfmu.dynamics.gravity_torque(robot, q + d) - vdfmu.dynamics.gravity_torque(robot, q - d)) / 2e-6 for d in e]
    ).T
    stiffness = np.diag(1.0 / deformation_derivative(robot, vdfmu.dynamics.gravity_torque(robot, q)))
    zero, unit = np.zeros((n, n)), np.eye(n)
    rotor = unit / robot.I_m
    rows = [
        [zero, unit, zero, zero],
        [-np.linalg.solve(M, slope), zero, zero, np.linalg.inv(M)],
        [zero, zero, -np.diag(robot.f_v / robot.ell) @ rotor, -rotor / robot.ell],
        [zero, -stiffness, stiffness, zero],
    ]
    K = np.hstack([-np.diag([1500.0, 500.0]), zero, -np.diag([40.0, 20.0]), zero]) / robot.ell[:, None]
    return robot, Linear(np.block(rows), np.vstack([zero, zero, rotor, zero])), K


@pytest.mark.heavy
def test_the_closed_loop_is_plant_and_controller():
    robot, plant, K = masses_and_springs()
    scenario = load_scenario("planar_tracking", robot)
    closed = vdfmu.linearize(scenario, 0.0, parameters=AT_REST)
    assert closed.states[:2] == ("plant.q[1]", "plant.q[2]") and closed.state_units[6] == "N.m"
    # of the gravity's difference quotient, see above, times 1 / M of some 100
    np.testing.assert_allclose(closed.A, plant.A + plant.B @ K, rtol=1e-7, atol=1e-5)
    opened = vdfmu.linearize(scenario, 0.0, parameters=AT_REST, opened=["plant.tau"])
    np.testing.assert_allclose(opened.A, plant.A, rtol=1e-7, atol=1e-5)
    assert opened.outputs[-2:] == ("plant.tau[1]", "plant.tau[2]")
    np.testing.assert_allclose(opened.C[-2:], K, rtol=1e-12)


def test_sampling_without_feedback_is_the_matrix_exponential():
    settings = AT_REST | {"controller.K_p": 0.0, "controller.K_v": 0.0}
    continuous = vdfmu.linearize("planar_tracking", 0.0, parameters=settings)
    sampled = vdfmu.linearize("planar_tracking", 0.0, parameters=settings, sampled=True)
    # rounding of the exponential of a matrix of norm 100
    np.testing.assert_allclose(sampled.A[:8, :8], expm(1e-3 * continuous.A), atol=1e-10)


def test_an_input_is_opened_once():
    """However often it is named, so that names differ."""
    once = vdfmu.linearize("planar_tracking", 0.0, sampled=True, opened=["plant.tau"])
    again = vdfmu.linearize("planar_tracking", 0.0, sampled=True, opened=["plant.tau", "plant.tau[1]"])
    assert again.outputs == once.outputs and again.outputs[-2:] == ("plant.tau[1]", "plant.tau[2]")


@pytest.mark.heavy
def test_what_cannot_be_linearised_is_said():
    for call, message in (
        (lambda: margins_along("planar_tracking", ["plant.q"], [0.0]), "plant.q: expected connected continuous inputs"),
        (lambda: vdfmu.linearize("planar_tracking", 0.0, backend="python"), "plant: expected FMUs with directional"),
        (
            lambda: vdfmu.linearize("planar_tracking", [0.1, 0.2]),
            "expected a Robot, got str .* For a scenario or a package give a time in s instead of positions",
        ),
        (lambda: vdfmu.linearize("planar_tracking", -1.0), "at: expected a time of the run from 0 s"),
        (lambda: margins_along("planar_tracking", at=[np.nan]), "at: expected .* got nan s"),
        (lambda: margins_along("planar_tracking", at=[1e308]), r"at: expected .* got 1e\+308 s"),
        (lambda: margins_along("planar_tracking", at=[2.5, 1.0]), "at: expected 0 s to 2 s, got 2.5 s"),
        (lambda: vdfmu.linearize("planar_tracking", "x"), "at: expected a number, or a list"),
        (lambda: vdfmu.linearize("planar_tracking", 0.1, dry=True), "dry: applies only to an arm"),
    ):
        with pytest.raises(UsageError, match=message):
            call()


@pytest.mark.parametrize("options", [{"sampled": True}, {"opened": ["plant.tau"]}, {"backend": "native"}], ids=str)
def test_what_is_for_systems_is_refused_for_an_arm(planar, options):
    with pytest.raises(UsageError, match=f"{next(iter(options))}.*for systems at a time"):
        vdfmu.linearize(planar, (0.3, -0.5), **options)
