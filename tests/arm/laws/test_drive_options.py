"""What drives may have beside the paper's: each law by itself, and its energy in the plant."""

import numpy as np
import pytest
from scipy.integrate import quad, solve_ivp

from tests.arm.laws.traced import assert_traced
from vdfmu.arm.drive.backlash import gap_compliance, gap_deformation, gap_energy
from vdfmu.arm.drive.bristles import bristle_rate, bristle_torque
from vdfmu.arm.drive.dahl import dahl_loss, dahl_rate
from vdfmu.arm.drive.load_loss import mesh_friction
from vdfmu.arm.drive.option import Friction
from vdfmu.arm.drive.options import OPTIONS as DRIVE_OPTIONS
from vdfmu.arm.drive.thermal import THERMAL, temperature_rate, warm_viscosity
from vdfmu.arm.drive.winding import current_rate, winding_voltage
from vdfmu.arm.equations.flexible_joint import state_names
from vdfmu.arm.equations.friction import friction_level, joint_friction, stribeck_friction
from vdfmu.arm.equations.plant import plant_outputs
from vdfmu.arm.robot import robot_from_dict
from vdfmu.arm.robot.parameters import section
from vdfmu.base.errors import ModelError, UsageError
from vdfmu.compiler.c.functions import c_texts
from vdfmu.compiler.scalar.jet import derivative, jets

EPS = np.finfo(float).eps
OPTIONS = ("hysteresis", "load_loss", "backlash", "bristles", "winding", "thermal", "counterbalance")
K, F = 5e3, 3.0  # stiffness [N m/rad] and limit [N m] of Dahl's element


@pytest.mark.parametrize("amplitude", [1e-4, 6e-4, 5e-3])
def test_hysteresis_takes_the_energy_of_its_loop_in_every_closed_cycle(amplitude):
    """From a turning point on the torque is ``f - (f + T) exp(-K x / f)``, closed for ``T = f tanh(K A / f)``."""
    corner = F * np.tanh(K * amplitude / F)
    area = 4.0 * F * amplitude - 4.0 * F / K * corner

    def rate(t, y):
        velocity = -amplitude * np.sin(t)
        return [dahl_rate(K, velocity, y[0], F), y[0] * velocity, dahl_loss(velocity, y[0], F)]

    turns = [0.0, np.pi, 2.0 * np.pi]
    y = np.array([corner, 0.0, 0.0])
    for begin, end in zip(turns, turns[1:], strict=False):  # |v| has a kink at each
        y = solve_ivp(rate, (begin, end), y, rtol=1e-10, atol=1e-13, method="DOP853").y[:, -1]
    # local errors of 1e-10 in some hundred steps; of the smallest loop the area is 1 % of the energies exchanged
    torque, work, loss = y
    assert torque == pytest.approx(corner, rel=1e-7)
    assert work == pytest.approx(area, rel=1e-6)
    assert loss == pytest.approx(area, rel=1e-6)
    assert area > 0.0


def test_backlash_is_crossed_by_small_torques_and_stores_what_is_put_into_it(with_options):
    robot = with_options("backlash")
    for t in (-30.0, -0.4, 0.0, 0.2, 1.0, 40.0):
        torque = np.full(2, t)
        by_jet = derivative(gap_deformation(robot, jets(torque, 1.0, 0.0)), 1)
        # the jet's is the difference of two terms 1 + x^2 times as large
        np.testing.assert_allclose(gap_compliance(robot, torque), by_jet, rtol=20 * EPS * (1.0 + (t / 0.5) ** 2))
        work, _ = quad(lambda s: s * gap_compliance(robot, np.full(2, s))[0], 0.0, t, epsabs=1e-15, epsrel=1e-12)
        # the integral is of a smooth function; 1 - 1/sqrt(1 + x^2) loses the digits of x^2
        np.testing.assert_allclose(gap_energy(robot, torque), work, rtol=1e-9, atol=1e-18)
        np.testing.assert_array_equal(gap_deformation(robot, -torque), -gap_deformation(robot, torque))
    width = gap_deformation(robot, np.full(2, 5.0)) - gap_deformation(robot, np.full(2, -5.0))
    np.testing.assert_allclose(width, 2e-4, rtol=1.0 / 2.0 / 10.0**2)  # x / sqrt(1 + x^2) at x = 10
    kappa = plant_outputs(robot, np.array([0.3, 0.2, 0, 0, 0, 0, 0.5, -0.5])).kappa
    with_gap = plant_outputs(robot.with_parameters(w_gap=0.0), np.array([0.3, 0.2, 0, 0, 0, 0, 0.5, -0.5])).kappa
    np.testing.assert_allclose(kappa - with_gap, 1e-4 / np.sqrt(2.0) * np.array([1.0, -1.0]), rtol=1e-10)


