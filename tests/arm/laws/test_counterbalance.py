"""A counterbalance: its law, that of a public robot, and the laws that every arm meets, with it."""

import dataclasses
from types import SimpleNamespace

import numpy as np
import pytest

import vdfmu
from tests.arm.balanced import BALANCED, BOTH, CYLINDER, ONE, balanced
from vdfmu.arm.drive.counterbalance import counterbalance_energy, counterbalance_torque, stroke
from vdfmu.arm.equations.plant import equilibrium_torque, plant_derivative
from vdfmu.arm.kernel import FUNCTIONS, trace
from vdfmu.arm.robot import load_robot, robot_from_dict
from vdfmu.arm.robot.physical import requirements
from vdfmu.arm.units import shipped_units
from vdfmu.base.errors import ModelError
from vdfmu.compiler.c.functions import c_texts
from vdfmu.compiler.unit.evaluate import Plain, margins, unmet
from vdfmu.compiler.unit.interface import Interface

EPS = np.finfo(float).eps


def public_torque(axis_2):
    """Return the torque that the counterbalance takes from the motor of a KUKA KR300 [N m], axis 2 as KUKA counts it.

    `hydraulic_weight_counterbalance.m` of the repository JonasWeigand/Robot_Identification (MIT), line by line; there
    it adds to the torque G that holds the arm.
    """
    D, k, area = 0.8, 0.2, np.pi * (0.055**2 - 0.03**2) / 4.0
    delta = axis_2 + 95.0 * np.pi / 180.0
    dl = np.sqrt(D**2 + k**2 - 2.0 * D * k * np.cos(delta)) - (D - k)
    h = np.sin(delta) * D * k / (dl + (D - k))
    press = 1.01 * 296.8 * 328.0 * (2 * 0.0795) / (2 * 0.00048 - dl * area)
    return h * press * area


def test_the_law_is_that_of_a_public_robot():
    area = np.pi * (0.055**2 - 0.03**2) / 4.0
    volume, content = 2 * 0.00048, 1.01 * 296.8 * 328.0 * (2 * 0.0795)  # [m3], [N m]
    robot = SimpleNamespace(
        n=1, F_cb=[content / volume * area], D_cb=[0.8], r_cb=[0.2], delta_cb=[np.deg2rad(95.0)], L_cb=[volume / area]
    )
    assert robot.F_cb[0] == pytest.approx(27.2e3, rel=1e-3) and robot.L_cb[0] == pytest.approx(0.575, rel=1e-3)
    axis_2 = np.deg2rad(np.linspace(-140.0, -5.0, 28))
    torque = counterbalance_torque(robot, axis_2[None])[0]
    # dl is a difference of lengths of 1 m that are 0.4 m or less in the law; 20 roundings of a torque of 14 kN m
    np.testing.assert_allclose(torque, -public_torque(axis_2), rtol=0, atol=100 * EPS * 14e3)
    lean = axis_2 > np.deg2rad(-95.0)
    assert (torque[lean] < 0.0).all() and (torque[~lean][:-1] > 0.0).all()  # back to where it is neutral


def test_torque_is_minus_the_slope_of_the_energy_and_an_upright_arm_needs_less():
    for q in np.linspace(-4.0, 4.0, 41):
        for i in range(2):
            step = np.full(2, q) + 1e-30j * np.eye(2)[i]
            slope = counterbalance_energy(BOTH, step).imag[i] / 1e-30
            # exact except for rounding: of 1 - dl / L, at least 0.2, some 20 times 1e-16 / 0.2; torques up to 60 N m
            assert counterbalance_torque(BOTH, np.full(2, q))[i] == pytest.approx(-slope, rel=1e-13, abs=1e-13)
    dead = np.array([-0.4, 1.0])
    assert not counterbalance_torque(BOTH, dead).any()
    # L F, 50 J, times the rounding of dl / L, 1e-16
    np.testing.assert_allclose(counterbalance_energy(BOTH, dead), 0.0, rtol=0, atol=1e-13)
    assert (counterbalance_energy(BOTH, dead + 2.0) > 1.0).all()
    longest, _ = stroke(BOTH, 0, np.pi - 0.4)
    assert longest == pytest.approx(0.2, abs=4 * EPS)  # 2 r
    # A crank at dead centre with the arm upright helps on either side; inertia and the other joint know nothing.
    bare = load_robot("planar_2dof")
    # at q = 0 the arm lies along x
    helped = balanced("planar_2dof", CYLINDER | {"F_cb": 80.0, "delta_cb": -np.pi / 2.0})
    for lean in (-0.8, -0.3, 0.3, 0.8):
        q = np.array([np.pi / 2.0 + lean, 0.0])
        without, with_it = (vdfmu.dynamics.gravity_torque(robot, q) for robot in (bare, helped))
        assert abs(with_it[0]) < abs(without[0]) and np.sign(without[0] - with_it[0]) == np.sign(without[0])
        expected = without - counterbalance_torque(helped, q)
        np.testing.assert_allclose(with_it, expected, rtol=0, atol=1e-12 * np.abs(without).max())  # as in test_trace
        np.testing.assert_array_equal(vdfmu.dynamics.mass_matrix(helped, q), vdfmu.dynamics.mass_matrix(bare, q))


