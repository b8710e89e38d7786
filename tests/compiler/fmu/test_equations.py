"""Each unit computes the equations: the FMU against the plain numpy functions, with parameters that were set."""

from typing import Any

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from tests.arm.laws.ends import rounded_ends
from tests.compiler.conftest import EACH
from vdfmu.arm.equations.feedforward import FeedbackGains, feedforward_inverse, feedforward_vdc
from vdfmu.arm.equations.pd import pd_control
from vdfmu.arm.equations.plant import equilibrium_torque, plant_derivative, plant_outputs
from vdfmu.arm.equations.torque_estimation import torque_estimates
from vdfmu.arm.equations.trajectory import Desired, desired_motion
from vdfmu.arm.robot import Robot, check_robot
from vdfmu.arm.robot.parameters import SPRING_KEYS

# The FMU runs the traced equations, numpy the same ones as written: they differ by the rounding of some hundred
# operations, 1e-16 each, relative to the largest term, which is at most 100 times the result here.
ROUNDING = 1e-12


def same(actual: np.ndarray, expected: Any, scale: float = 1.0) -> None:
    expected = np.asarray(expected, dtype=float)
    np.testing.assert_allclose(actual, expected, rtol=ROUNDING, atol=ROUNDING * scale)


def another(robot: Robot, rng: np.random.Generator) -> Robot:
    spread = [0.005 if p.field == "inertia" else 0.2 for p in robot.entries()]
    vector = robot.values() * (1.0 + np.array(spread) * rng.uniform(-1.0, 1.0, len(spread)))
    moved = robot.with_values(vector)
    return check_robot(moved.with_parameters(f_s=1.5 * moved.f_c, eps=0.02))


def set_robot(unit: Any, robot: Robot) -> None:
    for entry, value in zip(robot.entries(), robot.values(), strict=True):
        if entry.name in unit.model.references:
            unit.set_one(entry.name, float(value))


@EACH
def test_the_trajectory_is_equation_57_and_at_its_ends_does_not_depend_on_rounding(open_unit, robot_name, robots):
    n = robots[robot_name].n
    q_start, q_end = np.linspace(-0.4, 0.3, n), np.linspace(0.9, -1.1, n)
    unit = open_unit("trajectory", robot_name)
    unit.start(0.25, q_start=q_start, q_end=q_end, T=1.5, t_start=0.5)
    for k in range(20):
        expected = desired_motion(0.25 + 0.1 * k, q_start, q_end, 1.5, 0.5)
        for group, value in expected._asdict().items():
            same(unit.get(group), value, scale=(2 * np.pi / 1.5) ** Desired._fields.index(group))
        unit.step(0.1)
    # At the start it moves already, at the end no more, in Python and C alike.
    unit = open_unit("trajectory", robot_name)
    for T, t_start, pairs in rounded_ends(draws=2):
        for begin, end in pairs:
            unit.start(begin, q_start=0.0, q_end=1.0, T=T, t_start=t_start)
            assert (unit.get("q_d_dddot") > 0.0).all()
            unit.do("Reset")
            unit.start(end, q_start=0.0, q_end=1.0, T=T, t_start=t_start)
            for name in Desired._fields[1:]:
                assert not unit.get(name).any()
            unit.do("Reset")


