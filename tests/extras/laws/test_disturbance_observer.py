"""PD control with a disturbance observer, on a joint as stiff as its closed form wants it."""

import numpy as np
import pytest
from scipy.linalg import expm

import vdfmu
from vdfmu.arm.units import find_unit

PERIOD, LOAD = 1e-3, 0.2
EPS = np.finfo(float).eps


def run_rotor(load, steps, q_d=0.0, **values):
    """Return positions and units after each sample of a rotor by itself: ``I_m kappa_ddot = tau - load``, exactly."""
    robot = vdfmu.load_robot("planar_2dof")
    unit = find_unit("disturbance_observer")(robot, period=PERIOD, **values)
    unit.start()
    position, speed, rows = np.zeros(2), np.zeros(2), []
    unit.q_d = [q_d, q_d]
    for k in range(steps):
        unit.q, unit.kappa_dot = position, speed
        unit.update()
        unit.outputs()
        rows.append((position, speed, np.copy(unit.tau), np.copy(unit.d_hat)))
        acceleration = (unit.tau - load(k)) / robot.I_m
        position = position + PERIOD * speed + 0.5 * PERIOD**2 * acceleration
        speed = speed + PERIOD * acceleration
    return robot, [np.array(part) for part in zip(*rows, strict=True)]


def test_a_constant_load_is_known_to_the_stated_time_constant_and_its_motion_that_of_the_closed_form():
    T_Q = 0.03
    _, (_, _, _, d_hat) = run_rotor(lambda k: LOAD, 301, T_Q=T_Q, K_p=1000.0, K_v=20.0)
    t = PERIOD * np.arange(301)
    # speeds of up to 1 rad/s, rounded, times I_m / period = 1; the filter forgets
    np.testing.assert_allclose(d_hat[:, 0], LOAD * (1.0 - np.exp(-t / T_Q)), rtol=0, atol=100 * EPS)
    # Position, speed and estimate are linear in the sample before: powers of one matrix.
    T_Q, K_p, K_v = 0.03, 100.0, 10.0
    robot, (position, speed, _, d_hat) = run_rotor(lambda k: LOAD, 500, T_Q=T_Q, K_p=K_p, K_v=K_v)
    a, I_m, ell = np.exp(-PERIOD / T_Q), robot.I_m[0], robot.ell[0]
    rates = np.array([[0.0, 1.0, 0.0], [0.0, 0.0, 1.0 / I_m], [0.0, 0.0, 0.0]])
    held = expm(rates * PERIOD)  # position, speed, and a torque that is held
    step = np.zeros((4, 4))  # position, speed, estimate, load
    torque = np.array([-K_p / ell, -K_v / ell, 1.0, -1.0])
    step[:2] = np.hstack([held[:2, :2], np.zeros((2, 2))]) + np.outer(held[:2, 2], torque)
    step[2, 2:], step[3, 3] = [a, 1.0 - a], 1.0
    x = np.array([0.0, 0.0, 0.0, LOAD])
    for k in range(500):
        # 500 steps of rounding of a stable system
        np.testing.assert_allclose([position[k, 0], speed[k, 0], d_hat[k, 0]], x[:3], rtol=0, atol=1e3 * EPS)
        x = step @ x
    stands_off = LOAD * ell / K_p
    assert np.abs(position).max() < 0.5 * stands_off  # a PD controller by itself would stand off by that
    assert abs(position[-1, 0]) < 0.02 * stands_off  # the slowest pole is 11/s: exp(-5.6) = 0.4 %


def test_it_does_not_wind_up_while_the_motor_is_at_its_limit():
    """A load above the limit for 0.5 s: the estimate stays at the limit, and is back in some time constants."""
    T_Q, tau_max, stop = 0.03, 0.1, 500
    load = lambda k: LOAD if k < stop else 0.0  # noqa: E731
    _, (_, _, tau, d_hat) = run_rotor(load, stop + 200, T_Q=T_Q, K_p=0.0, K_v=0.0, tau_max=tau_max)
    assert np.abs(tau).max() <= tau_max and np.abs(d_hat).max() <= tau_max
    assert d_hat[stop - 1, 0] == tau_max
    # the sample at `stop` still sees the load; from there the estimate falls by exp(-period / T_Q) in each
    after = d_hat[stop:, 0]
    np.testing.assert_allclose(
        after, tau_max * np.exp(-PERIOD / T_Q * np.arange(200)), rtol=0, atol=100 * EPS * tau_max
    )


@pytest.mark.heavy
def test_it_takes_the_offset_of_a_wrong_mass_in_a_run():
    """Link 2 is 20 % heavier than the feedforward knows."""
    heavier = {"plant.mass[2]": 1.2, "controller.K_p": [1500.0, 500.0], "controller.K_v": [40.0, 20.0]}
    ends = {}
    for law in ("controller", "disturbance_observer"):
        results = vdfmu.run(
            "planar_tracking", units={"controller": law}, parameters=heavier, stop=2.5, reference=False, out=False
        )
        ends[law] = np.abs(results["trajectory.q_d"] - results["plant.q"])[-1].max()
    # with integral action the remaining error is the spring's: links measured, rotors driven; friction lets it creep
    assert ends["disturbance_observer"] < 0.1 * ends["controller"], ends