@pytest.mark.parametrize("chain", BALANCED, indirect=True)
def test_an_arm_that_springs_and_cylinders_hold_stays_at_rest(chain, draw):
    zero = np.zeros(chain.n)
    for state in draw(chain, 10, seed=24):
        tau_s = equilibrium_torque(chain, state.q)
        x_dot = plant_derivative(chain, np.concatenate([state.q, zero, zero, tau_s]), tau_s / chain.ell, np.zeros(6))
        # torques of up to 100 N m that cancel to some ten roundings, through a mass matrix of 1e-2 kg m2 and more
        np.testing.assert_allclose(x_dot, 0.0, rtol=0, atol=1e-11)


def test_a_joint_without_a_cylinder_has_no_line_of_it():
    assert {p.index for p in ONE.entries() if p.field in CYLINDER} == {(0,)}
    none, plain = balanced("slider_3dof"), load_robot("slider_3dof")
    for name in FUNCTIONS:
        assert c_texts(trace(name, none)) == c_texts(trace(name, plain))
    assert robot_from_dict(ONE.to_dict()).to_dict() == ONE.to_dict()


@pytest.mark.parametrize(("cylinder", "words"), [
    (
        {"F_cb": 10.0},
        r"r_cb: expected r_cb > 0, got r_cb = 0\..*\n.*D_cb > r_cb, got D_cb = 0, r_cb = 0\..*\n.*L_cb >",
    ),
    (
        CYLINDER | {"D_cb": 0.1},
        r"joints\[1\]\.counterbalance\.D_cb: expected D_cb > r_cb, got D_cb = 0\.1, r_cb = 0\.1\.",
    ),
    (
        CYLINDER | {"L_cb": 0.2},
        r"joints\[1\]\.counterbalance\.L_cb: expected L_cb > 2\*r_cb, got L_cb = 0\.2, r_cb = 0\.1\.",
    ),
    (CYLINDER | {"F_cb": -1.0}, r"F_cb: expected a finite number >= 0 in N, got -1.*Give 0 for a joint without"),
    (CYLINDER | {"delta_cb": float("inf")}, r"delta_cb: expected a finite number in rad, got inf"),
])  # fmt: skip
def test_a_cylinder_that_cannot_be_is_refused(cylinder, words):
    with pytest.raises(ModelError, match=words):
        balanced("planar_2dof", cylinder)


def test_a_prismatic_joint_has_none_and_what_is_set_at_run_time_meets_the_same_conditions():
    with pytest.raises(ModelError, match=r"joints\[2\]\.counterbalance\.F_cb: expected 0 at a prismatic joint, got 2"):
        balanced("slider_3dof", CYLINDER, CYLINDER)
    interface = Interface(shipped_units()["plant"], ONE)
    for name, value, words in (("L_cb[1]", 0.2, "L_cb > 2*r_cb"), ("D_cb[1]", 0.1, "D_cb > r_cb")):
        memory = Plain(interface).memory.copy()
        assert not unmet(interface, memory)
        memory[interface.reference[name]] = value
        assert [f"expected {words}, got " in problem for problem in unmet(interface, memory)] == [True]
    short = dataclasses.replace(ONE, r_cb=np.array([0.0, 0.0, 0.0]))
    checks = requirements(ONE)
    broken = {each.expected for each, margin in zip(checks, margins(short, checks), strict=True) if margin < 0.0}
    assert broken == {"r_cb > 0"}
