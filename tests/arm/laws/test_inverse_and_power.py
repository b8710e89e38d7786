"""A walk through the table of parameters: the exact inverse and the balance of power know each that moves the plant.

Exceptions are declared beside the table, with reasons. A parameter that moves the plant alone fails here.
"""

import dataclasses
from functools import cache

import numpy as np
import pytest

from tests.arm.balanced import EVERY_CHAIN
from tests.conftest import OPTIONS, draw_states, make_general_chain
from vdfmu.arm.drive.options import options_of
from vdfmu.arm.equations.feedforward import feedforward_inverse
from vdfmu.arm.equations.flexible_joint import drive_losses, drive_torque, split_state
from vdfmu.arm.equations.mapping import jacobian
from vdfmu.arm.equations.plant import plant_derivative, plant_outputs
from vdfmu.arm.equations.trajectory import desired_motion
from vdfmu.arm.robot.parameters import JOINT_OPTIONS, NOT_BALANCED, NOT_INVERTED, PARAMETERS, Row
from vdfmu.compiler.scalar.jet import derivative, jets

EPS = np.finfo(float).eps
F_E = np.array([5.0, -3.0, 4.0, 0.3, -0.2, 0.4])
"""A wrench that the feedforward knows."""
TIMES = (0.3, 1.1)
"""Along a motion of 10 s, where a kinematic error has at most 50 rad/s."""
WITHIN = 1e-9
"""Deviation of a rate that is rounding, over 1 SI unit and the size of the rate. Torques of 100 N m go through masses
of 1e-2 kg m2: 1e-16 * 100 / 1e-2. Differences in time add 1e-16 * 100 / 1e-3, and (1e-3 * 50)^8 / 630 of a rate."""
VISIBLE = 1e-6
"""Change of a rate, over the same, from which a parameter moves the plant: far above what is rounding."""
WEIGHTS = np.array([1 / 280, -4 / 105, 1 / 5, -4 / 5, 0, 4 / 5, -1 / 5, 4 / 105, -1 / 280])
"""Central difference of order 8."""
STATES = {"tau_h": 0.7, "tau_z": 0.2, "i_m": 1.3, "T_j": 311.0}
"""States of options somewhere in a run: no desired motion says them."""


def states_of(robot):
    return [np.full(robot.n, STATES[option.state.name]) for option, _ in options_of(robot) if option.state]


def desired_at(n, t):
    return desired_motion(t, np.linspace(-0.2, 0.2, n), np.linspace(1.0, 1.6, n), 10.0)


@cache
def walker(section="", friction="split"):
    options = {"load_loss", "backlash", "counterbalance", *({section} & {*JOINT_OPTIONS})}
    robot = make_general_chain()
    fixed = {"theta_err_amplitude": 0.0, **{key: value for name in options & {*OPTIONS} for key, value in
             OPTIONS[name].items()}}  # fmt: skip
    fixed["F_cb"] = np.where(np.array(robot.joint_types) == "revolute", 200.0, 0.0)
    odd = np.arange(robot.n) % 2 == 1
    if section == "limits":  # stops before and behind the joints, motors that are too weak and too fast
        fixed |= {"q_min": np.where(odd, 2.0, -9.0), "q_max": np.where(odd, 9.0, -1.0), "stop_stiffness": 50.0}
        fixed |= {"tau_stall": 1e-3, "kappa_dot_max": 4e-3, "full_speed": 0.4}
    if section == "winding":  # some lack voltage, the others current
        fixed |= {"U_max": np.where(odd, 0.1, 48.0), "i_max": np.where(odd, 20.0, 0.1)}
    flags = {name: True for name in options}
    return dataclasses.replace(robot, rotor_coupling=False, friction=friction, **flags).with_parameters(**fixed)


def changed(robot, of: Row):
    """Return a robot with another value of a parameter: a tenth more, or one that is not 0."""
    value = getattr(robot, of.name)
    if of.fold == "always":  # rotations: one more, about an axis in no plane
        c, s = np.cos(0.1), np.sin(0.1)
        turn = np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]]) @ [[1.0, 0.0, 0.0], [0.0, c, -s], [0.0, s, c]]
        return robot.with_parameters(**{of.name: value @ turn})
    if of.name == "theta_err_phase":
        robot = robot.with_parameters(theta_err_amplitude=2e-5)
    return robot.with_parameters(**{of.name: 1.1 * value if np.any(value) else min(1.0, 2e-5 * of.largest)})


@cache
def inverse_at(robot, t):
    """Return state and torques of the inverse at a time, with states of options, and the rates that it means."""
    h = 1e-3
    inverses = [feedforward_inverse(robot, desired_at(robot.n, t + k * h), F_E) for k in range(-4, 5)]
    kappa_ddot, tau_s_dot = (
        sum(w * getattr(each, name) for w, each in zip(WEIGHTS, inverses, strict=True)) / h
        for name in ("kappa_dot_d", "tau_s")
    )
    desired, now = desired_at(robot.n, t), inverses[4]
    x = np.concatenate([desired.q_d, desired.q_d_dot, now.kappa_dot_d, now.tau_s, *states_of(robot)])
    return x, now.tau_m, np.concatenate([desired.q_d_dot, desired.q_d_ddot, kappa_ddot, tau_s_dot])


