"""The functions that are traced: name, inputs, outputs and the equation behind each."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import casadi as ca
import numpy as np

from vdfmu.arm.equations.forward_dynamics import forward_dynamics
from vdfmu.arm.equations.inverse_dynamics import inverse_dynamics
from vdfmu.arm.equations.kinematics import end_effector_pose
from vdfmu.arm.equations.mapping import jacobian, joint_space_mass_matrix
from vdfmu.arm.equations.newton_euler import newton_euler
from vdfmu.arm.robot import Robot
from vdfmu.arm.robot.requirements import margins, requirements
from vdfmu.arm.robot.structure import symbolic_robot
from vdfmu.compiler.scalar.symbol import from_sx, to_sx


def _pose(robot: Any, q: Any) -> Any:
    """Position and rotation of {O} in {I}, in one vector."""
    return np.concatenate([np.ravel(part) for part in end_effector_pose(robot, q)])


FUNCTIONS: dict[str, tuple[tuple[str, ...], str, Callable[..., Any]]] = {
    "inverse_dynamics": (("q", "q_dot", "q_ddot", "F_e"), "tau", inverse_dynamics),
    "newton_euler": (("q", "q_dot", "q_ddot", "F_e"), "tau", newton_euler),  # for contrast only, section IV-A
    "forward_dynamics": (("q", "q_dot", "tau", "F_e"), "q_ddot", forward_dynamics),
    "forward_kinematics": (("q",), "pose", _pose),
    "jacobian": (("q",), "J_q", jacobian),
    "mass_matrix": (("q",), "M", joint_space_mass_matrix),
    "margins": ((), "margin", margins),
}
"""Name to inputs, output and equation. The last input of all is ``p``, the run-time parameters of the robot."""


def trace(name: str, robot: Robot) -> ca.Function:
    """Trace one of `FUNCTIONS` for the structure of a robot."""
    names, result, equation = FUNCTIONS[name]
    symbols, p = symbolic_robot(robot)
    inputs = {one: ca.SX.sym(one, 6 if one == "F_e" else robot.n) for one in names}
    arguments = [requirements(robot)] if equation is margins else [from_sx(v) for v in inputs.values()]
    return traced_function(name, inputs | {"p": p}, {result: to_sx(equation(symbols, *arguments))})


def traced_function(name: str, inputs: dict[str, ca.SX], outputs: dict[str, ca.SX]) -> ca.Function:
    """Make a function of named columns."""
    # cse finds terms that the equations compute more than once, such as the motion in all solver stages
    expressions = ca.cse([ca.densify(expression) for expression in outputs.values()])
    return ca.Function(name, list(inputs.values()), expressions, list(inputs), list(outputs))