@pytest.mark.parametrize("velocity", [0, 1, 2])
@pytest.mark.parametrize("tau_max", [1e12, 0.5])
@EACH
def test_the_controller_is_equation_58(open_unit, robot_name, robots, velocity, tau_max):
    n = robots[robot_name].n
    rng = np.random.default_rng(5)
    gains = {"K_p": 900.0 + 10.0 * rng.random(n), "K_v": 20.0 + rng.random(n)}
    ell = rng.uniform(40.0, 160.0, n)
    unit = open_unit("controller", robot_name).start(**gains, ell=ell, tau_max=tau_max, velocity=velocity)
    for _ in range(10):
        names = ("q_d", "q_d_dot", "kappa_dot_d", "q", "q_dot", "kappa_dot", "tau_m")
        inputs = {name: rng.normal(size=n) for name in names}
        unit.step(1e-3, **inputs)
        measured = inputs["q_dot" if velocity == 1 else "kappa_dot"]
        command = pd_control(
            *gains.values(), ell, tau_max, inputs["q_d"], inputs["q_d_dot" if velocity else "kappa_dot_d"],
            inputs["q"], measured, inputs["tau_m"],
        )  # fmt: skip
        same(unit.get("tau_e"), command.tau_e, scale=1e3)
        same(unit.get("tau"), command.tau, scale=1e2)
        assert np.all(np.abs(unit.get("tau")) <= tau_max)


@pytest.mark.parametrize("mode", [0, 1])
@EACH
def test_the_feedforward_is_that_of_its_mode(open_unit, robot_name, robots, mode):
    """Mode 0: the exact inverse of the plant. Mode 1: virtual decomposition, Eq. (12)-(27), (48)-(53)."""
    rng = np.random.default_rng(6)
    robot = another(robots[robot_name], rng)
    n = robot.n
    gains = FeedbackGains(*(rng.uniform(0.1, 2.0, n) for _ in FeedbackGains._fields))
    unit = open_unit("feedforward", robot_name)
    set_robot(unit, robot)
    unit.start(mode=mode, **gains._asdict())
    for _ in range(5):
        desired = Desired(*(rng.normal(size=n) for _ in Desired._fields))
        measured = {name: rng.normal(size=n) for name in ("q", "q_dot", "kappa_dot")}
        measured["F_e_d"] = rng.normal(size=6)
        unit.step(1e-3, **desired._asdict(), **measured)
        expected = (
            feedforward_vdc(robot, gains, desired, *measured.values())
            if mode
            else feedforward_inverse(robot, desired, measured["F_e_d"])
        )
        same(unit.get("tau_m"), expected.tau_m, scale=100.0)
        same(unit.get("tau_s"), expected.tau_s, scale=100.0)
        # two derivatives of the torques over stiffnesses of 1e4
        same(unit.get("kappa_dot_d"), expected.kappa_dot_d)


@EACH
def test_the_estimator_is_that_of_equations_2_and_3(open_unit, robot_name, robots):
    """Also far out, where both estimates are the limit."""
    rng = np.random.default_rng(10)
    robot = another(robots[robot_name], rng)
    n = robot.n
    limit, error = 5.0 / robot.c_f, 0.1 / robot.ell
    unit = open_unit("estimator", robot_name)
    springs = {key: getattr(robot, key) for key in SPRING_KEYS}
    unit.start(**springs | {"theta_err_amplitude": error}, tau_hat_max=limit)
    robot = robot.with_parameters(theta_err_amplitude=error)
    for size in (1e-5, 1e-4, 1e-3, 0.1, 10.0):
        q, tau = rng.normal(size=n), 0.1 * rng.normal(size=n)
        kappa = q + size * rng.normal(size=n)
        unit.step(1e-3, q=q, kappa=kappa, tau=tau)
        expected = torque_estimates(robot, q, kappa, tau, limit)
        # kappa - q cancels: 1e-16 over compliances of 1e-5 (1e-7 m/N for a slide), stiffer by 26 at the limit
        same(unit.get("tau_s_hat"), expected.tau_s_hat, scale=1e4)
        same(unit.get("tau_f_hat"), expected.tau_f_hat, scale=1e4)
    same(np.abs(unit.get("tau_s_hat")), limit)


def state_of(unit: Any) -> np.ndarray:
    return np.concatenate([unit.get(group) for group in ("q", "q_dot", "kappa_dot", "tau_s")])


def same_outputs(unit: Any, robot: Robot) -> None:
    expected = plant_outputs(robot, state_of(unit))
    for group, value in expected._asdict().items():
        same(unit.get(group), np.ravel(value), scale=10.0)


