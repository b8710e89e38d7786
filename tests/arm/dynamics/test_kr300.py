"""The KR 300 of a public record, examples/kr300: its controller. Its records: docs/claims.toml."""

from pathlib import Path

import numpy as np

from vdfmu.arm.robot import load_robot
from vdfmu.arm.units import find_unit
from vdfmu.arm.units.plant import Plant
from vdfmu.system.scenario import load_scenario

FOLDER = Path(__file__).parents[3] / "examples" / "kr300"
GIVEN = ("K_v", "K_p", "f_n", "T", "T_q", "q_0")


def cascade(robot, **more):
    values = load_scenario("kr300").sections["controller"]
    unit = find_unit(FOLDER / "cascade.py")(robot, **{name: values[name] for name in GIVEN} | more)
    unit.start()
    return unit


def test_the_controller_holds_the_arm_at_the_start():
    robot = load_robot("kr300_6dof")
    unit = cascade(robot)
    unit.q_d, unit.q = unit.q_0, unit.q_0
    unit.outputs()
    unit.derivatives()
    plant = Plant(robot, q_0=unit.q_0, tau=unit.tau)
    plant.start()
    plant.outputs()
    plant.derivatives()
    for rate in (unit.w_dot, unit.z_dot):
        np.testing.assert_array_equal(rate, 0.0)
    # Rounding of 4000 N.m, over the smallest inertia of a link about its axis, 1.6 kg.m2.
    np.testing.assert_allclose(plant.der_q_dot, 0.0, atol=100 * 2.0**-52 * 4000.0)


def test_without_integrator_filter_and_delay_it_is_the_law_of_the_file_with_its_gains():
    robot, random = load_robot("kr300_6dof"), np.random.default_rng(3)
    unit = cascade(robot, f_n=0.0, T_q=0.0)
    start = unit.z.copy()
    signals = {name: random.uniform(-1.0, 1.0, 6) for name in ("q_d", "kappa_dot_d", "tau_ff", "q", "kappa_dot")}
    for name, value in signals.items():
        setattr(unit, name, value)
    unit.w = np.zeros(6)
    unit.derivatives()
    unit.w = unit.T * unit.w_dot  # where the filter comes to rest
    unit.derivatives()
    unit.outputs()
    np.testing.assert_array_equal(unit.z_dot, 0.0)
    # ident_functions/nonlinear_differential_model.m
    law = (
        signals["tau_ff"]
        + unit.K_v * (signals["kappa_dot_d"] - signals["kappa_dot"])
        + unit.K_p * (signals["q_d"] - signals["q"])
    )
    # Some ten roundings of torques of up to 4000 N.m.
    np.testing.assert_allclose(unit.tau - start, law, rtol=0, atol=10 * 2.0**-52 * 4000.0)
    # K_vel [As], k_T [N.m/A], K_pos of `para` in its records, and create_traj_for_robot/Robot_reference_dynamics.m.
    values, robot = load_scenario("kr300").sections["controller"], load_robot("kr300_6dof")
    K_vel, k_T = np.repeat([20.0, 1.8], 3), np.array([1.81, 1.89, 1.89, 1.41, 1.41, 1.41])
    K_v = robot.ell * K_vel * k_T / (360.0 * np.sqrt(2.0)) * 360.0 / 2.0 / np.pi
    np.testing.assert_allclose(values["K_v"], K_v, rtol=1e-6)  # the digits in the file
    np.testing.assert_allclose(values["K_p"][:3], 10.0 * 360.0 / 2.0 / np.pi, rtol=1e-6)
