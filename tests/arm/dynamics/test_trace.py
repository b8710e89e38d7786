"""Traced functions against the numpy equations they come from, for every name and every robot."""

import dataclasses

import numpy as np
import pytest

from tests.arm.balanced import ONE
from tests.conftest import TYPICAL
from vdfmu.arm.equations.feedforward import FeedbackGains, feedforward_inverse, feedforward_vdc
from vdfmu.arm.equations.flexible_joint import link_torques, rotor_position
from vdfmu.arm.equations.forward_dynamics import forward_dynamics
from vdfmu.arm.equations.inverse_dynamics import inverse_dynamics
from vdfmu.arm.equations.kinematics import end_effector_pose
from vdfmu.arm.equations.mapping import jacobian, joint_space_mass_matrix
from vdfmu.arm.equations.newton_euler import newton_euler
from vdfmu.arm.equations.pd import pd_control
from vdfmu.arm.equations.plant import balance, equilibrium_torque, plant_derivative, plant_outputs
from vdfmu.arm.equations.torque_estimation import torque_estimates
from vdfmu.arm.equations.trajectory import desired_motion
from vdfmu.arm.kernel import FUNCTIONS
from vdfmu.arm.robot import Robot, load_robot
from vdfmu.arm.robot.parameters import PARAMETERS, SPRING_KEYS
from vdfmu.arm.units import shipped_units
from vdfmu.compiler.functions.rodas import ALPHA, GAMMA, GAMMA_I, A, C
from vdfmu.compiler.scalar.jet import derivative, jets
from vdfmu.compiler.unit.program import UnitFunctions

PLANAR = load_robot("planar_2dof")
NAMES = [*FUNCTIONS, *(name for unit in shipped_units().values() for name in UnitFunctions(unit, PLANAR, None).names())]
"""Traced functions of the kernel and of the units."""


@pytest.fixture(scope="module", params=[*TYPICAL, "general", "single", "balanced"])
def traced_robot(request, general):
    """Return each shipped robot, the general chain, an arm of one joint, and one with a counterbalance."""
    if request.param == "balanced":
        return ONE
    if request.param == "general":
        return general
    if request.param == "single":
        return first_joint(general)
    return load_robot(request.param)


def first_joint(robot: Robot) -> Robot:
    arrays = {name: getattr(robot, name)[:1] for name, row in PARAMETERS.items() if row.per_joint}
    return dataclasses.replace(robot, name="single", joint_types=robot.joint_types[:1], **arrays)


def plant_jacobian(robot, x, tau, F_e):
    """Return the Jacobian of the plant's right-hand side by jets, column by column: exact to rounding."""
    columns = [derivative(plant_derivative(robot, jets(x, row, 0.0), tau, F_e), 1) for row in np.eye(len(x))]
    return np.array(columns, dtype=float).T


def plant_step(robot, x, tau, F_e, rate_tau, rate_F_e, h, tolerance):
    def residual(x, x_dot, t):
        now = tau + t * rate_tau, F_e + t * rate_F_e
        return balance(robot, x, x_dot, *now)

    zero = np.zeros(len(x))
    J = plant_jacobian(robot, x, tau, F_e)
    W = np.eye(len(x)) / (h * GAMMA) - J
    # the balance is affine in x_dot, tau and F_e: a difference is the derivative except for rounding
    E = np.array([residual(x, zero, 0.0) - residual(x, unit, 0.0) for unit in np.eye(len(x))]).T
    f = plant_derivative(robot, x, tau, F_e)
    f_t = plant_derivative(robot, x, tau + rate_tau, F_e + rate_F_e) - f
    u: list[np.ndarray] = []
    w: list[np.ndarray] = []
    for a, c, alpha, gamma in zip(A, C, ALPHA, GAMMA_I, strict=True):
        x_i = x + sum((k * v for k, v in zip(a, u, strict=True)), zero)
        y_i = f + sum((k * v for k, v in zip(a, w, strict=True)), zero)
        slope = y_i + sum((k * v for k, v in zip(c, u, strict=True)), zero) / h
        unbalanced = np.linalg.solve(E, residual(x_i, y_i, alpha * h))
        u.append(np.linalg.solve(W, slope + unbalanced + gamma * h * f_t))
        w.append(u[-1] / (h * GAMMA) - slope)
    x_new = x_i + u[-1]
    ratio = u[-1] / (tolerance * (1.0 + np.maximum(np.abs(x), np.abs(x_new))))
    return {"x_new": x_new, "norm": np.sqrt(np.mean(ratio**2)), "ratio": ratio}


