"""Observed order of the step of the solver on the plant, whose mass changes with its state: 4."""

import numpy as np
import pytest

from vdfmu.arm.equations.friction import joint_friction
from vdfmu.arm.equations.inverse_dynamics import inverse_dynamics
from vdfmu.compiler.functions.rodas import ORDER


def observed_orders(errors):
    """Return log2 of the ratios of errors whose steps halve."""
    return np.log2(np.array(errors[:-1]) / np.array(errors[1:]))


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


@pytest.mark.few(1)
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
