"""Gears and motors by name: printed numbers with sources, what is calculated from them, and joints that name them."""

import math
from types import SimpleNamespace

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.optimize import least_squares

from tests.conftest import ran, refused
from vdfmu.arm.drive.dahl import dahl_rate
from vdfmu.arm.equations.harmonic_drive import deformation, deformation_derivative
from vdfmu.arm.equations.torque_estimation import torque_of_deformation
from vdfmu.arm.robot import load_robot, robot_from_dict
from vdfmu.arm.robot.catalogue import catalogue, catalogue_torsion, spring_residual
from vdfmu.arm.robot.parameters import SPRING_KEYS
from vdfmu.base.errors import ModelError

CATALOGUE = catalogue()
GEARS, MOTORS = CATALOGUE["gears"], CATALOGUE["motors"]
SPEED = 2000.0 * math.pi / 30.0


def of_catalogue(gear="CSG-25-100", motor="TBM-6025-B", **tables):
    """Return the small arm, as the content of a file, with joints of a gear and a motor."""
    data = load_robot("planar_2dof").to_dict()
    for joint in data["joints"]:
        del joint["drive"], joint["friction"]
        joint |= {"gear": gear, "motor": motor} | {part: dict(numbers) for part, numbers in tables.items()}
    return data


def fitted(ratio, K, T, largest):
    """Return the parameters of (2)-(3) by least squares to printed stiffnesses, none below 1e-6."""
    torque = np.linspace(0.0, largest, 61)[1:]
    printed, names = catalogue_torsion(torque, K, T), SPRING_KEYS[1:5]

    def spring(logarithms):
        return dict(zip(names, np.exp(np.maximum(logarithms, np.log(1e-6))), strict=True))

    def residual(logarithms):
        return (deformation(SimpleNamespace(ell=ratio, **spring(logarithms)), torque) - printed) / printed[-1]

    # as if half of the compliance at rest, and of its fall, were the flexspline's
    start = np.log([2.0 * K[0], 1.0 / largest, 2.0 * K[0] / ratio**2, ratio / T[1]])
    return spring(least_squares(residual, start, method="lm", xtol=1e-14, ftol=1e-14, gtol=1e-14).x)


@pytest.mark.parametrize("name", GEARS)
def test_every_number_of_a_gear_has_one_source_and_its_tables_are_calculated_from_them(name):
    gear = GEARS[name]
    printed = [key for key, value in gear.items() if not isinstance(value, dict)]
    assert sorted(printed) == sorted(key for keys in gear["sources"].values() for key in keys)
    assert set(gear["sources"]) <= set(CATALOGUE["sources"])
    ratio, K, T = gear["ratio"], [gear[f"K{i}"] for i in (1, 2, 3)], [gear["T1"], gear["T2"]]
    spring = fitted(ratio, K, T, gear["repeated"])
    # five digits are kept; the valley of one gear is so flat that scipy ends 2e-4 beside its bottom. At 1e-5 and less
    # the flexspline is linear to 1e-10, so that its value is rounding.
    assert gear["drive"] == pytest.approx(spring, rel=3e-4, abs=2e-6)
    spring = gear["drive"]
    residual, share = spring_residual(gear)
    # three straight pieces against a smooth curve, whose corners it rounds: 1.5 % seen, at ratio 30
    assert 0.0 < share < 0.016 and residual == pytest.approx(share * catalogue_torsion(gear["repeated"], K, T))
    assert math.degrees(residual) * 60.0 < 0.2
    # where the torque has turned back the springs carry what the element holds: D(f_h) is half of the loop's width
    drive, width = SimpleNamespace(ell=ratio, **spring), np.array([gear["hysteresis_loss"]])
    f_h = float(torque_of_deformation(drive, 0.5 * width, np.array([1e9]))[0])
    assert gear["hysteresis"] == pytest.approx({"K_h": K[0], "f_h": f_h}, rel=1e-4)
    assert ("running" in gear) == ("friction" in gear) == ("load_loss" in gear)
    if "running" in gear:
        f_c, running = ratio * gear["starting"], gear["running"]
        f_v = ratio**2 * (running - gear["starting"]) / SPEED
        without_load = {"f_c": f_c, "f_s": f_c, "f_v": f_v, "v_s": 1.0, "f_ck": 0.0}
        assert gear["friction"] == pytest.approx(without_load, rel=1e-4)
        mu_l = max(0.0, 1.0 / gear["efficiency"] - 1.0 - ratio * running / gear["rated"])
        assert gear["load_loss"] == pytest.approx({"mu_l": mu_l}, rel=1e-4)


def test_motors_have_sources_and_the_torsion_is_that_of_the_example_of_a_catalogue():
    assert {motor["source"] for motor in MOTORS.values()} <= set(CATALOGUE["sources"])
    # Harmonic Drive AG, HFUS-2A, page 24: HFUC-32-100-2UH at 60 N.m, 7.15e-4 rad.
    gear = GEARS["CSG-32-100"]
    K, T = [gear[f"K{i}"] for i in (1, 2, 3)], [gear["T1"], gear["T2"]]
    assert catalogue_torsion(60.0, K, T) == pytest.approx(7.15e-4, abs=5e-7)  # as printed
    assert catalogue_torsion(200.0, K, T) == pytest.approx(29.0 / 6.7e4 + 79.0 / 1.1e5 + 92.0 / 1.2e5, rel=1e-15)
    spring = fitted(100.0, [3e4] * 3, [10.0, 40.0], 100.0)
    drive = robot_from_dict(of_catalogue(drive=spring | {"I_m": 1e-3}))
    np.testing.assert_allclose(1.0 / deformation_derivative(drive, np.zeros(2)), 3e4, rtol=2e-3)