def test_load_loss_takes_energy_whichever_way_power_flows(with_options):
    robot = with_options("load_loss").with_parameters(f_c=0.0, f_s=0.0, f_v=0.5)
    for load in (-40.0, 15.0):
        for speed in (-1.0, 1.0):  # far above eps: tanh is 1 to rounding
            xi = mesh_friction(robot, np.full(2, speed), np.full(2, load))
            np.testing.assert_allclose(xi * robot.ell * speed, 0.2 * abs(load), rtol=8 * EPS)
            _, xi_m = joint_friction(robot, np.full(2, speed), np.full(2, speed), np.full(2, load))
            into = load * speed + xi_m * robot.ell * speed  # power of the motor at a steady speed
            if load * speed > 0.0:
                np.testing.assert_allclose(
                    load * speed / into, abs(load) / ((1.0 + robot.mu_l) * abs(load) + 0.5), rtol=8 * EPS
                )
            else:  # the load drives: less comes back
                assert (into > load * speed).all()


def test_viscous_friction_falls_with_the_temperature_that_losses_make(with_options):
    robot = with_options("thermal")
    np.testing.assert_allclose(warm_viscosity(robot.f_v, robot, robot.T_ref), robot.f_v)
    np.testing.assert_allclose(warm_viscosity(robot.f_v, robot, robot.T_ref + 20.0), robot.f_v / np.e, rtol=4 * EPS)
    np.testing.assert_array_equal(THERMAL.friction(Friction(0.0, 2.0), robot, None, robot.T_ref).f_v, 2.0)  # so far
    np.testing.assert_array_equal(warm_viscosity(robot.f_v, robot), warm_viscosity(robot.f_v, robot, robot.T_amb))
    warm = solve_ivp(
        lambda _, T: temperature_rate(robot, np.full(2, 30.0), T), (0.0, 5e3), np.full(2, 300.0), rtol=1e-9
    )
    # 30 W over 2 W/K, with a time constant of 500 J/K / 2 W/K = 250 s: 20 of them
    np.testing.assert_allclose(warm.y[:, -1], 315.0, rtol=0, atol=1e-6)
    hot = 300.0 + 15.0 * (1.0 - np.exp(-warm.t / 250.0))
    np.testing.assert_allclose(warm.y[0], hot, rtol=0, atol=1e-6)


def test_the_current_follows_with_its_bandwidth_until_the_voltage_ends(with_options):
    robot = with_options("winding")
    tau, still = np.full(2, 0.5), np.zeros(2)
    done = solve_ivp(lambda _, i: current_rate(robot, tau, still, i), (0.0, 2e-3), still, rtol=1e-9, atol=1e-12)
    np.testing.assert_allclose(done.y[0], 5.0 * (1.0 - np.exp(-3e3 * done.t)), rtol=0, atol=1e-6)
    # at speed the torque ends at k_t (U - k_t ell kappa_dot) / R: a line from the stall torque to the no-load speed
    for share in (0.9, 0.97):
        speed = share * robot.U_max / (robot.k_t * robot.ell)
        i_m = solve_ivp(
            lambda _, i, v=speed: current_rate(robot, np.full(2, 1.9), v, i), (0.0, 0.05), still, rtol=1e-9, atol=1e-9
        ).y[:, -1]  # 25 time constants L / R of 2 ms
        np.testing.assert_allclose(i_m, (1.0 - share) * 48.0 / 0.5, rtol=1e-6)
        power = winding_voltage(robot, np.full(2, 1.9), speed, i_m) * i_m
        heat, mechanical = robot.R_w * i_m**2, robot.k_t * i_m * robot.ell * speed
        np.testing.assert_allclose(power, heat + mechanical, rtol=1e-5)  # as the current: L i_dot is the rest
    i_m = solve_ivp(lambda _, i: current_rate(robot, 1e3 * tau, still, i), (0.0, 0.05), still, rtol=1e-9).y[:, -1]
    np.testing.assert_allclose(i_m, 20.0, rtol=1e-6)  # i_max