def sized(difference, rates):
    """Return the largest difference of rates, over 1 SI unit and the size of the largest."""
    return float(np.abs(difference).max() / (1.0 + np.abs(rates).max()))


def deviation(robot, times=TIMES):
    """Return by how much the plant that is driven by the inverse leaves the motion, at worst."""
    worst = 0.0
    for t in times:
        x, tau, rates = inverse_at(robot, t)
        worst = max(worst, sized(plant_derivative(robot, x, tau, F_E)[: rates.size] - rates, rates))
    return worst


def imbalance(robot):
    """Return the power that is in no account, over the rounding of some 1000 operations on what flows, at worst."""
    worst = 0.0
    for k, state in enumerate(draw_states(robot, 3, seed=52)):
        added = [(0.9 + 0.1 * k) * value for value in states_of(robot)]
        x, tau, F_e = np.concatenate([state.x, *added]), state.tau, state.F_e
        parts, x_dot = split_state(robot, x), plant_derivative(robot, x, tau, F_e)
        outputs = plant_outputs(robot, jets(x, x_dot, 0.0))
        rates = [float(np.ravel(derivative(getattr(outputs, e), 1))[0]) for e in ("E_kin", "E_pot", "E_spring")]
        for option, option_state in options_of(robot, parts.options):
            tau = option.motor(tau, robot, parts.kappa_dot, option_state)
        motors, losses = tau * (robot.ell * parts.kappa_dot), drive_losses(robot, parts)
        assert (losses >= 0.0).all()
        flow = motors.sum() - losses.sum() - F_e @ (jacobian(robot, parts.q) @ parts.q_dot)
        load = np.abs(drive_torque(robot, parts)) @ (np.abs(parts.kappa_dot) + np.abs(parts.q_dot))
        size = np.abs(rates).sum() + np.abs(motors).sum() + load + 10.0 * np.abs(x_dot[robot.n : 2 * robot.n]).max()
        worst = max(worst, abs(sum(rates) - flow) / (1000 * EPS * size))
    return worst


def check(robot, of: Row):
    """Walk to a parameter: it moves the plant, and inverse and balance know it, or it is declared that they do not."""
    other = changed(robot, of)
    x, tau, _ = inverse_at(robot, TIMES[0])
    before, after = (plant_derivative(each, x, tau, F_E) for each in (robot, other))
    assert sized(after - before, before) > VISIBLE, f"{of.name} moves no rate of the plant"
    reason = NOT_INVERTED.get(of.section) or NOT_INVERTED.get(of.name)
    error = deviation(other, TIMES[:1])
    if reason:
        assert error > VISIBLE, f"{of.name}: declared, though the exact inverse knows it: {reason}"
    else:
        assert error < WITHIN, f"{of.name}: the exact inverse does not know it, by {error:.2g}. {WAY_OUT}"
    reason, error = NOT_BALANCED.get(of.name), imbalance(other)
    if reason:
        assert error > 1e3, f"{of.name}: declared, though the power is balanced: {reason}"
    else:
        assert error < 1.0, f"{of.name}: power is in no account, {error:.2g} of rounding. {WAY_OUT}"


WAY_OUT = "Give torque, losses, energy and inverse what it does, or declare it beside the table."


LUMPED = ("friction", "load_loss", "bristles", "thermal")
"""Sections of friction, to walk through in both arrangements."""


@pytest.mark.few(4)
@pytest.mark.parametrize(
    ("name", "friction"),
    [(name, kind) for name, of in PARAMETERS.items() for kind in ("split", "lumped")
     if kind == "split" or (of.section in LUMPED and of.fold != "lumped friction")],
)  # fmt: skip
def test_the_inverse_and_the_balance_know_each_parameter_that_moves_the_plant(name, friction):
    check(walker(PARAMETERS[name].section, friction), PARAMETERS[name])


@EVERY_CHAIN
def test_the_plant_driven_by_the_inverse_follows_the_desired_motion(chain):
    assert deviation(dataclasses.replace(chain, rotor_coupling=False)) < WITHIN


@pytest.mark.few(2)
def test_links_follow_the_inverse_with_coupled_rotors_too_whose_motion_is_declared_not_to_be_exact(chain):
    robot = dataclasses.replace(chain, rotor_coupling=True)
    x, tau, rates = inverse_at(robot, TIMES[1])
    links = slice(2 * robot.n)
    assert sized((plant_derivative(robot, x, tau, F_E)[: rates.size] - rates)[links], rates[links]) < WITHIN
    robot = dataclasses.replace(walker(), rotor_coupling=True)
    assert NOT_INVERTED["rotor_coupling"] and deviation(robot) > WITHIN
    assert imbalance(robot) < 1.0


@pytest.mark.parametrize("friction", ["split", "lumped"])
def test_power_is_balanced_with_all_options_at_once(friction):
    robot = dataclasses.replace(walker("limits", friction), hysteresis=True, bristles=True, winding=True, thermal=True)
    assert imbalance(robot.with_parameters(**{k: v for values in OPTIONS.values() for k, v in values.items()})) < 1.0


def test_each_exception_is_of_a_parameter_an_option_or_a_flag():
    assert {*NOT_INVERTED} <= {*PARAMETERS, *JOINT_OPTIONS, "rotor_coupling"}
    assert {*NOT_BALANCED} <= {*PARAMETERS}