def test_the_loop_of_a_gear_is_as_wide_as_its_loss_and_its_efficiency_that_at_rated_torque():
    """Quasi-static torsion between the rated torques: the width where springs and hysteresis balance."""
    robot = robot_from_dict(of_catalogue(hysteresis={}))
    gear = GEARS["CSG-25-100"]
    K_h, f_h = gear["hysteresis"]["K_h"], gear["hysteresis"]["f_h"]

    def rate(_, y):  # the deformation falls at a unit rate [1e-3 rad]
        tau_s, tau_h = y
        return [-1e-3 / deformation_derivative(robot, np.full(2, tau_s))[0], dahl_rate(K_h, -1e-3, tau_h, f_h)]

    done = solve_ivp(
        rate, (0.0, 3.0), [gear["rated"] - f_h, f_h], events=lambda _, y: y[0] + y[1], rtol=1e-10, atol=1e-10
    )
    tau_s = done.y_events[0][0][0]
    # turned back at +- rated torque; the loop is the same from the other side
    assert 2.0 * deformation(robot, np.full(2, tau_s))[0] == pytest.approx(gear["hysteresis_loss"], rel=1e-4)
    robot = robot_from_dict(of_catalogue(load_loss={}))
    friction = robot.f_c + robot.f_v * SPEED / robot.ell
    np.testing.assert_allclose(friction / robot.ell, gear["running"], rtol=1e-4)

    def efficiency(load):
        return load / ((1.0 + robot.mu_l) * load + friction)

    np.testing.assert_allclose(efficiency(gear["rated"]), gear["efficiency"], rtol=1e-4)
    assert (efficiency(0.3 * gear["rated"]) < 0.65).all()  # less load, less efficiency


def test_a_joint_takes_from_the_catalogue_what_it_does_not_say_and_a_ratio_leaves_the_spring_as_printed():
    robot = robot_from_dict(
        of_catalogue(winding={}, hysteresis={"f_h": 1.0}, friction={"f_v": 0.7}, drive={"c_f": 2e-3})
    )
    gear, motor = GEARS["CSG-25-100"], MOTORS["TBM-6025-B"]
    assert robot.K_f0.tolist() == [gear["drive"]["K_f0"]] * 2
    np.testing.assert_allclose(robot.I_m, 100.0 * (4.13e-5 + 2.52e-5))
    assert (robot.c_f == 2e-3).all() and (robot.f_v == 0.7).all() and (robot.f_c == gear["friction"]["f_c"]).all()
    assert (robot.f_h == 1.0).all() and (robot.K_h == gear["hysteresis"]["K_h"]).all()
    assert (robot.R_w == motor["winding"]["R_w"]).all()
    assert robot.hysteresis and robot.winding and not robot.load_loss and not robot.limits
    source = robot.source_of("joints[2].hysteresis.K_h")
    assert source == "models/drives/catalogue.toml: gear CSG-25-100; assumed there: hysteresis_loss"
    assert robot.source_of("joints[1].drive.I_m").endswith("inertia of gear CSG-25-100 and motor TBM-6025-B, times ell")
    assert robot_from_dict(robot.to_dict()).to_dict() == robot.to_dict()
    printed, changed = (robot_from_dict(of_catalogue(**tables)) for tables in ({}, {"drive": {"ell": 101.0}}))
    assert changed.ell[0] == 101.0
    torque = np.linspace(-90.0, 90.0, 7)[:, None]
    # four roundings of K_w0, c_w and what they are multiplied by
    np.testing.assert_allclose(deformation(changed, torque), deformation(printed, torque), rtol=1e-14)
    stops = {"q_min": -1.0, "q_max": 1.0, "stop_stiffness": 1e4, "stop_damping": 0.5}
    robot = robot_from_dict(of_catalogue(limits=stops))
    np.testing.assert_allclose(robot.kappa_dot_max, 48.0 / 0.078 / 100.0, rtol=1e-4)  # five digits
    assert (robot.tau_stall == 2.56).all()


@pytest.mark.parametrize(("change", "words"), [
    (
        {"gear": "CSG-25-80"},
        r'joints\[1\]\.gear: expected a gear of the catalogue, got "CSG-25-80"\. Did you mean "CSG-25',
    ),
    ({"motor": "TBM-6025"}, r'joints\[1\]\.motor: expected a motor of the catalogue, .* Did you mean "TBM-6025-B"'),
    ({"gear": 25}, r"joints\[1\]\.gear: expected a gear of the catalogue, got 25\. Give it as a string"),
    ({"type": "prismatic"}, r"joints\[1\]\.gear: expected none on a prismatic joint"),
    ({"gear": "CSG-32-100"}, r"joints\[1\]\.friction: expected a table, got nothing"),  # it has none
])  # fmt: skip
def test_what_the_catalogue_has_not_is_refused(change, words):
    data = of_catalogue()
    data["joints"][0] |= change
    with pytest.raises(ModelError, match=words):
        robot_from_dict(data)


@pytest.mark.heavy
def test_the_command_lists_the_catalogue_and_shows_an_entry():
    listed = ran("robot", "drives").output
    assert all(name in listed for name in (*GEARS, *MOTORS)) and "arcmin" in listed
    shown = ran("robot", "drives", "CSG-20-100").output
    assert "K1 16000" in shown and "hysteresis_loss: Assumed" in shown and "TPI 275" in shown
    assert "winding k_t 0.078" in ran("robot", "drives", "TBM-6025-B").output
    assert 'Did you mean "CSG-20-100"' in refused("robot", "drives", "CSG-20-10")
