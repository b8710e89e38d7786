"""Observed order of the step of the solver and of its error estimate: 4, on scalar problems and on the plant."""

import casadi as ca
import numpy as np
import pytest

from vdfmu.arm.equations.friction import joint_friction
from vdfmu.arm.equations.inverse_dynamics import inverse_dynamics
from vdfmu.compiler.functions.rodas import ORDER, rodas_step, stage_equations


def observed_orders(errors):
    """Return log2 of the ratios of errors whose steps halve."""
    return np.log2(np.array(errors[:-1]) / np.array(errors[1:]))


def test_the_error_estimate_has_order_four_and_a_step_too_where_the_mass_changes_with_the_state():
    # The logistic equation, x_dot = x (1 - x) from 0.1, is autonomous and smooth; the order of its solution is in
    # unit/test_solver.py.
    x, h = ca.SX.sym("x", 1), ca.SX.sym("h")
    stages = stage_equations(h, ca.SX.eye(1), 1.0 - 2.0 * x, ca.SX(1, 1), np.arange(1), 1)
    x_new, error = rodas_step(lambda s, _: s * (1.0 - s), x, x * (1.0 - x), h, stages.factors, stages)
    step = ca.Function("step", [x, h], [x_new, error])
    estimates = [abs(float(step(0.1, 4.0 / steps)[1])) for steps in (16, 32, 64, 128)]
    # Local error of the embedded method of order 3: h^4. The first step is a quarter and less of the time
    # constant.
    assert observed_orders(estimates)[-1] == pytest.approx(ORDER, abs=0.2)
    # (1 + x^2) x_dot = 1 + t from x = 0: x + x^3 / 3 = t + t^2 / 2, which is 4 at t = 2. The mass in E is that of the
    # start of a step; what it changes by is in the balance of the stages.
    x, h, t = ca.SX.sym("x", 1), ca.SX.sym("h"), ca.SX.sym("t")
    mass, x_dot = 1.0 + x**2, (1.0 + t) / (1.0 + x**2)
    stages = stage_equations(h, mass, -2.0 * x * x_dot, ca.SX(1), np.arange(1), 1)
    assert stages.carried == [0]
    x_new, _ = rodas_step(lambda s, c, y: 1.0 + t + c - (1.0 + s**2) * y, x, x_dot, h, stages.factors, stages)
    step = ca.Function("step", [x, t, h], [x_new])
    exact = max(np.roots([1.0 / 3.0, 0.0, 1.0, -4.0]), key=lambda root: -abs(root.imag)).real
    errors = []
    for steps in (64, 128, 256):
        state = 0.0
        for k in range(steps):
            state = float(step(state, k * 2.0 / steps, 2.0 / steps))
        errors.append(abs(state - exact))
    # The next term is smaller by the step, 2 / 128.
    assert observed_orders(errors)[-1] == pytest.approx(ORDER, abs=0.1)


F_E = np.array([40.0, 30.0, -20.0, 8.0, -6.0, 9.0])


def smooth_state(robot):
    """Return a state and motor torques where the plant is smooth on the scale of 10 milliseconds."""
    # Friction: every rotor turns at 1 rad/s, 1000 times eps and at least 5 times v_s. There tanh is 1 and the Stribeck
    # term exp(-25) of itself, so the rest is viscous. Springs: D has a kink in its second derivative at zero
    # torque, by sgn(tau), so no torque may come near zero. The wrench F_E loads all of them; they start in balance
    # with it, so that the elastic modes are barely excited and no sign changes.
    n = robot.n
    q, speed = np.linspace(0.3, 0.9, n), np.ones(n)
    tau_s = inverse_dynamics(robot, q, speed, np.zeros(n), F_E)
    _, xi_m = joint_friction(robot, speed, speed)
    return np.concatenate([q, speed, speed, tau_s]), tau_s / robot.ell + xi_m


def integrate(function, x, tau, p, duration, steps):
    function.args["x"][:] = x
    function.args["tau"][:] = tau
    function.args["F_e"][:] = F_E
    function.args["p"][:] = p
    function.args["tolerance"][:] = 1.0
    function.args["h"][:] = duration / steps
    states = []
    for _ in range(steps):
        function.run()
        function.args["x"][:] = function.results["x_new"]
        states.append(function.args["x"].copy())
    return np.array(states)


def test_order_four_on_the_smooth_plant(robot, functions_of):
    function, p = functions_of("plant", robot).function("plant_step"), robot.values()
    x, tau = smooth_state(robot)
    duration, counts = 2e-2, [50, 100, 200]
    exact = integrate(function, x, tau, p, duration, 1600)
    _, _, kappa_dot, tau_s = np.split(exact, 4, axis=1)
    assert (kappa_dot > 0.5).all() and (tau_s * x[-robot.n :] > 0.0).all()  # no friction step, no kink
    results = [integrate(function, x, tau, p, duration, count)[-1] for count in counts]
    errors = [np.abs((r - exact[-1]) / (1.0 + np.abs(exact[-1]))).max() for r in results]
    # Steps of 400, 200 and 100 us. The fastest mode, 300 Hz = 1900 rad/s, has h w = 0.2 at the last, so the
    # next term of the error changes the last ratio by a few per cent: 0.1 in the order. The reference has
    # (1/8)^4 of the last error.
    assert errors[-1] > 1e-12  # above rounding
    assert observed_orders(errors)[-1] == pytest.approx(ORDER, abs=0.1)
