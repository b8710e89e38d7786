"""The interface of a unit: what lies where in its memory, what is an array in FMI 3, and what depends on what."""

import dataclasses

import numpy as np

from vdfmu.arm.robot import Robot, check_robot
from vdfmu.arm.units import shipped_units
from vdfmu.compiler.unit.interface import Interface


def first_joint(robot: Robot) -> Robot:
    n, fields = robot.n, {f.name: getattr(robot, f.name) for f in dataclasses.fields(robot)}
    per_joint = {k: v[:1] for k, v in fields.items() if k == "joint_types" or np.shape(v)[:1] == (n,)}
    return check_robot(dataclasses.replace(robot, **per_joint))


def shapes(unit: str, robot: Robot) -> dict[str, tuple[int, ...]]:
    return {array.name: array.shape for array in Interface(shipped_units()[unit], robot).arrays}


def test_what_is_whole_and_of_one_unit_is_an_array(planar, general, robots):
    shape_by_name = shapes("plant", planar)
    expected = {
        "tau": (2,), "q": (2,), "p_O": (3,), "R_O": (3, 3), "E_kin": (), "mass": (2,), "equilibrium": (),
        "der(q)": (2,), "der(tau_s)": (2,), "time": (), "F_e[1]": (), "F_e[6]": (),
    }  # fmt: skip
    assert {name: shape_by_name.get(name) for name in expected} == expected
    # ``tool_offset[1]`` alone would look like a whole vector of one element.
    shape_by_name = shapes("plant", planar)
    assert shape_by_name["tool_offset[1]"] == shape_by_name["gravity[3]"] == shape_by_name["offset[2,1]"] == ()
    assert not {"tool_offset", "gravity", "offset"} & set(shape_by_name)
    shape_by_name = shapes("plant", general)
    n = general.n
    assert (shape_by_name["gravity"], shape_by_name["offset"], shape_by_name["centroid"]) == ((3,), (n, 3), (n, 3))
    assert "inertia[1,1,2]" in shape_by_name  # the lower triangle is folded
    shape_by_name = shapes("plant", robots["slider_3dof"])
    assert shape_by_name["tau"] == shape_by_name["mass"] == (3,)
    assert not {"q", "q_0", "der(q)", "ell", "F_e"} & set(shape_by_name)
    assert shape_by_name["q[3]"] == shape_by_name["der(q_dot[2])"] == shape_by_name["ell[1]"] == ()
    one_joint = first_joint(planar)
    shape_by_name = shapes("plant", one_joint)
    assert shape_by_name["q"] == shape_by_name["der(q)"] == shape_by_name["mass"] == (1,)
    assert shapes("controller", one_joint)["K_p"] == (1,)


def test_states_and_derivatives_depend_on_what_their_equations_hold(robots):
    interface = Interface(shipped_units()["plant"], robots["manipulator_6dof"])
    position = {v.name: i for i, v in enumerate(interface.memory)}

    def groups(indices: list[int]) -> set[str]:
        return {interface.memory[i].group for i in indices}

    for i in range(1, 7):
        assert interface.step_dependencies(position[f"q[{i}]"]) == [position[f"q[{i}]"]]
        assert interface.step_dependencies(position[f"der(q[{i}])"]) == [position[f"q_dot[{i}]"]]
        assert interface.start_dependencies(position[f"der(q[{i}])"]) == [position[f"q_dot_0[{i}]"]]
        # rotor: I_m kappa_ddot = tau - tau_s/ell - xi_m(kappa_dot), each joint by itself
        rotor = interface.step_dependencies(position[f"der(kappa_dot[{i}])"])
        assert rotor == sorted(position[f"{group}[{i}]"] for group in ("tau", "kappa_dot", "tau_s"))
        link = interface.step_dependencies(position[f"der(q_dot[{i}])"])
        assert {"q", "q_dot", "tau_s"} <= groups(link) <= {"q", "q_dot", "tau_s", "F_e"}
        assert "kappa_dot_0" in groups(interface.start_dependencies(position[f"der(tau_s[{i}])"]))
    assert groups(interface.step_dependencies(position["E_kin"])) == {"q", "q_dot", "kappa_dot"}