def case(name, robot, state):
    n = robot.n
    motion = desired_motion(3.0, state.q - 1.0, state.q + 1.0, 10.0)
    desired = motion._asdict()
    gains = dict(zip(FeedbackGains._fields, np.random.default_rng(70).uniform(0.1, 5.0, (4, n)), strict=True))
    q, q_dot, q_ddot, tau, F_e = state.q, state.q_dot, state.q_ddot, state.tau, state.F_e
    x = state.x
    match name:
        case "inverse_dynamics" | "newton_euler":
            method = inverse_dynamics if name == "inverse_dynamics" else newton_euler
            torques = method(robot, q, q_dot, q_ddot, F_e) - link_torques(robot, q)
            return dict(q=q, q_dot=q_dot, q_ddot=q_ddot, F_e=F_e), dict(tau=torques)
        case "forward_dynamics":
            return dict(q=q, q_dot=q_dot, tau=state.tau_s, F_e=F_e), dict(
                q_ddot=forward_dynamics(robot, q, q_dot, state.tau_s + link_torques(robot, q), F_e)
            )
        case "forward_kinematics":
            p_O, R_O = end_effector_pose(robot, q)
            return dict(q=q), dict(pose=np.concatenate([p_O, R_O.ravel()]))
        case "jacobian":
            return dict(q=q), dict(J_q=jacobian(robot, q))
        case "mass_matrix":
            return dict(q=q), dict(M=joint_space_mass_matrix(robot, q))
        case "plant_derivatives":
            return dict(x=x, tau=tau, F_e=F_e), dict(x_dot=plant_derivative(robot, x, tau, F_e))
        case "plant_jacobian":
            return dict(x=x, tau=tau, F_e=F_e), dict(J=plant_jacobian(robot, x, tau, F_e))
        case "plant_step":
            h, tolerance = 1e-4, 1e-6
            inputs = dict(tau=tau, F_e=F_e, rate_tau=30.0 * tau, rate_F_e=-20.0 * F_e)
            return dict(x=x, **inputs, h=h, tolerance=tolerance), plant_step(
                robot, x, **inputs, h=h, tolerance=tolerance
            )
        case "plant_outputs":
            return dict(x=x), plant_outputs(robot, x)._asdict()
        case "plant_start_equilibrium":
            tau_s = equilibrium_torque(robot, q, F_e)
            return dict(q_0=q, q_dot_0=q_dot, F_e=F_e), dict(x=np.concatenate([q, q_dot, q_dot, tau_s]))
        case "plant_start_not_equilibrium":
            parts = dict(q_0=q, q_dot_0=q_dot, kappa_dot_0=state.kappa_dot, tau_s_0=state.tau_s)
            return parts, dict(x=np.concatenate(list(parts.values())))
        case "feedforward_outputs_inverse":
            return desired | dict(F_e_d=F_e), feedforward_inverse(robot, motion, F_e)._asdict()
        case "feedforward_outputs_vdc":
            measured = dict(q=q, q_dot=q_dot, kappa_dot=state.kappa_dot, F_e_d=F_e)
            torques = feedforward_vdc(robot, FeedbackGains(**gains), motion, **measured)
            return desired | measured | gains, torques._asdict()
        case "trajectory_outputs":
            times = dict(t=3.0, T=10.0, t_start=0.5)
            ends = dict(q_start=q, q_end=q + 1.0)
            return times | ends, desired_motion(3.0, q, q + 1.0, 10.0, 0.5)._asdict()
        case "controller_outputs_kappa_dot" | "controller_outputs_q_dot" | "controller_outputs_mixed":
            pair = {
                "kappa_dot": ("kappa_dot_d", "kappa_dot"), "q_dot": ("q_d_dot", "q_dot"),
                "mixed": ("q_d_dot", "kappa_dot"),
            }[name.removeprefix("controller_outputs_")]  # fmt: skip
            inputs = dict(
                K_p=gains["Lambda"] * 100, K_v=gains["K_V"], ell=robot.ell, tau_max=np.full(n, 1.0), q_d=q + 0.1, q=q,
                tau_m=tau,
            )  # fmt: skip
            velocities = dict(zip(pair, (q_dot, state.kappa_dot), strict=True))
            command = pd_control(**inputs, velocity_d=q_dot, velocity=state.kappa_dot)
            return inputs | velocities, command._asdict()
        case "estimator_outputs":
            inputs = dict(q=q, kappa=rotor_position(robot, q, state.tau_s), tau=tau, tau_hat_max=100.0 / robot.c_f)
            springs = {key: getattr(robot, key) for key in SPRING_KEYS}
            return inputs | springs, torque_estimates(robot, **inputs)._asdict()
    raise AssertionError(f"no case for {name}: add one")


def call(function, arguments, p):
    assert set(function.args) - {"p"} == set(arguments)
    for key, value in arguments.items():
        function.args[key][:] = value
    if "p" in function.args:
        function.args["p"][:] = p
    function.run()
    return {key: value.copy() for key, value in function.results.items()}


@pytest.fixture(scope="module")
def function_of(kernel_of, functions_of):
    def function(robot, name):
        owner = kernel_of(robot) if name in FUNCTIONS else functions_of(name.split("_")[0], robot)
        return owner.function(name)

    return function