def test_bristles_hold_a_load_and_slide_as_the_paper_has_it(with_options):
    robot = with_options("bristles")
    J = 0.1 * np.ones(2)  # kg m2

    def sliding(load, end):
        def rate(_, y):
            v, tau_z = y[:2], y[2:4]
            level = friction_level(robot, v)
            xi = stribeck_friction(robot, v, {"tau_z": tau_z})
            return np.concatenate([(load - xi) / J, bristle_rate(robot, v, tau_z, level), v])

        return solve_ivp(rate, (0.0, end), np.zeros(6), method="LSODA", rtol=1e-8, atol=1e-11, dense_output=True).sol

    held = sliding(0.8 * robot.f_s, 4.0)
    crept = np.abs(held(4.0)[4:] - held(2.0)[4:])
    # with tanh it would creep by atanh(0.8) eps = 1.1e-3 rad/s; the bristles give way by 4e-5 rad and hold
    assert crept.max() < 1e-9
    assert (held(4.0)[4:] > 0.5 * 0.8 * robot.f_s / robot.sigma_0).all()
    loose = sliding(1.1 * robot.f_s, 1.0)
    assert (loose(1.0)[4:] > 1e-2).all()
    for v in (-2.0, 0.5):  # a steady slide: tau_z = g sgn(v), as tanh is far above eps
        v = np.full(2, v)
        tau_z = friction_level(robot, v) * np.sign(v)
        xi = stribeck_friction(robot, v, {"tau_z": tau_z})
        np.testing.assert_allclose(xi, stribeck_friction(robot, v), rtol=1e-6)


def test_bristles_never_make_energy_and_the_traced_plant_has_the_laws_of_all_options(
    with_options, draw, plant_function
):
    random, robot = np.random.default_rng(51), with_options("bristles", sigma_1=1e4)
    for _ in range(500):
        v = random.normal(size=2) * 10.0 ** random.uniform(-5, 1)
        level = friction_level(robot, v)
        tau_z = random.uniform(-1.0, 1.0, 2) * level
        rate = bristle_rate(robot, v, tau_z, level)
        taken = bristle_torque(robot, v, tau_z, level) * v - tau_z * rate / robot.sigma_0
        assert (taken >= -8 * EPS * np.abs(tau_z * v)).all()
    robot = with_options()
    states = [(state_of(robot, state, k), state.tau) for k, state in enumerate(draw(robot, 3, seed=53))]
    assert_traced(plant_function, robot, states)


def state_of(robot, state, seed):
    random = np.random.default_rng(seed)
    extra = {
        "tau_h": random.uniform(-0.9, 0.9, robot.n) * robot.f_h,
        "tau_z": random.uniform(-0.9, 0.9, robot.n) * robot.f_c,
        "i_m": random.uniform(-5.0, 5.0, robot.n),
        "T_j": random.uniform(290.0, 340.0, robot.n),
    }
    return np.concatenate([state.x, *(extra[name] for name in state_names(robot)[4:])])


@pytest.mark.parametrize("option", OPTIONS)
def test_without_an_option_nothing_is_traced_of_it(planar, with_options, functions_of, option):
    robot, names = with_options(option), {row.name for row in section(option)}
    assert not names & {p.field for p in planar.entries()}
    assert names <= {p.field for p in robot.entries()}
    assert robot_from_dict(robot.to_dict()).to_dict() == robot.to_dict()
    table = next(row for row in section(option)).table
    with pytest.raises(UsageError, match=rf" has no {option}\. .* \[{table}\]"):
        planar.with_parameters(**{min(names): 1.0})
    state = DRIVE_OPTIONS[option].state
    assert state_names(robot) == [*state_names(planar), *([state.name] if state else [])]
    bare, longer = (functions_of("plant", arm).made("plant_derivatives") for arm in (planar, robot))
    assert len("".join(c_texts(bare))) < len("".join(c_texts(longer)))


def test_an_option_of_some_joints_alone_is_refused(with_options):
    data = with_options("bristles").to_dict()
    del data["joints"][1]["bristles"]
    with pytest.raises(ModelError, match=r"joints\[2\]\.bristles: expected a table, as other joints have, got nothing"):
        robot_from_dict(data)
