"""End stops and the torque-speed line: what they are alone, and in the plant."""

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from tests.arm.laws.traced import assert_traced
from vdfmu.arm.drive.limits import motor_torque, stop_torque
from vdfmu.arm.equations.plant import plant_derivative, plant_outputs
from vdfmu.arm.robot import load_robot, robot_from_dict
from vdfmu.base.errors import ModelError
from vdfmu.system.scenario import load_scenario

EPS = np.finfo(float).eps
LIMITS = {
    "q_min": -0.5, "q_max": 0.8, "stop_stiffness": 2e4, "stop_damping": 0.6, "tau_stall": 0.6, "kappa_dot_max": 3.0,
}  # fmt: skip


def limited(name="planar_2dof", **changes):
    data = load_robot(name).to_dict()
    for joint in data["joints"]:
        joint["limits"] = LIMITS | changes
    return robot_from_dict(data)


ROBOT = limited()


def test_stops_push_without_jumps_and_a_bounce_loses_two_thirds_of_damping_times_speed():
    for q in (-0.6, -0.501, -0.5, 0.0, 0.8, 0.8001, 0.9):
        for q_dot in (-9.0, -0.3, 0.0, 0.3, 9.0):
            torque = stop_torque(ROBOT, np.full(2, q), np.full(2, q_dot))
            direction = (q < -0.5) - (q > 0.8)
            assert (np.sign(torque) == direction).all() or (torque == 0.0).all()
            # beyond 1 / 0.6 rad/s away from the stop it lets go
            assert (torque != 0.0).all() == (direction != 0 and -direction * q_dot > -1.0 / 0.6)
    for q, sign in ((-0.5 - 1e-9, 1.0), (0.8 + 1e-9, -1.0)):
        torque = stop_torque(ROBOT, np.full(2, q), np.full(2, -sign))
        # 2e4 N m/rad times 1e-9 rad times 1.6; the depth has 1e-7 of rounding
        np.testing.assert_allclose(torque, sign * 3.2e-5, rtol=1e-6)
    # A body of 1 kg m2 on one stop; the next term of the law is about (c v)^2.
    for v in (0.01, 0.02):
        hit = solve_ivp(
            lambda _, x: [x[1], float(stop_torque(ROBOT, np.full(2, x[0]), np.full(2, x[1]))[0])],
            (0.0, np.pi / np.sqrt(2e4) * 1.2), [0.8, v], rtol=1e-10, atol=1e-14,
        )  # fmt: skip
        loss = 1.0 + hit.y[1, -1] / v
        assert loss == pytest.approx(2.0 / 3.0 * 0.6 * v, abs=(0.6 * v) ** 2)


@pytest.mark.parametrize(("tau", "speed", "expected"), [
    (0.5, 0.0, 0.5), (0.7, 0.0, 0.6), (-0.7, 0.0, -0.6),
    (0.5, 1.5, 0.3), (-0.5, -1.5, -0.3),  # driving at half the no-load speed: half the torque
    (-0.7, 1.5, -0.6), (0.7, -1.5, 0.6),  # braking
    (0.5, 3.5, 0.0), (-0.5, -3.5, 0.0), (-0.5, 3.5, -0.5),  # beyond it
])  # fmt: skip
def test_motor_torque_ends_at_the_torque_speed_line(tau, speed, expected):
    torque = motor_torque(ROBOT, np.full(2, tau), np.full(2, speed))
    np.testing.assert_allclose(torque, expected, rtol=0, atol=2 * EPS)


def test_a_drive_may_have_its_full_torque_up_to_a_speed():
    robot = limited(full_speed=0.8)  # full up to 2.4 rad/s, half at 2.7, none at 3
    for speed, expected in ((0.0, 0.6), (2.4, 0.6), (2.7, 0.3), (3.0, 0.0), (-2.4, 0.6)):
        # roundings of 1 - 0.9, over 0.2
        np.testing.assert_allclose(
            motor_torque(robot, np.full(2, 9.0), np.full(2, speed)), expected, rtol=0, atol=10 * EPS
        )
    line = (1.0 - 1.5 / 3.0) * 0.6
    assert (motor_torque(ROBOT, np.full(2, 9.0), np.full(2, 1.5)) == line).all()  # without it, to the bit


@pytest.mark.parametrize("robot", [ROBOT, limited(full_speed=0.8)], ids=["line", "full to a speed"])
def test_traced_plant_has_the_limits_and_their_slopes(draw, plant_function, robot):
    assert_traced(plant_function, robot, [(state.x, state.tau) for state in draw(robot, 3, seed=35)])


@pytest.mark.heavy
def test_the_solver_takes_the_arm_through_bounces(plant_solver):
    """Falling on both stops, against scipy; and the energy only falls."""
    integrator = plant_solver(ROBOT)
    integrator.tolerance = 1e-9
    integrator.x[:4] = [0.0, 0.3, 0.0, 0.0]
    x_0 = integrator.x.copy()
    exact = solve_ivp(
        lambda t, x: plant_derivative(ROBOT, x, np.zeros(2), np.zeros(6)), (0.0, 0.4), x_0,
        method="LSODA", rtol=1e-9, atol=1e-11, t_eval=np.linspace(0.0, 0.4, 41),
    )  # fmt: skip

    def energy(x):
        outputs = plant_outputs(ROBOT, x)
        return outputs.E_kin + outputs.E_pot + outputs.E_spring

    energies, deepest = [energy(x_0)], 0.0
    for k in range(1, 41):
        integrator.advance(0.01 * (k - 1), 0.01)
        energies.append(energy(integrator.x))
        deepest = max(deepest, -0.5 - integrator.x[0])
        # Local errors of 1e-9 in some 1e3 steps; a bounce turns 1e-9 rad of place into as much of time.
        np.testing.assert_allclose(integrator.x[:2], exact.y[:2, k], rtol=0, atol=1e-5)
    assert np.diff(energies).max() < 1e-5  # J; the solver's own
    assert 1e-4 < deepest < 0.1  # it got there, and no further than the fall of 10 J over 2e4 N m/rad lets it


@pytest.mark.parametrize(("change", "words"), [
    ({"q_max": -1.0}, r"joints\[2\]\.limits\.q_max: expected q_max > q_min, got q_max = -1, q_min = -0\.5"),
    ({"tau_stall": 0.0}, r"joints\[2\]\.limits\.tau_stall: expected a finite number > 0 in N\.m"),
    ({"stop_damping": -1.0}, r"joints\[2\]\.limits\.stop_damping: expected .* >= 0 in s/rad"),
    (None, r"joints\[2\]\.limits: expected a table, as other joints have, got nothing"),
])  # fmt: skip
def test_limits_that_cannot_be_are_refused(change, words):
    data = ROBOT.to_dict()
    if change is None:
        del data["joints"][1]["limits"]
    else:
        data["joints"][1]["limits"] |= change
    with pytest.raises(ModelError, match=words):
        robot_from_dict(data)


def test_a_motion_beyond_the_stops_is_refused_and_limits_make_a_round_trip():
    with pytest.raises(
        ModelError,
        match=r"trajectory\.q_start\[1\]: expected a position of joint 1 between its end stops, -0\.5 and 0\.8, got",
    ):
        load_scenario("planar_tracking", ROBOT)
    assert robot_from_dict(ROBOT.to_dict()).to_dict() == ROBOT.to_dict()