@EACH
def test_the_plant_starts_in_equilibrium_or_from_given_values(open_unit, robot_name, robots):
    rng = np.random.default_rng(7)
    robot = another(robots[robot_name], rng)
    q_0, q_dot_0 = rng.normal(size=(2, robot.n))
    unit = open_unit("plant", robot_name)
    set_robot(unit, robot)
    F_e = rng.normal(size=6)
    unit.start(q_0=q_0, q_dot_0=q_dot_0, tau_s_0=99.0, kappa_dot_0=99.0, F_e=F_e)
    assert np.array_equal(unit.get("q"), q_0)
    assert np.array_equal(unit.get("q_dot"), q_dot_0)
    assert np.array_equal(unit.get("kappa_dot"), q_dot_0)
    same(unit.get("tau_s"), equilibrium_torque(robot, q_0, F_e), scale=100.0)
    same_outputs(unit, robot)
    rng = np.random.default_rng(8)
    start = rng.normal(size=(4, robots[robot_name].n))
    names = ("q_0", "q_dot_0", "kappa_dot_0", "tau_s_0")
    unit = open_unit("plant", robot_name)
    unit.start(equilibrium=False, **dict(zip(names, start, strict=True)))
    assert np.array_equal(state_of(unit), start.ravel())
    same_outputs(unit, robots[robot_name])


@EACH
def test_the_plant_moves_by_its_differential_equation(open_unit, robot_name, robots):
    """Against scipy on the numpy equations, with torque and wrench held over each of three steps."""
    rng = np.random.default_rng(9)
    robot = another(robots[robot_name], rng)
    unit = open_unit("plant", robot_name)
    set_robot(unit, robot)
    unit.start(tolerance=1e-11, q_0=rng.normal(size=robot.n), q_dot_0=0.3 * rng.normal(size=robot.n))
    x = state_of(unit)
    for _ in range(3):
        tau, F_e = 0.1 * rng.normal(size=robot.n), rng.normal(size=6)
        unit.step(1e-3, tau=tau, F_e=F_e)
        solution = solve_ivp(
            lambda t, x, tau=tau, F_e=F_e: plant_derivative(robot, x, tau, F_e),
            (0.0, 1e-3), x, method="DOP853", rtol=1e-11, atol=1e-11,
        )  # fmt: skip
        x = solution.y[:, -1]
        # Both solvers err by about 1e-11 in each of some ten steps, relative to states of up to 30 N.m.
        np.testing.assert_allclose(state_of(unit), x, rtol=1e-9, atol=1e-9)
        same_outputs(unit, robot)
    moved = np.abs(state_of(unit)[robot.n : 2 * robot.n] - unit.get("q_dot_0"))
    assert moved.max() > 1e-3  # far above the tolerance


@EACH
def test_one_step_or_many_is_the_same_motion_wherever_time_starts(open_unit):
    """The communication step does not change the solution, only where it is shown; errors as above."""
    once = open_unit("plant").start(tolerance=1e-10, q_0=[0.4, -0.3]).step(0.02)
    often = open_unit("plant").start(tolerance=1e-10, q_0=[0.4, -0.3])
    for size in (1e-3, 5e-3, 1e-6, 4e-3, 1e-2 - 1e-6):
        often.step(size)
    assert often.time == pytest.approx(0.02, abs=1e-15)
    np.testing.assert_allclose(often.outputs(), once.outputs(), rtol=1e-8, atol=1e-8)
    # The plant does not depend on time: started at 1e4 s it moves to the same bits.
    early, late = open_unit("plant").start(0.0, q_0=0.3), open_unit("plant").start(1e4, q_0=0.3)
    for _ in range(10):
        early.step(2.0**-10)  # exact in binary
        late.step(2.0**-10)
    assert np.array_equal(early.outputs(), late.outputs())