def deviates(name, results, expected):
    """Return whether results are not those of the equations, but for rounding."""
    # The same operations, in an order that CasADi may change: 1e-12 of the largest entry is some 5000 roundings. A
    # step solves a linear system of condition up to 1e4 besides, and its error is a difference of stages.
    bound = 1e-9 if name == "plant_step" else 1e-12
    for key, value in expected.items():
        value = np.asarray(value, dtype=float).ravel(order="F" if key == "J" else "C")
        scale = np.abs(value).max()
        if name == "plant_step" and key != "x_new":
            scale = max(scale, np.abs(expected["ratio"]).max(), 1e-16 / 1e-6 / bound)
        if np.abs(results[key] - value).max() > bound * scale:
            return key
    return None


SLOW = ("plant_step", "plant_jacobian")
"""Functions that take a tenth of a second in numpy."""
WITHOUT_ROBOT = ("trajectory_outputs", "estimator_outputs", "plant_start_not_equilibrium", "controller")
"""Functions that do not take all of the robot's parameters."""


@pytest.mark.few(20)
@pytest.mark.parametrize("name", NAMES)
def test_traced_function_equals_the_numpy_equations_with_parameters_of_run_time(traced_robot, draw, function_of, name):
    function, p = function_of(traced_robot, name), traced_robot.values()
    first, second, third = draw(traced_robot, 3, seed=71)
    for state in (first, second)[: 1 if name in SLOW else 2]:
        arguments, expected = case(name, traced_robot, state)
        results = call(function, arguments, p)
        assert set(results) == set(expected) and deviates(name, results, expected) is None
    if name.startswith(WITHOUT_ROBOT):
        return
    p = p * np.random.default_rng(72).uniform(0.9, 1.1, len(p))
    changed = traced_robot.with_values(p)
    np.testing.assert_array_equal(changed.values(), p)
    assert changed.key() == traced_robot.key()
    arguments, expected = case(name, changed, third)
    results = call(function, arguments, p)
    assert deviates(name, results, expected) is None
    assert deviates(name, results, case(name, traced_robot, third)[1])  # another robot


@pytest.mark.parametrize("t", [-1.0, 0.0, 0.25, 0.5, 3.0, 10.5, 11.0])
def test_traced_trajectory_holds_before_and_after(planar, function_of, t):
    function = function_of(planar, "trajectory_outputs")
    q_start, q_end = np.array([0.1, 0.2]), np.array([1.0, -1.0])
    results = call(function, dict(t=t, T=10.0, t_start=0.5, q_start=q_start, q_end=q_end), None)
    for key, value in desired_motion(t, q_start, q_end, 10.0, 0.5)._asdict().items():
        # A few roundings of (2 pi)^3.
        np.testing.assert_allclose(results[key], value, rtol=0, atol=1e-13)


def test_every_number_is_a_parameter_or_a_structural_constant(traced_robot):
    names = [p.name for p in traced_robot.entries()]
    assert len(set(names)) == len(names)
    for i in range(1, traced_robot.n + 1):
        for field in ("mass", "ell", "I_m", "K_f0", "c_f", "K_w0", "c_w", "f_c", "f_s", "f_v", "v_s", "eps"):
            assert f"{field}[{i}]" in names
        for k in (1, 2, 3):
            assert f"inertia[{i},{k},{k}]" in names
            # A zero is folded, and so may not be offered.
            assert (f"centroid[{i},{k}]" in names) == (traced_robot.centroid[i - 1, k - 1] != 0.0)
            assert (f"offset[{i},{k}]" in names) == (traced_robot.offset[i - 1, k - 1] != 0.0)
        assert (f"f_ck[{i}]" in names) == (traced_robot.friction == "split")
        assert (f"theta_err_phase[{i}]" in names) == (traced_robot.theta_err_amplitude[i - 1] != 0.0)


def test_structure_decides_the_key_and_values_do_not(arm):
    key = arm.key()
    assert arm.with_parameters(mass=9.0, ell=50.0).key() == key
    turned = arm.rotation.copy()
    turned[1] = np.eye(3)
    changed = [
        arm.with_parameters(tool_offset=[0.1, 0.0, 0.0]),
        arm.with_parameters(theta_err_amplitude=1e-4),
        arm.with_parameters(rotation=turned),
        dataclasses.replace(arm, friction="split"),
        dataclasses.replace(arm, joint_types=("prismatic", *arm.joint_types[1:])),
    ]
    assert len({key, *(other.key() for other in changed)}) == 6


@pytest.mark.few(40)
@pytest.mark.parametrize("row", PARAMETERS.values(), ids=PARAMETERS)
@pytest.mark.parametrize("kind", ["plain", "lumped", "split"])
def test_the_key_has_every_value_that_is_folded(row, kind, planar, with_options):
    robot = planar if kind == "plain" else dataclasses.replace(with_options(), friction=kind)
    key, array = robot.key(), np.array(getattr(robot, row.name))
    for index in np.ndindex(array.shape):
        changed = array.copy()
        changed[index] += 0.125
        mirrored = (*index[:-2], index[-1], index[-2]) if row.fold == "inertia" else index
        changed[mirrored] = changed[index]
        other = dataclasses.replace(robot, **{row.name: changed})
        free = any(row.is_free(robot, i) and row.is_free(other, i) for i in (index, mirrored))
        assert (other.key() == key) == free, f"{row.name}{index}"
