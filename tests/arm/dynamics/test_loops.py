"""The functions of long arms become loops over the joints, with the bits of the straight lines."""

import pytest

from benchmarks.chains import repeated_link
from tests.compiler.native.loops import check_bits, check_derivatives
from vdfmu.arm.robot import load_robot
from vdfmu.arm.units import find_unit
from vdfmu.compiler.c.loop_text import c_loops
from vdfmu.compiler.c.loops import find_loops
from vdfmu.compiler.unit.program import UnitFunctions

STEP = ("plant_step_start", "plant_step_solve", "plant_step_balance")


def functions_of(robot):
    plant, feedforward = (UnitFunctions(find_unit(unit), robot, cache=None) for unit in ("plant", "feedforward"))
    called = {function.name(): function for function in plant.casadi_function("plant_step").find_functions()}
    functions = {name: called[name] for name in STEP}
    functions |= {name: plant.casadi_function(name) for name in ("plant_derivatives", "plant_outputs")}
    modes = ("feedforward_outputs_inverse", "feedforward_outputs_vdc")
    return functions | {name: feedforward.casadi_function(name) for name in modes}


@pytest.mark.heavy
@pytest.mark.parametrize("robot", [repeated_link(14), load_robot("snake_24dof")], ids=lambda robot: robot.name)
def test_the_functions_of_long_arms_keep_their_bits(robot, tmp_path):
    for name, function in functions_of(robot).items():
        folder = tmp_path / name
        folder.mkdir()
        loops = find_loops(function, robot.n)
        if name in STEP[1:] and robot.name != "snake_24dof":  # its signs alternate: 10 members for 20 joints
            assert loops is not None
        if loops is not None:
            check_bits(function, loops, folder)
            if name not in STEP:
                check_derivatives(function, loops, folder)


@pytest.mark.heavy
def test_their_text_does_not_grow_with_the_joints():
    short, long = functions_of(repeated_link(14)), functions_of(repeated_link(20))
    for name in short:
        few, many = find_loops(short[name], 14), find_loops(long[name], 20)
        assert len(c_loops(many)) < 1.1 * len(c_loops(few)), name


def test_the_equations_of_a_long_arm_keep_their_bits(tmp_path):
    functions = UnitFunctions(find_unit("plant"), repeated_link(10), cache=None)
    equations = functions.casadi_function("plant_derivatives")
    check_bits(equations, find_loops(equations, 10), tmp_path)
