"""The functions that are traced: name, inputs, outputs and the equation behind each."""

from __future__ import annotations

from collections.abc import Callable

import casadi as ca
import numpy as np

from vdfmu.equations.forward_dynamics import forward_dynamics
from vdfmu.equations.inverse_dynamics import inverse_dynamics
from vdfmu.equations.kinematics import end_effector_pose
from vdfmu.equations.mapping import jacobian, joint_space_mass_matrix
from vdfmu.equations.newton_euler import newton_euler
from vdfmu.kernel.requirements import margins, requirements
from vdfmu.kernel.structure import symbolic_robot
from vdfmu.model import Robot
from vdfmu.scalar.symbol import from_sx, to_sx

__all__ = ["FUNCTIONS", "traced_function"]

Trace = Callable[[Robot], ca.Function]
FUNCTIONS: dict[str, Trace] = {}
"""Name to what traces the function for the structure of a robot."""


def _traced(make: Trace) -> Trace:
    FUNCTIONS[make.__name__.removeprefix("_trace_")] = make
    return make


def traced_function(name: str, inputs: dict[str, ca.SX], outputs: dict[str, ca.SX]) -> ca.Function:
    """Make a function of named columns."""
    # cse finds terms that the equations compute more than once, such as the motion in all solver stages
    expressions = ca.cse([ca.densify(expression) for expression in outputs.values()])
    return ca.Function(name, list(inputs.values()), expressions, list(inputs), list(outputs))


def _vectors(n: int, *names: str) -> dict[str, ca.SX]:
    return {name: ca.SX.sym(name, n) for name in names}


def _arrays(inputs: dict[str, ca.SX]) -> list[np.ndarray]:
    return [from_sx(expression) for expression in inputs.values()]


@_traced
def _trace_inverse_dynamics(robot: Robot) -> ca.Function:
    symbols, p = symbolic_robot(robot)
    inputs = _vectors(robot.n, "q", "q_dot", "q_ddot") | _vectors(6, "F_e")
    q, q_dot, q_ddot, F_e = _arrays(inputs)
    tau = inverse_dynamics(symbols, q, q_dot, q_ddot, F_e)
    return traced_function("inverse_dynamics", inputs | {"p": p}, {"tau": to_sx(tau)})


@_traced
def _trace_newton_euler(robot: Robot) -> ca.Function:
    """For contrast only, section IV-A."""
    symbols, p = symbolic_robot(robot)
    inputs = _vectors(robot.n, "q", "q_dot", "q_ddot") | _vectors(6, "F_e")
    tau = newton_euler(symbols, *_arrays(inputs))
    return traced_function("newton_euler", inputs | {"p": p}, {"tau": to_sx(tau)})


@_traced
def _trace_forward_dynamics(robot: Robot) -> ca.Function:
    symbols, p = symbolic_robot(robot)
    inputs = _vectors(robot.n, "q", "q_dot", "tau") | _vectors(6, "F_e")
    q, q_dot, tau, F_e = _arrays(inputs)
    q_ddot = forward_dynamics(symbols, q, q_dot, tau, F_e)
    return traced_function("forward_dynamics", inputs | {"p": p}, {"q_ddot": to_sx(q_ddot)})


@_traced
def _trace_forward_kinematics(robot: Robot) -> ca.Function:
    """Position and rotation of {O} in {I}, in one vector."""
    symbols, p = symbolic_robot(robot)
    inputs = _vectors(robot.n, "q")
    pose = [to_sx(part) for part in end_effector_pose(symbols, *_arrays(inputs))]
    return traced_function("forward_kinematics", inputs | {"p": p}, {"pose": ca.vertcat(*pose)})


@_traced
def _trace_jacobian(robot: Robot) -> ca.Function:
    symbols, p = symbolic_robot(robot)
    inputs = _vectors(robot.n, "q")
    return traced_function("jacobian", inputs | {"p": p}, {"J_q": to_sx(jacobian(symbols, *_arrays(inputs)))})


@_traced
def _trace_mass_matrix(robot: Robot) -> ca.Function:
    symbols, p = symbolic_robot(robot)
    inputs = _vectors(robot.n, "q")
    M = joint_space_mass_matrix(symbols, *_arrays(inputs))
    return traced_function("mass_matrix", inputs | {"p": p}, {"M": to_sx(M)})


@_traced
def _trace_margins(robot: Robot) -> ca.Function:
    symbols, p = symbolic_robot(robot)
    return traced_function("margins", {"p": p}, {"margin": to_sx(margins(symbols, requirements(robot)))})
