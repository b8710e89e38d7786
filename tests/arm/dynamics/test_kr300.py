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
